"""The processes that mpirun started together: what each can know of itself before any library speaks MPI.

Processes started together work together only on a backend that is distributed. Elsewhere, as in a sweep of
independent runs, each is its own: it tells its own mistakes and writes the files that it was asked to write.
"""

from __future__ import annotations

import os

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
