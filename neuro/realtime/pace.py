"""The pace of the clock: the moments of ticks, the wait until a tick is due, and the account of late ticks."""

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
"""Before a moment so much time is spent awake: a sleep may end later than asked for."""

_SET_TIMER_SLACK = 29
_POPULATE_WRITE = 23


def wait_until(due_ns: int) -> int:
    """Sleep until shortly before a moment of `time.monotonic_ns`, then look at the clock; the moment of return, ns."""
    now = time.monotonic_ns()
    if due_ns - now > SPIN_NS:
        time.sleep((due_ns - now - SPIN_NS) / 1e9)
    while now < due_ns:
        now = time.monotonic_ns()
    return now


@contextmanager
def punctual() -> Iterator[None]:
    """Let sleeps of this thread end on time, and no garbage be collected unasked, within the block.

    What is in memory already is left out of collections, so that those of the loop are short. Memory that was asked for
    and never written is fetched before.
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
    """Set how late Linux may wake this thread so as to wake several at once; 0 sets 0.05 ms again."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_TIMER_SLACK, ns, 0, 0, 0)


def _fetch_memory() -> None:
    """Let all memory of this process be there: the first write to a huge page, of 2 MB, may wait 5 ms for it.

    Where that would take more than half of what is free, and on systems before Linux 5.14, nothing is done.
    """
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return
    places = []
    for line in maps.read_text().splitlines():
        span, access, _, _, inode, *path = line.split(maxsplit=5)
        if access == "rw-p" and inode == "0" and path in ([], ["[heap]"]):
            first, end = (int(each, 16) for each in span.split("-"))
            places.append((first, end - first))
    free = free_memory()
    if free is None or sum(size for _, size in places) < free // 2:
        madvise = ctypes.CDLL(None).madvise
        for first, size in places:
            madvise(ctypes.c_void_p(first), ctypes.c_size_t(size), _POPULATE_WRITE)


def empty_loop(tick_ms: float, ms: float) -> Histogram:
    """Measure a loop that does nothing: the times from the moment of each tick to the awakening.

    Args:
        tick_ms: the length of a tick.
        ms: how long.

    Raises:
        ModelError: one of them is not a number > 0.
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
"""Policies for a tick whose action comes after the next tick is due."""


class Pace:
    """Ticks that are due one after the other, and the account of the time of each.

    A tick is `wait`, then `mark` at the end of each phase, then `end`. The last phase is the action. The clock starts
    by `begin`, or at the end of a tick that is not counted.

    Args:
        account: counts ticks; has the length of a tick on the clock, and the names of its phases.
        late: the policy for a late action, one of `LATE`.

    Attributes:
        tick: the length of a tick on the clock in ns.
        due: the moment when the present tick is due, ns of `time.monotonic_ns`.
        since: the moment after the last ticks that were skipped.
        acted: the moment of the last action.
    """

    def __init__(self, account: LiveRun, late: str = "catch_up") -> None:
        self.account, self._late, self.tick = account, late, round(account.tick_ms * 1e6)
        self.rest()

    def rest(self) -> None:
        """Let the clock stand until the end of the next tick."""
        self.due = 0

    def begin(self) -> None:
        """Let the clock start now: the first tick is due after the time of one."""
        self.due, self.since = time.monotonic_ns() + self.tick, 0
        self._collected, self._cost = self.due, Cost.now()

    def wait(self) -> None:
        """Wait until the next tick is due, and begin it."""
        if (now := time.monotonic_ns()) < self.due:
            now = wait_until(self.due)
            self.account.empty.add(now - self.due)
        self._marks = [now]

    def mark(self) -> None:
        """End a phase of the tick."""
        self.acted = time.monotonic_ns()
        self._marks.append(self.acted)

    def end(self, most: int = NEVER) -> str:
        """Account for the tick, and let the next one be due; return why to go no further, or "".

        Args:
            most: ticks of the run, so that no more are skipped.
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
        before, self._cost = self._cost, Cost.now()
        cost = self._cost.since(before)
        account.cost = account.cost.plus(cost)
        if acted - self._collected > 1e9:
            self._collected = acted
            gc.collect()
        if acted <= self.due:
            return ""
        account.misses += 1
        account.missed_cost = account.missed_cost.plus(cost)
        if self._late == "skip" and (past := min((acted - self.due) // self.tick, most - number)):
            account.skipped += past
            self.due += past * self.tick
            self.since = self.due - self.tick
        return f"the action of tick {number} was {(acted - self.due) / 1e6:.3f} ms late" if self._late == "stop" else ""
