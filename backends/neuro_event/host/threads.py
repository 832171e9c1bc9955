"""Running slices on several threads. No spike needs less than a slice to arrive, so a slice needs no exchange."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from neuro.core.interrupts import AT_ONCE, end_if_stopped
from neuro.program.program import Ints
from neuro_event.loop import steps

STRETCH = 20e-3
"""Seconds that a stretch on one thread takes about, after the first slice: to end and to weigh it costs nothing."""

GAIN = 1.1
"""How many times as fast as one thread all have to be, so that it is no accident of what was measured."""

SHARE = 0.02
"""Of the time on one thread, how much trials of all may lose."""

ENOUGH, MOST = 5e-3, 20e-3
"""Seconds that may be lost: with how many all threads are tried, and how many are saved up while they gain.

A stretch on all threads is as long as it may lose, or `ENOUGH`: to begin one takes a tenth of a millisecond.
"""

DEBT = 2 * MOST
"""Seconds that count at most as lost too much: whatever was in the way, all threads are tried again in 2.3 s."""

HELD = 0.8
"""Of the time of a stretch, for how much the thread that began it has a core at least; else cores are busy."""

AGAIN = 1.0
"""Seconds on all threads after which a stretch is run on one, to know what a slice takes there now."""

REST = 1e-6
"""Seconds for which a thread sleeps at least that has waited for others in vain."""

LINE = 8
"""Numbers of a cache line, so that threads tell each other their steps in lines of their own."""


class Threads:
    """Runs the loop on n threads, or all parts on one where that is as fast, as it is where others use the cores.

    The result is the same, so both are tried. What all threads lose to one, or gain less than `GAIN`, is taken from
    what may be lost; they run while there is some, and are tried again when there is enough. So little of the time is
    lost to trials, whatever others do.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._pool = ThreadPoolExecutor(n - 1) if n > 1 else None
        self._process = os.getpid()
        self._progress = np.zeros((n + 1, LINE), dtype=np.int64)
        self._begun = self._together = False
        self._alone_slices = self._alone_s = self._since = 0.0
        self._spare, self._slices = ENOUGH - SHARE * STRETCH, 1

    @property
    def several(self) -> bool:
        """Return whether there is more than one thread."""
        return self._pool is not None

    def run(self, view: int, first: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> int:
        """Run the steps first:last; return where there was no room for a whole slice, or `last`.

        `stop` is what the kernels look at, see `neuro.core.interrupts`.
        """
        if self._pool is None:
            return int(steps.run(view, first, last, longest, reach, h))
        if not self._begun:  # no steps: the kernels are compiled, which is not to be weighed
            steps.run(view, first, first, longest, reach, h)
            self._share(view, first, first, longest, reach, h, stop)
            self._begun = True
        step = first
        while step < last:
            together = self._together and self._since < AGAIN
            end = min(last, step + self._slices * longest)
            began, cpu = time.perf_counter(), time.thread_time()
            if together:
                reached = self._share(view, step, end, longest, reach, h, stop)
            else:
                reached = int(steps.run(view, step, end, longest, reach, h))
            done = reached - step
            cpu, taken = time.thread_time() - cpu, time.perf_counter() - began
            self._weigh(together, done / longest, taken, cpu < HELD * taken)
            step += done
            if step < end:
                break
        for thread in range(self._n):
            steps.finish(view, thread, step - 1, h)
        return step

    def _weigh(self, together: bool, slices: float, seconds: float, busy: bool) -> None:
        """Enter what some slices took, and whether others used the core; choose how the next are run, and how many."""
        if together:
            self._since += seconds
            self._spare += slices * self._alone_s / self._alone_slices / GAIN - seconds
        elif slices > 0.0:
            self._since = 0.0
            self._alone_slices, self._alone_s = self._alone_slices + slices, self._alone_s + seconds
            if self._alone_s > 2.0 * STRETCH:
                self._alone_slices, self._alone_s = self._alone_slices / 2.0, self._alone_s / 2.0
            self._spare += SHARE * seconds
        self._spare = max(min(self._spare, 0.0 if busy else MOST), -DEBT)
        self._together = self._spare > 0.0 if self._together else self._spare >= ENOUGH
        if self._alone_s > 0.0:
            stretch = max(self._spare, ENOUGH) if self._together else STRETCH
            self._slices = max(1, int(stretch * self._alone_slices / self._alone_s))

    def _share(self, view: int, first: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> int:
        """Run on all threads; return the step that was reached."""
        if self._process != os.getpid():  # a process that was forked has none of the threads
            self._pool, self._process = ThreadPoolExecutor(self._n - 1), os.getpid()
        assert self._pool is not None
        self._progress[:, 0] = first
        given = (view, last, longest, reach, h, stop)
        others = [self._pool.submit(self._work, thread, *given) for thread in range(1, self._n)]
        try:
            self._work(0, *given)
        except BaseException:
            stop[0] = AT_ONCE  # the others are somewhere else
            raise
        finally:
            self._progress[self._n, 0] = steps.HALT
            for other in others:
                other.result()
        return int(self._progress[0, 0])

    def _work(self, thread: int, view: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> None:
        """One thread's part, which rests where it waits for long."""
        while not steps.share(view, self._progress, thread, last, longest, reach, h):
            time.sleep(REST)
            if thread == 0:  # a handler of a signal has had its turn
                end_if_stopped(stop)
