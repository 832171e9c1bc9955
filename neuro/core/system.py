"""The machine and the processes on it: cores, parts of Linux alone, processes of mpirun, threads, the collector."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from neuro.core.errors import ModelError


def usable_cores() -> int:
    """How many cores this process may use; where the system does not say, all that there are."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def only_on_linux(what: str) -> None:
    """Refuse a part that needs interfaces of Linux.

    Args:
        what: the part, the subject of the message.

    Raises:
        ModelError: this is another system.
    """
    if sys.platform != "linux":
        raise ModelError(f"{what} needs Linux: found the system '{sys.platform}'")


# Processes that mpirun started work together only on a backend that is distributed. Elsewhere, as in a sweep of
# independent runs, each tells its own mistakes and writes the files that it was asked to write.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
_LOCAL_SIZES = ("OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS")
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK")
_shared = False


def processes() -> int:
    """How many there are; 1 without mpirun."""
    return max(1, _first(_SIZES))


def neighbours() -> int:
    """How many of them are on this machine."""
    return min(processes(), max(1, _first(_LOCAL_SIZES)))


def leads() -> bool:
    """Whether this one is the first of those that work together."""
    return _first(_RANKS) == 0


def share() -> None:
    """From now on one of the processes speaks and writes for all: they work on one thing."""
    global _shared
    _shared = processes() > 1


def shared() -> bool:
    """Whether this is one of several processes that work on one thing."""
    return _shared


def speaks() -> bool:
    """Whether this process tells and writes what there is to tell and to write."""
    return not _shared or leads()


def _first(names: tuple[str, ...]) -> int:
    return next((int(os.environ[name]) for name in names if os.environ.get(name, "").isdigit()), 0)


T = TypeVar("T")
R = TypeVar("R")


def mapped(function: Callable[[T], R], items: Sequence[T], threads: int) -> Iterator[R]:
    """What a function gives for each item, in order; all are begun at once, on so many threads, with 1 one by one.

    Raises:
        Exception: what the function raises for the first item for which it does.
    """
    if threads == 1 or len(items) < 2:
        yield from map(function, items)
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(function, items)


@contextmanager
def uncollected() -> Iterator[None]:
    """Let the collector of cycles rest while millions of small things are made, at which it would look many times."""
    working = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if working:
            gc.freeze()
            gc.unfreeze()  # among the old ones, which are looked at least often
            gc.enable()
