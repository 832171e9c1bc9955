"""Running slices on several threads; every slice ends in a barrier."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

from neuro.program import Ints
from neuro_event import loop

PERIOD = 512
"""Slices after which it is tried again whether one thread or all are faster."""

TRIED = 8
"""Slices that each way is tried for."""


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
        self._seconds = [0.0, 0.0]

    def run(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run the steps first:last; return where there was no room to go on, or `last`."""
        if self._pool is None:
            return int(loop.run(view, first, last, longest, reach, h))
        step = first
        while step < last:
            steps = int(loop.has_room(view, step, min(longest, last - step), reach))
            if steps < 1:
                return step
            phase = self._slices % PERIOD // TRIED
            if phase >= 2 and not self._together:
                step += self._alone(view, step, last, longest, reach, h)
            else:
                self._slice(phase, view, step, step + steps, h)
                step += steps
        for thread in range(self._n):
            loop.finish(view, thread, last - 1, h)
        return last

    def _alone(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run the rest of the period on this thread; return the steps done."""
        left = (PERIOD - self._slices % PERIOD) * longest
        reached = int(loop.run(view, first, min(last, first + left), longest, reach, h))
        self._slices += max(1, (reached - first) // longest)
        return reached - first

    def _slice(self, phase: int, view: Ints, first: int, last: int, h: float) -> None:
        """One slice: on all threads, or in phase 1 on this one; the first two phases tell which is faster."""
        began = time.perf_counter()
        if phase == 1:
            for thread in range(self._n):
                loop.run_slice(view, thread, first, last, h)
        else:
            self._share(view, first, last, h)
        if phase < 2:
            self._seconds[phase] += time.perf_counter() - began
        self._slices += 1
        if self._slices % PERIOD == 2 * TRIED:
            self._together = self._seconds[0] < self._seconds[1]
            self._seconds = [0.0, 0.0]

    def _share(self, view: Ints, first: int, last: int, h: float) -> None:
        assert self._pool is not None
        others = [self._pool.submit(loop.run_slice, view, k, first, last, h) for k in range(1, self._n)]
        loop.run_slice(view, 0, first, last, h)
        for other in others:
            other.result()
