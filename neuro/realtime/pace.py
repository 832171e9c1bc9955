"""The clock on the wall: waiting for a moment, and keeping Python from being elsewhere when it comes."""

from __future__ import annotations

import ctypes
import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from neuro.core.checks import argument
from neuro.core.memory import free_memory
from neuro.realtime.histogram import Histogram

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
    """How late Linux may wake this thread so as to wake several at once, 0.05 ms unless set; 0 sets that again."""
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
    """What a loop takes that does nothing: from the moment of each tick to its action.

    Args:
        tick_ms: the length of a tick.
        ms: how long.

    Raises:
        ModelError: one of them is not a number > 0.
    """
    tick_ms, ms = argument("tick_ms", tick_ms, above=0), argument("ms", ms, above=0)
    found, tick = Histogram(), round(tick_ms * 1e6)
    with punctual():
        due = time.monotonic_ns()
        for _ in range(max(1, round(ms / tick_ms))):
            due += tick
            found.add(wait_until(due) - due)
    return found
