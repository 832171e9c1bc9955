"""The machine and its processes: cores, interfaces of Linux, processes of mpirun, threads, the collector."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from neuro.core.errors import ModelError


def usable_cores() -> int:
    """Return the number of cores that this process may use; all cores if the system gives no number."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def only_on_linux(subject: str) -> None:
    """Refuse a part that needs Linux on other systems.

    Args:
        subject: name of the part, for the message.

    Raises:
        ModelError: the system is not Linux.
    """
    if sys.platform != "linux":
        raise ModelError(f"{subject} needs Linux: found the system '{sys.platform}'")


# Processes started by mpirun work together only on a distributed backend. Otherwise, e.g. in a sweep of independent
# runs, every process reports errors and writes files.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
_LOCAL_SIZES = ("OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS")
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK")
_shared = False


def processes() -> int:
    """Return the number of processes of mpirun; 1 without mpirun."""
    return max(1, _first(_SIZES))


def neighbours() -> int:
    """Return the number of processes of mpirun on this machine."""
    return min(processes(), max(1, _first(_LOCAL_SIZES)))


def leads() -> bool:
    """Return True in the first process of mpirun, and without mpirun."""
    return _first(_RANKS) == 0


def share() -> None:
    """Declare that all processes of mpirun work on one network, so that only the leading process reports and writes."""
    global _shared
    _shared = processes() > 1


def shared() -> bool:
    """Return True if several processes work on one network."""
    return _shared


def speaks() -> bool:
    """Return True if this process reports and writes files."""
    return not _shared or leads()


def _first(names: tuple[str, ...]) -> int:
    return next((int(os.environ[name]) for name in names if os.environ.get(name, "").isdigit()), 0)


T = TypeVar("T")
R = TypeVar("R")


def mapped(function: Callable[[T], R], items: Sequence[T], threads: int) -> Iterator[R]:
    """Yield the result of a function for each item, in order; all items run at once on `threads` threads.

    Raises:
        Exception: the exception of the first item whose call failed.
    """
    if threads == 1 or len(items) < 2:
        yield from map(function, items)
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(function, items)


@contextmanager
def uncollected() -> Iterator[None]:
    """Stop Python's garbage collector while millions of small objects are made. A collection checks them all."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.freeze()
            gc.unfreeze()  # moves the objects to the oldest generation, which the collector checks least often
            gc.enable()
