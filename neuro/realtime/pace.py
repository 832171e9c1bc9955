"""Pace of the clock: the moments of ticks, the wait until a tick is due, and the account of late ticks."""

from __future__ import annotations

import ctypes
import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

from neuro.core.checks import argument
from neuro.core.clock import NEVER
from neuro.core.memory import free_memory
from neuro.realtime.report import Cost, Histogram, LiveRun

SPIN_NS = 60_000
"""Time in ns to stay awake before a moment, because a sleep may end late."""

_SET_TIMER_SLACK = 29
_POPULATE_WRITE = 23


def wait_until(due_ns: int) -> int:
    """Sleep until shortly before a moment of `time.monotonic_ns`, then poll the clock. Return the time after it, ns."""
    time_ns = time.monotonic_ns()
    if due_ns - time_ns > SPIN_NS:
        time.sleep((due_ns - time_ns - SPIN_NS) / 1e9)
    while time_ns < due_ns:
        time_ns = time.monotonic_ns()
    return time_ns


@contextmanager
def punctual() -> Iterator[None]:
    """Let sleeps of this thread end on time during the block, without automatic garbage collection.

    Existing objects are excluded from collections, so that collections of the loop are short. Memory that is allocated
    but has never been written is mapped first.
    """
    was_on = gc.isenabled()
    gc.collect()
    _fetch_memory()
    gc.freeze()
    gc.disable()
    _timer_slack(1)
    try:
        yield
    finally:
        _timer_slack(0)
        gc.unfreeze()
        if was_on:
            gc.enable()


def _timer_slack(ns: int) -> None:
    """Set the delay in ns that Linux may add to combine wake-ups of threads; 0 restores 50,000 ns."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_TIMER_SLACK, ns, 0, 0, 0)


def _fetch_memory() -> None:
    """Map all allocated memory of this process, because the first write to a huge page of 2 MB may take 5 ms.

    Nothing is done if this would take more than half of the free memory, or before Linux 5.14.
    """
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return
    regions = []
    for line in maps.read_text().splitlines():
        span, access, _, _, inode, *path = line.split(maxsplit=5)
        if access == "rw-p" and inode == "0" and path in ([], ["[heap]"]):
            begin, end = (int(address, 16) for address in span.split("-"))
            regions.append((begin, end - begin))
    free_bytes = free_memory()
    if free_bytes is None or sum(size for _, size in regions) < free_bytes // 2:
        madvise = ctypes.CDLL(None).madvise
        for begin, size in regions:
            madvise(ctypes.c_void_p(begin), ctypes.c_size_t(size), _POPULATE_WRITE)


def empty_loop(tick_ms: float, ms: float) -> Histogram:
    """Return the histogram of the wake-up delays of a loop that does nothing.

    Args:
        tick_ms: length of a tick.
        ms: duration of the loop.

    Raises:
        ModelError: an argument is not a number > 0.
    """
    tick_ms, ms = argument("tick_ms", tick_ms, above=0), argument("ms", ms, above=0)
    times, tick = Histogram(), round(tick_ms * 1e6)
    with punctual():
        moment = time.monotonic_ns()
        for _ in range(max(1, round(ms / tick_ms))):
            moment += tick
            times.add(wait_until(moment) - moment)
    return times


LATE = ("catch_up", "skip", "stop")
"""Policies for a tick with an action after the next tick is due."""


class Pace:
    """Clock that waits for ticks at regular moments, and records the times of each tick.

    Call `wait` at the begin of a tick, `mark` at the end of each phase, and `end` at the end. The last phase is the
    action. The clock starts at `begin`, or at the end of a first tick, which is not counted.

    Args:
        account: counts and times of the run; also has the length of a tick on the clock and the names of the phases.
        late: policy for a late action, one of `LATE`.

    Attributes:
        tick: length of a tick on the clock, ns.
        due: moment when the present tick is due, ns of `time.monotonic_ns`; 0 while the clock stands.
        since: begin of the first tick after skipped ticks, ns; 0 before the first skip.
        acted: moment of the last action, ns.
    """

    def __init__(self, account: LiveRun, late: str = "catch_up") -> None:
        self.account, self._late, self.tick = account, late, round(account.tick_ms * 1e6)
        self.rest()

    def rest(self) -> None:
        """Stop the clock. The end of the next tick starts it again."""
        self.due = 0

    def begin(self) -> None:
        """Start the clock. The first tick is due after the length of a tick."""
        self.due, self.since = time.monotonic_ns() + self.tick, 0
        self._collected_at, self._cost = self.due, Cost.now()

    def wait(self) -> None:
        """Wait until the next tick is due, and begin it."""
        if (time_ns := time.monotonic_ns()) < self.due:
            time_ns = wait_until(self.due)
            self.account.empty.add(time_ns - self.due)
        self._marks = [time_ns]

    def mark(self) -> None:
        """End a phase of the tick."""
        self.acted = time.monotonic_ns()
        self._marks.append(self.acted)

    def end(self, last_tick: int = NEVER) -> str:
        """Record the times of the tick, and set the moment of the next tick.

        Args:
            last_tick: number of ticks of the run; later ticks are not skipped.

        Returns:
            The reason to stop the run; "" to continue.
        """
        if not self.due:
            self.begin()
            return ""
        account, acted = self.account, self.acted
        account.ticks += 1
        number = account.ticks + account.skipped
        phases = {word: b - a for word, (a, b) in zip(account.phases, pairwise(self._marks), strict=True)}
        for word, ns in phases.items():
            account.phases[word].add(ns)
        if acted - self.due > account.response.largest_ns:
            account.largest_tick = number, {word: ns / 1e6 for word, ns in phases.items()}
        account.response.add(acted - self.due)
        self.due += self.tick
        previous, self._cost = self._cost, Cost.now()
        cost = self._cost.since(previous)
        account.cost = account.cost.plus(cost)
        if acted - self._collected_at > 1e9:
            self._collected_at = acted
            gc.collect()
        if acted <= self.due:
            return ""
        account.misses += 1
        account.missed_cost = account.missed_cost.plus(cost)
        if self._late == "skip" and (n_skipped := min((acted - self.due) // self.tick, last_tick - number)):
            account.skipped += n_skipped
            self.due += n_skipped * self.tick
            self.since = self.due - self.tick
        return f"the action of tick {number} was {(acted - self.due) / 1e6:.3f} ms late" if self._late == "stop" else ""
