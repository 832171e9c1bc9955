"""Run slices of steps on several threads.

A slice is as long as the shortest delay. Spikes of a slice arrive later, so threads need no exchange within a slice.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from neuro.core.interrupts import AT_ONCE, end_if_stopped
from neuro.program.program import Ints
from neuro_event.loop import steps

STRETCH = 20e-3
"""Approximate duration of a stretch of slices on one thread, s. It is long compared with its end and measurement."""

GAIN = 1.1
"""Speed-up over one thread that all threads must reach. It is larger than the error of the measurement."""

SHARE = 0.02
"""Share of the time on one thread that trials with all threads may lose."""

ENOUGH, MOST = 5e-3, 20e-3
"""Limits of the budget for losses, s. All threads are tried from `ENOUGH` on, and the budget is at most `MOST`.

A stretch on all threads lasts as long as the budget, but at least `ENOUGH`, because a start takes 0.1 ms.
"""

DEBT = 2 * MOST
"""Largest debt of the budget, s. With this limit all threads are tried again at most 2.3 s after a disturbance."""

HELD = 0.8
"""Least share of a stretch in which its first thread had a core. With a smaller share the cores count as busy."""

AGAIN = 1.0
"""Seconds on all threads after which a stretch runs on one thread, to measure a slice there again."""

MIN_SLEEP_S = 1e-6
"""Shortest sleep of a thread that has waited for other threads in vain, s."""

LINE = 8
"""Number of values in a cache line. Each thread publishes its step in a cache line of its own."""


class Threads:
    """Runs the loop on n threads, or on a single thread if that is as fast, e.g. if other programs use the cores.

    A single thread and all threads give the same result, so both are tried and measured. A stretch on all threads
    costs the duration, in s, and earns the duration on a single thread divided by `GAIN`. A stretch on a single thread
    earns `SHARE` of the duration. Costs and earnings add up to a budget. All threads run while the budget is positive,
    and are tried again when the budget reaches `ENOUGH`. So trials take little time, even if others use the cores.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._pool = ThreadPoolExecutor(n - 1) if n > 1 else None
        self._process = os.getpid()
        self._progress = np.zeros((n + 1, LINE), dtype=np.int64)
        self._compiled = self._on_all = False
        self._alone_slices = self._alone_s = self._since = 0.0
        self._spare, self._slices = ENOUGH - SHARE * STRETCH, 1

    @property
    def several(self) -> bool:
        """True if there are several threads."""
        return self._pool is not None

    def run(self, view: int, first: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> int:
        """Run the steps first:last. Return `last`, or the step at which the logs had no room for a whole slice.

        `stop` is the stop request that the kernels test, see `neuro.core.interrupts`.
        """
        if self._pool is None:
            return int(steps.run(view, first, last, longest, reach, h))
        if not self._compiled:  # a run of no steps compiles the kernels, which must not be measured
            steps.run(view, first, first, longest, reach, h)
            self._share(view, first, first, longest, reach, h, stop)
            self._compiled = True
        step = first
        while step < last:
            on_all = self._on_all and self._since < AGAIN
            end = min(last, step + self._slices * longest)
            began, cpu = time.perf_counter(), time.thread_time()
            if on_all:
                reached = self._share(view, step, end, longest, reach, h, stop)
            else:
                reached = int(steps.run(view, step, end, longest, reach, h))
            advanced = reached - step
            cpu, elapsed = time.thread_time() - cpu, time.perf_counter() - began
            self._weigh(on_all, advanced / longest, elapsed, cpu < HELD * elapsed)
            step += advanced
            if step < end:
                break
        for thread in range(self._n):
            steps.finish(view, thread, step - 1, h)
        return step

    def _weigh(self, on_all: bool, slices: float, seconds: float, busy: bool) -> None:
        """Record the duration of some slices. Choose the number of threads and the length of the next stretch.

        `busy` is true if other programs used the core.
        """
        if on_all:
            self._since += seconds
            self._spare += slices * self._alone_s / self._alone_slices / GAIN - seconds
        elif slices > 0.0:
            self._since = 0.0
            self._alone_slices, self._alone_s = self._alone_slices + slices, self._alone_s + seconds
            if self._alone_s > 2.0 * STRETCH:
                self._alone_slices, self._alone_s = self._alone_slices / 2.0, self._alone_s / 2.0
            self._spare += SHARE * seconds
        self._spare = max(min(self._spare, 0.0 if busy else MOST), -DEBT)
        self._on_all = self._spare > 0.0 if self._on_all else self._spare >= ENOUGH
        if self._alone_s > 0.0:
            stretch = max(self._spare, ENOUGH) if self._on_all else STRETCH
            self._slices = max(1, int(stretch * self._alone_slices / self._alone_s))

    def _share(self, view: int, first: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> int:
        """Run a stretch on all threads. Return the step that was reached."""
        if self._process != os.getpid():  # a forked process has no copy of the threads
            self._pool, self._process = ThreadPoolExecutor(self._n - 1), os.getpid()
        assert self._pool is not None
        self._progress[:, 0] = first
        arguments = (view, last, longest, reach, h, stop)
        futures = [self._pool.submit(self._work, thread, *arguments) for thread in range(1, self._n)]
        try:
            self._work(0, *arguments)
        except BaseException:
            stop[0] = AT_ONCE  # the other threads are at other steps
            raise
        finally:
            self._progress[self._n, 0] = steps.HALT
            for future in futures:
                future.result()
        return int(self._progress[0, 0])

    def _work(self, thread: int, view: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> None:
        """Run the part of one thread. A thread sleeps if it has waited long for other threads."""
        while not steps.share(view, self._progress, thread, last, longest, reach, h):
            time.sleep(MIN_SLEEP_S)
            if thread == 0:  # handlers of signals have run during the sleep
                end_if_stopped(stop)
