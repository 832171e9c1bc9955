"""Fewer, larger pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events._events import Events
from neuro.events.filters._filter import Filter, Size, State, _is_whole


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
    units = {"factor": "px", "integrate": "events"}
    factor: int | tuple[int, int] = 2
    integrate: int = 1

    def _check(self) -> None:
        factors = self.factor if isinstance(self.factor, tuple) else (self.factor, self.factor)
        right = len(factors) == 2 and all(_is_whole(f) and f >= 1 for f in factors)
        self._expect(right, "factor", self.factor, "a whole number >= 1 or a pair of them")
        object.__setattr__(self, "factor", factors)
        self._expect_whole("integrate", 1, " events")

    @property
    def out_size(self) -> Size:
        """Blocks across and down; those at the right and lower edge may be cut."""
        assert isinstance(self.factor, tuple)
        return -(-self.sensor_size[0] // self.factor[0]), -(-self.sensor_size[1] // self.factor[1])

    def _fresh(self) -> State:
        width, height = self.out_size
        return (np.zeros((height, width), np.int64),)

    def _part(self, events: Events) -> Events:
        from neuro.events.filters._downsample_kernel import join

        assert isinstance(self.factor, tuple)
        columns, rows = (_places(n, f) for n, f in zip(self.sensor_size, self.factor, strict=True))
        out = tuple(np.empty(len(events), kind) for kind in (np.int64, np.uint16, np.uint16, np.uint8))
        n = join(events.t, events.x, events.y, events.p, columns, rows, int(self.integrate), self._state[0], *out)
        return self._of(events, tuple(values[:n] for values in out))


def _places(pixels: int, factor: int) -> np.ndarray[tuple[int], np.dtype[np.uint16]]:
    """The block of each column or row."""
    return (np.arange(pixels) // factor).astype(np.uint16)
