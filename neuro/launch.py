"""The processes that mpirun started together: what each can know of itself before any library speaks MPI."""

from __future__ import annotations

import os

_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK")


def processes() -> int:
    """How many there are; 1 without mpirun."""
    return max(1, _first(_SIZES))


def leads() -> bool:
    """Whether this one speaks and writes for all."""
    return _first(_RANKS) == 0


def _first(names: tuple[str, ...]) -> int:
    return next((int(os.environ[name]) for name in names if os.environ.get(name, "").isdigit()), 0)
