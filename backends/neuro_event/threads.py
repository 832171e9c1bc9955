"""Running slices on several threads. No spike needs less than a slice to arrive, so a slice needs no exchange."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from neuro_event import loop

FEWEST, MOST = 4, 64
"""Slices for which each way is tried, twice in turn."""

TRIAL = 1e-2
"""Seconds that a trial takes about, so that it is not the start of the threads and their caches that is measured."""

KEPT, LONGEST = 32, 1 << 16
"""A choice is kept for so many times the slices of a trial, and for twice as many each time that it is the same."""

LATEST = 2.0
"""Seconds after which it is tried again at the latest where slices are long: others may have been in the way."""

REST = 1e-6
"""Seconds for which a thread sleeps at least that has waited for others in vain."""

LINE = 8
"""Numbers of a cache line, so that threads tell each other their steps in lines of their own."""


class Threads:
    """Runs the loop on n threads, or all parts on one where slices are too short to be worth meeting after each.

    The result is the same, so the faster way is found by trying.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._pool = ThreadPoolExecutor(n - 1) if n > 1 else None
        self._told = np.zeros((n + 1, LINE), dtype=np.int64)
        self._together = True
        self._kept = 0
        self._left = 0
        self._tried = FEWEST
        self._trials: list[tuple[bool, float]] = []

    def run(self, view: int, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run the steps first:last; return where there was no room for a whole slice, or `last`."""
        if self._pool is None:
            return int(loop.run(view, first, last, longest, reach, h))
        step = first
        while step < last:
            trying = self._left == 0
            together = len(self._trials) % 2 == 0 if trying else self._together
            slices = self._tried if trying else self._left
            end = min(last, step + slices * longest)
            began = time.perf_counter()
            reached = (self._share if together else loop.run)(view, step, end, longest, reach, h)
            done = int(reached) - step
            if trying and done > 0:
                self._weigh(together, (time.perf_counter() - began) * longest / done)
            elif not trying:
                self._left = max(0, self._left - -(-done // longest))
            step += done
            if step < end:
                break
        for thread in range(self._n):
            loop.finish(view, thread, step - 1, h)
        return step

    def _weigh(self, together: bool, seconds: float) -> None:
        """Keep what a slice took in one way; after the fourth trial the way that was faster once is chosen."""
        self._trials.append((together, seconds))
        self._tried = min(max(int(TRIAL / seconds), FEWEST), MOST)
        if len(self._trials) == 4:
            faster, least = min(self._trials, key=lambda trial: trial[1])
            shortest = KEPT * self._tried
            most = max(shortest, min(LONGEST, int(LATEST / least)))
            self._kept = min(max(2 * self._kept, shortest), most) if faster == self._together else shortest
            self._together, self._left, self._trials = faster, self._kept, []

    def _share(self, view: int, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run on all threads; return the step that was reached."""
        assert self._pool is not None
        self._told[:, 0] = first
        given = (view, last, longest, reach, h)
        others = [self._pool.submit(self._work, thread, *given) for thread in range(1, self._n)]
        try:
            self._work(0, *given)
        finally:
            self._told[self._n, 0] = loop.HALT
            for other in others:
                other.result()
        return int(self._told[0, 0])

    def _work(self, thread: int, view: int, last: int, longest: int, reach: int, h: float) -> None:
        """One thread's part, which rests where it waits for long."""
        while not loop.share(view, self._told, thread, last, longest, reach, h):
            time.sleep(REST)
