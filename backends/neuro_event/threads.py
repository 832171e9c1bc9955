"""Running slices on several threads; every slice ends in a barrier."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from statistics import median

from neuro.program.program import Ints
from neuro_event import loop

PERIOD = 128
"""Slices after which it is tried again whether one thread or all are faster."""

TRIED = 8
"""Slices for which the two ways are tried in turn."""


class Threads:
    """Runs the loop on n threads. No spike needs less than a slice to arrive, so a slice needs no exchange.

    The result is the same on one thread. So where slices are too short to be worth the barrier, as with a delay
    of one step in a small network, one thread runs all parts.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._pool = ThreadPoolExecutor(n - 1) if n > 1 else None
        self._slices = 0
        self._together = True
        self._seconds: tuple[list[float], list[float]] = ([], [])

    def run(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run the steps first:last; return where there was no room for a whole slice, or `last`."""
        if self._pool is None:
            return int(loop.run(view, first, last, longest, reach, h))
        step = first
        while step < last:
            steps = int(loop.has_room(view, step, min(longest, last - step), reach))
            if steps < 1 or (steps < min(longest, last - step) and step > first):
                return step
            if self._slices % PERIOD < TRIED:
                self._try(view, step, step + steps, h)
                step += steps
            elif self._together:
                self._share(view, step, step + steps, h)
                step += steps
            else:
                step += self._alone(view, step, last, longest, reach, h)
        for thread in range(self._n):
            loop.finish(view, thread, last - 1, h)
        return last

    def _alone(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run the rest of the period on this thread; return the steps done."""
        left = (PERIOD - self._slices % PERIOD) * longest
        reached = int(loop.run(view, first, min(last, first + left), longest, reach, h))
        self._slices += max(1, (reached - first) // longest)
        return reached - first

    def _try(self, view: Ints, first: int, last: int, h: float) -> None:
        """One slice, on all threads or on this one in turn; then the way with the lower median is kept."""
        way = self._slices % 2
        began = time.perf_counter()
        if way == 0:
            self._share(view, first, last, h)
        else:
            for thread in range(self._n):
                loop.run_slice(view, thread, first, last, h)
            self._slices += 1
        self._seconds[way].append(time.perf_counter() - began)
        if self._slices % PERIOD == TRIED:
            self._together = median(self._seconds[0]) < median(self._seconds[1])
            self._seconds = ([], [])

    def _share(self, view: Ints, first: int, last: int, h: float) -> None:
        assert self._pool is not None
        others = [self._pool.submit(loop.run_slice, view, k, first, last, h) for k in range(1, self._n)]
        loop.run_slice(view, 0, first, last, h)
        for other in others:
            other.result()
        self._slices += 1
