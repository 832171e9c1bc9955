"""The processes that run one network together, under MPI; one where there is none."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.errors import ModelError

LAUNCHERS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
BUILD = (
    "apt-get install openmpi-bin libopenmpi-dev libgsl-dev, then "
    "pip install --no-binary nest-simulator -C cmake.define.with-mpi=ON -C cmake.build-type=Release "
    "nest-simulator mpi4py"
)


def started() -> int:
    """How many processes mpirun has started; 1 without it."""
    return max(int(os.environ.get(name, "1") or "1") for name in LAUNCHERS)


class Ranks:
    """All processes of a run. Every one calls the same methods in the same order.

    Args:
        size: how many there are.
        rank: which one this is.
    """

    def __init__(self, size: int, rank: int) -> None:
        self.size, self.rank = size, rank
        self._world: Any = None
        if size > 1:
            try:
                from mpi4py import MPI
            except ImportError:
                raise ModelError("NEST under MPI needs mpi4py, which is not installed", hint=BUILD) from None
            self._world = MPI.COMM_WORLD

    def gather(self, values: NDArray[Any]) -> NDArray[Any]:
        """The arrays of all processes, joined along the first axis, in each of them."""
        return values if self.size == 1 else np.concatenate(self._world.allgather(values))

    def total(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """The sum over all processes, in each of them."""
        summed: NDArray[np.int64] = numbers if self.size == 1 else sum(self._world.allgather(numbers))
        return summed


def check(with_mpi: bool) -> None:
    """Refuse several processes where NEST knows only one."""
    if started() > 1 and not with_mpi:
        raise ModelError(
            f"mpirun started {started()} processes, but this NEST was built without MPI: each would run all", hint=BUILD
        )
