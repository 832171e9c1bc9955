"""Filters of places: mirrored, turned, cut out, or joined to larger pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.core.quantities import quantity
from neuro.events._events import Events
from neuro.events.filters._filter import Filter, Sieve, Size, State, kept


@dataclass(frozen=True, eq=False)
class Flip(Filter):
    """Mirror.

    Attributes:
        axis: "x" exchanges left and right (``frame[:, ::-1]``), "y" top and bottom (``frame[::-1]``).
    """

    word = "flip"
    axis: str = quantity("x", kind="word", words=("x", "y"))

    def _part(self, events: Events) -> Events:
        x, y = events.x, events.y
        if self.axis == "x":
            x = np.uint16(self.sensor_size[0] - 1) - x
        else:
            y = np.uint16(self.sensor_size[1] - 1) - y
        return self._of(events, (events.t, x, y, events.p))


@dataclass(frozen=True, eq=False)
class Transpose(Filter):
    """Exchange columns and rows (``frame.T``)."""

    word = "transpose"

    @property
    def out_size(self) -> Size:
        """Height and width of what comes in, px."""
        return self.sensor_size[1], self.sensor_size[0]

    def _part(self, events: Events) -> Events:
        return self._of(events, (events.t, events.y, events.x, events.p))


@dataclass(frozen=True, eq=False)
class Rotate90(Filter):
    """Turn by right angles.

    Attributes:
        turns: quarters of a turn, counter-clockwise as the picture is seen (``numpy.rot90(frame, turns)``).
    """

    word = "rotate"
    turns: int = quantity(1, "quarters", kind="integer")

    @property
    def out_size(self) -> Size:
        """Width and height of the turned sensor, px."""
        width, height = self.sensor_size
        return (height, width) if self.turns % 2 else (width, height)

    def _part(self, events: Events) -> Events:
        right, bottom = np.uint16(self.sensor_size[0] - 1), np.uint16(self.sensor_size[1] - 1)
        x, y, turns = events.x, events.y, self.turns % 4
        if turns in (1, 2):
            x = right - x
        if turns in (2, 3):
            y = bottom - y
        return self._of(events, (events.t, y, x, events.p) if turns % 2 else (events.t, x, y, events.p))


@dataclass(frozen=True, eq=False)
class Crop(Sieve):
    """Keep events of a rectangle.

    Attributes:
        x: first column and the column after the last, px; None keeps all.
        y: first row and the row after the last, px; None keeps all.
        move: whether the rectangle becomes the sensor, with its upper left pixel at (0, 0); otherwise events stay
            where they are and so does the sensor's size.
    """

    word = "crop"
    units = {"x": "px", "y": "px"}
    x: tuple[int, int] | None = None
    y: tuple[int, int] | None = None
    move: bool = True

    def _check(self) -> None:
        for name, limit in zip("xy", self.sensor_size, strict=True):
            sides = getattr(self, name) or (0, limit)
            whole = len(sides) == 2 and all(isinstance(side, int | np.integer) for side in sides)
            right = whole and 0 <= sides[0] < sides[1] <= limit
            self._expect(right, name, sides, f"(first, after the last) within 0 to {limit} px")
            object.__setattr__(self, name, (int(sides[0]), int(sides[1])))

    @property
    def out_size(self) -> Size:
        """Width and height of the events that come out, px."""
        assert self.x is not None
        assert self.y is not None
        return (self.x[1] - self.x[0], self.y[1] - self.y[0]) if self.move else self.sensor_size

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        keep.fill(True)
        for values, sides, limit in zip((events.x, events.y), (self.x, self.y), self.sensor_size, strict=True):
            assert sides is not None
            if sides[0] > 0:
                keep &= values >= sides[0]
            if sides[1] < limit:
                keep &= values < sides[1]

    def _part(self, events: Events) -> Events:
        keep = np.empty(len(events), np.bool_)
        self._keep(events, keep)
        t, x, y, p = kept(events, keep)
        if self.move:
            assert self.x is not None
            assert self.y is not None
            x, y = x - np.uint16(self.x[0]), y - np.uint16(self.y[0])
        return self._of(events, (t, x, y, p))


@dataclass(frozen=True, eq=False)
class Downsample(Filter):
    """Join blocks of pixels to one.

    A block adds up its events, ON as +1 and OFF as -1. When the sum reaches `integrate` or its negative, the block
    sends an event of that sign at the time of the last one, and begins at 0. With 1 every event passes.

    Attributes:
        factor: columns and rows of a block, or one number for both, px.
        integrate: net events of a block that make one of its own; columns times rows is what one pixel that sees the
            mean log intensity of the block would send.

    Source: equations 20-21 of the thesis, averaged over a block; Cohen et al., Spatial and temporal downsampling
        in event-based visual classification, IEEE TNNLS, 2018, for downsampling without the sum.
    """

    word = "downsample"
    units = {"factor": "px"}
    factor: int | tuple[int, int] = 2
    integrate: int = quantity(1, "events", kind="integer", at_least=1)

    def _check(self) -> None:
        factors = self.factor if isinstance(self.factor, tuple) else (self.factor, self.factor)
        right = len(factors) == 2 and all(isinstance(f, int | np.integer) and f >= 1 for f in factors)
        self._expect(right, "factor", self.factor, "a whole number >= 1 or a pair of them")
        object.__setattr__(self, "factor", factors)

    @property
    def out_size(self) -> Size:
        """Blocks across and down; those at the right and lower edge may be cut."""
        assert isinstance(self.factor, tuple)
        return -(-self.sensor_size[0] // self.factor[0]), -(-self.sensor_size[1] // self.factor[1])

    def _fresh(self) -> State:
        width, height = self.out_size
        return (np.zeros((height, width), np.int64),)

    def _part(self, events: Events) -> Events:
        from neuro.events.filters._kernels import join

        assert isinstance(self.factor, tuple)
        columns, rows = (_places(n, f) for n, f in zip(self.sensor_size, self.factor, strict=True))
        out = tuple(np.empty(len(events), kind) for kind in (np.int64, np.uint16, np.uint16, np.uint8))
        n = join(events.t, events.x, events.y, events.p, columns, rows, self.integrate, self._state[0], *out)
        return self._of(events, tuple(values[:n] for values in out))


def _places(pixels: int, factor: int) -> np.ndarray[tuple[int], np.dtype[np.uint16]]:
    """The block of each column or row."""
    return (np.arange(pixels) // factor).astype(np.uint16)
