"""Filters that move events to other positions or times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule, key
from neuro.extend import quantity
from neuro_events._events import Events, empty_columns
from neuro_events.filters._filter import Filter, FilterError, Sieve, Size, State
from neuro_events.parts import joined_parts

kernels = LazyModule("neuro_events._kernels")


@dataclass(frozen=True, eq=False)
class Flip(Filter):
    """Mirror the sensor.

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
        """Height and width of the input sensor, px."""
        return self.sensor_size[1], self.sensor_size[0]

    def _part(self, events: Events) -> Events:
        return self._of(events, (events.t, events.y, events.x, events.p))


@dataclass(frozen=True, eq=False)
class Rotate90(Filter):
    """Rotate the sensor by right angles.

    Attributes:
        turns: number of quarter turns, counter-clockwise as seen (``numpy.rot90(frame, turns)``).
    """

    word = "rotate"
    turns: int = quantity(1, "quarters", kind="integer")

    @property
    def out_size(self) -> Size:
        """Width and height of the rotated sensor, px."""
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
    """Keep the events of a rectangle.

    Attributes:
        x: first column and end column (exclusive), px. None: all columns.
        y: first row and end row (exclusive), px. None: all rows.
        move: make the rectangle the new sensor, with its upper left pixel at (0, 0). False keeps the positions and the
            sensor size.
    """

    word = "crop"
    units = {"x": "px", "y": "px"}
    x: tuple[int, int] | None = None
    y: tuple[int, int] | None = None
    move: bool = True

    def _check(self) -> None:
        for name, limit in zip("xy", self.sensor_size, strict=True):
            sides = getattr(self, name) or (0, limit)
            is_pair = len(sides) == 2 and all(isinstance(side, int | np.integer) for side in sides)
            is_valid = is_pair and 0 <= sides[0] < sides[1] <= limit
            self._expect(is_valid, name, sides, f"(first, after the last) within 0 to {limit} px")
            object.__setattr__(self, name, (int(sides[0]), int(sides[1])))

    @property
    def out_size(self) -> Size:
        """Width and height of the output sensor, px."""
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
        cropped = super()._part(events)
        if not self.move:
            return cropped
        assert self.x is not None
        assert self.y is not None
        x, y = cropped.x - np.uint16(self.x[0]), cropped.y - np.uint16(self.y[0])
        return self._of(events, (cropped.t, x, y, cropped.p))


@dataclass(frozen=True, eq=False)
class Downsample(Filter):
    """Merge blocks of pixels into one pixel each.

    Each block sums its events, ON as +1 and OFF as -1. When the sum reaches `integrate` or -`integrate`, the block
    emits an event with the sign of the sum at the time of the last event, and the sum is reset to 0. With
    ``integrate=1`` every event passes.

    Attributes:
        factor: columns and rows of a block, px, or one number for both.
        integrate: net number of events in a block for one output event. If it is the number of pixels in a block, the
            block behaves like one pixel that sees the block's mean log intensity.

    Source: equations 20-21 of the thesis, averaged over a block; Cohen et al., Spatial and temporal downsampling
        in event-based visual classification, IEEE TNNLS, 2018, for downsampling without the sum.
    """

    word = "downsample"
    units = {"factor": "px"}
    factor: int | tuple[int, int] = 2
    integrate: int = quantity(1, "events", kind="integer", at_least=1)

    def _check(self) -> None:
        factors = self.factor if isinstance(self.factor, tuple) else (self.factor, self.factor)
        is_valid = len(factors) == 2 and all(isinstance(f, int | np.integer) and f >= 1 for f in factors)
        self._expect(is_valid, "factor", self.factor, "a whole number >= 1 or a pair of them")
        object.__setattr__(self, "factor", factors)

    @property
    def out_size(self) -> Size:
        """Number of blocks across and down. Blocks at the right and lower edges may be incomplete."""
        assert isinstance(self.factor, tuple)
        return -(-self.sensor_size[0] // self.factor[0]), -(-self.sensor_size[1] // self.factor[1])

    def _fresh(self) -> State:
        width, height = self.out_size
        return (np.zeros((height, width), np.int64),)

    def _part(self, events: Events) -> Events:
        assert isinstance(self.factor, tuple)
        sides = zip(self.sensor_size, self.factor, strict=True)
        columns, rows = ((np.arange(pixels) // factor).astype(np.uint16) for pixels, factor in sides)
        out = empty_columns(len(events))
        n = kernels.join(events._columns, columns, rows, self.integrate, self._state[0], out)
        return self._of(events, tuple(values[:n] for values in out))


@dataclass(frozen=True, eq=False)
class Shift(Filter):
    """Shift all times by a constant.

    Attributes:
        by_us: shift, us; negative: to earlier times.
        to_us: new time of the first event of the recording, us, instead of `by_us`.
    """

    word = "shift"
    by_us: int = quantity(0, kind="microseconds")
    to_us: int | None = quantity(None, kind="microseconds")

    def _check(self) -> None:
        if self.to_us is not None:
            self._expect(self.by_us == 0, "by_us", self.by_us, "0 if to_us is given")

    def _fresh(self) -> State:
        return (self.by_us if self.to_us is None else None,)

    def _part(self, events: Events) -> Events:
        (offset,) = self._state
        if offset is None:
            assert self.to_us is not None
            offset = self.to_us - int(events.t[0])
            self._hold(offset)
        for end in (int(events.t[0]), int(events.t[-1])):
            if not -(1 << 63) <= end + offset < 1 << 63 or abs(offset) >= 1 << 63:
                raise FilterError(f"Shift: {end} us moved by {offset} us, expected a time within 64 bits")
        return self._of(events, (events.t + np.int64(offset), events.x, events.y, events.p))


EXACT = 1 << 53
"""Limit below which float64 represents whole numbers exactly."""


@dataclass(frozen=True, eq=False)
class Scale(Filter):
    """Stretch the times from an origin.

    A time becomes ``origin + (t - origin) factor``, rounded to whole us (half to even).

    Attributes:
        factor: stretch factor; above 1 is slow motion.
        origin_us: time that the filter does not change, us. None: the time of the recording's first event.
    """

    word = "scale"
    factor: float = quantity(1.0, above=0)
    origin_us: int | None = quantity(None, kind="microseconds")

    def _fresh(self) -> State:
        return (self.origin_us,)

    def _part(self, events: Events) -> Events:
        (origin,) = self._state
        if origin is None:
            origin = int(events.t[0])
            self._hold(origin)
        for end in (int(events.t[0]), int(events.t[-1])):
            if abs(end - origin) * max(1.0, self.factor) >= EXACT:
                raise FilterError(
                    f"Scale: {end} us is too far from the origin at {origin} us for a factor of {self.factor}, "
                    "expected a product below 2^53 us, which is exact"
                )
        t = np.rint((events.t - origin) * self.factor).astype(np.int64) + origin
        return self._of(events, (t, events.x, events.y, events.p))


@dataclass(frozen=True, eq=False)
class Reverse(Filter):
    """Play a recording backwards. The recording begins and ends at the same times as before.

    All events are held until `finish`, so the memory is not constant.

    Attributes:
        invert: exchange ON and OFF, since a rise in brightness played backwards is a fall.
    """

    word = "reverse"
    invert: bool = True

    def _part(self, events: Events) -> Events:
        self._hold(*self._state, events)
        return events[:0]

    def _rest(self) -> Events:
        if not self._state:
            return super()._rest()
        events = joined_parts(list(self._state))
        t = events.t[0] + (events.t[-1] - events.t[::-1])
        p = 1 - events.p if self.invert else events.p
        return self._of(events, (t, *(np.ascontiguousarray(a[::-1]) for a in (events.x, events.y, p))))


@dataclass(frozen=True, eq=False)
class Jitter(Filter):
    """Add a random whole number of us to each time, and sort again.

    Offsets from ``-amount_us`` to ``amount_us`` are equally likely (standard deviation about ``amount_us / 1.73``). The
    offset of an event depends only on the seed and on the event's number in the recording. An event is held back until
    no later event can precede it; `finish` returns the last ones. Events at equal times keep their order.

    Attributes:
        amount_us: largest offset, us.
        seed: seed of the offsets, not negative.
    """

    word = "jitter"
    amount_us: int = quantity(100, kind="microseconds", at_least=0)
    seed: int = quantity(0, kind="integer", at_least=0, at_most=2**63 - 1)

    def _fresh(self) -> State:
        return 0, ()

    def _part(self, events: Events) -> Events:
        n_events, pending = self._state
        t = np.empty(len(events), np.int64)
        kernels.shake(events.t, np.uint64(key(self.seed, "events", "jitter")), n_events, self.amount_us, t)
        shaken = joined_parts([*pending, self._of(events, (t, events.x, events.y, events.p))])
        order = stable_order(shaken.t)
        ordered = self._of(events, (shaken.t[order], shaken.x[order], shaken.y[order], shaken.p[order]))
        n = int(np.searchsorted(ordered.t, int(events.t[-1]) - self.amount_us, side="right"))
        self._hold(n_events + len(events), (ordered[n:],))
        return ordered[:n]

    def _rest(self) -> Events:
        _, pending = self._state
        return pending[0] if pending else super()._rest()


def stable_order(t: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the stable order of times by radix sort, which is faster than a comparison sort for short spans.

    Args:
        t: (n,) us, n > 0.
    """
    lowest = int(t.min())
    order, buffer, counts = np.arange(t.size), np.empty(t.size, np.int64), np.empty(1 << kernels.DIGIT, np.int64)
    for shift in range(0, (int(t.max()) - lowest).bit_length(), kernels.DIGIT):
        kernels.by_digit(t, lowest, shift, order, counts, buffer)
        order, buffer = buffer, order
    return order
