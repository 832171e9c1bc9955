"""The processes that run one network together, under MPI; one where there is none."""

from __future__ import annotations

import os
import sys
import time
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.launch import leads, processes, share

BUILD = (
    "apt-get install openmpi-bin libopenmpi-dev libgsl-dev, then "
    "pip install --no-binary nest-simulator -C cmake.define.with-mpi=ON -C cmake.build-type=Release "
    "nest-simulator mpi4py"
)
PATIENCE_S = 1.0


class Ranks:
    """All processes of a run. Every one calls the same methods in the same order.

    Args:
        size: how many there are.
        rank: which one this is.
    """

    def __init__(self, size: int, rank: int) -> None:
        self.size, self.rank = size, rank
        self._world: Any = None if size == 1 else _world()

    def gather(self, values: NDArray[Any]) -> NDArray[Any]:
        """The arrays of all processes, joined along the first axis, in each of them."""
        return values if self.size == 1 else np.concatenate(self._world.allgather(values))


def check(with_mpi: bool) -> None:
    """Refuse several processes where NEST would run all of the network in each; else they share it."""
    share()
    if processes() > 1 and not with_mpi:
        raise ModelError(f"mpirun started {processes()} processes, but this NEST was built without MPI", hint=BUILD)


def end_all(message: str) -> NoReturn:
    """End all processes with one message: one that fails alone would leave the others waiting for ever.

    Where all fail alike the first speaks; the others give it the time to.
    """
    if not leads():
        time.sleep(PATIENCE_S)
    print(f"error: {message}", file=sys.stderr, flush=True)
    _world().Abort(2)
    os._exit(2)


def _world() -> Any:
    try:
        from mpi4py import MPI
    except ImportError:
        raise ModelError("NEST under MPI needs mpi4py, which is not installed", hint=BUILD) from None
    return MPI.COMM_WORLD
