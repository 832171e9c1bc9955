"""NEST's kernel: imported without output, used by one simulation at a time, with NEST's errors raised as ours."""

from __future__ import annotations

import atexit
import gc
import os
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.system import leads, processes, share as work_together
from neuro.program.program import WHOLE, Share

T = TypeVar("T")

INSTALL = "pip install nest-simulator"
MARK_MODEL = "neuro_nest"
"""Name of a node model that marks a kernel as ours. ResetKernel removes the model."""

_holder: weakref.ref[Any] = weakref.ref(type("Nobody", (), {})())
"""Reference to the simulation that uses the kernel; a dead reference if there is none."""


def load() -> Any:
    """Import the module `nest`.

    Raises:
        ModelError: NEST is not installed.
    """
    if sys.modules.get("nest") is not None:
        return sys.modules["nest"]
    flags, arguments, quiet = sys.getdlopenflags(), sys.argv, os.environ.get("PYNEST_QUIET")
    os.environ["PYNEST_QUIET"] = "1"
    sys.argv = sys.argv[:1]  # NEST reads the command line
    try:
        import nest
    except ImportError as error:
        if error.name != "nest":
            raise ModelError(f"NEST cannot be loaded: {error}", hint=INSTALL) from None
        raise ModelError("backend 'nest' needs NEST, which is not installed", hint=INSTALL) from None
    finally:
        sys.argv = arguments
        sys.setdlopenflags(flags)
        if quiet is None:
            del os.environ["PYNEST_QUIET"]
    if processes() == 1:  # mpirun itself reports a crash
        watch()
    return nest


def lend(holder: Any, name: str) -> Any:
    """Return the empty kernel for one simulation.

    Args:
        holder: the owner of the kernel, as long as the owner exists.
        name: name of the owner's network.

    Raises:
        ModelError: another simulation exists, NEST holds a network that is not ours, NEST is not installed, or NEST was
            built without MPI and mpirun started several processes.
    """
    global _holder
    if _other_owner(holder):
        gc.collect()
    owner = _other_owner(holder)
    if owner is not None:
        raise ModelError(
            f"backend 'nest' cannot run '{name}' beside '{owner.program.name}': a process has one NEST",
            hint="drop the first simulation (del sim), or run each in a process of its own",
        )
    nest = load()
    check_mpi(nest.build_info["have_mpi"])
    if nest.network_size and MARK_MODEL not in nest.node_models:
        raise ModelError(
            f"backend 'nest' cannot run '{name}': NEST holds a network of {nest.network_size} nodes of your own: "
            "expected an empty NEST, as a process has one",
            hint="call nest.ResetKernel() first, which drops that network, or use a process of its own",
        )
    _holder = weakref.ref(holder)
    nest.ResetKernel()
    nest.verbosity = nest.VerbosityLevel.ERROR
    return nest


def mark_as_ours(nest: Any) -> None:
    """Mark the kernel as ours. After this its resolution and number of threads cannot change."""
    nest.CopyModel("parrot_neuron", MARK_MODEL)


def set_nodes(nest: Any, nodes: Any, values: list[dict[str, Any]]) -> None:
    """Set parameters of nodes: a dictionary for all, or a dictionary per node.

    `nodes.set` calls the same function, but first asks for the location of each node, which takes twenty times as long.
    """
    nest.ll_api.nestkernel.llapi_set_nc_status(nodes._datum, values)


def _other_owner(holder: Any) -> Any:
    """Return the owner of the kernel if it exists and is not `holder`, else None."""
    owner = _holder()
    return None if owner is holder else owner


@contextmanager
def nest_errors(part: str = "") -> Iterator[None]:
    """Raise NEST's errors as `ModelError` with NEST's message; under MPI end all processes.

    Args:
        part: the part of the network that is passed to NEST, e.g. "population 'c'"; "" for the whole network.
    """
    nest = load()
    try:
        yield
    except (nest.NESTError, MemoryError) as error:
        problem = f"{part}: {error}" if part else str(error)
        if nest.num_processes > 1:
            end_all(f"NEST: {problem}")
        if isinstance(error, MemoryError):
            raise
        raise ModelError(f"NEST: {problem}", hint="backend 'event' may run it") from None


CRASH = "error: the process that ran NEST ended without a message: NEST crashed, or it was killed"
_SHELL = 'trap "" INT TERM HUP; read -r word || echo "$0" >&2'


@cache
def watch() -> None:
    """Start a watcher process, at most once, which prints a message if this process crashes."""
    try:
        watcher = subprocess.Popen(["/bin/sh", "-c", _SHELL, CRASH], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    except OSError:
        return
    atexit.register(watcher.communicate, b"well\n")


BUILD = (
    "apt-get install openmpi-bin libopenmpi-dev libgsl-dev, then "
    "pip install --no-binary nest-simulator -C cmake.define.with-mpi=ON -C cmake.build-type=Release "
    "nest-simulator mpi4py"
)
PATIENCE_S = 1.0
"""Time in s that the other processes give the first process to print a message."""


class Rank(Share):
    """The share of one of several processes. All processes must call the same methods in the same order."""

    def gather(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the arrays of all processes, concatenated along the first axis, in each process."""
        return np.concatenate(_world().allgather(values))

    def agree(self, make: Callable[[], T]) -> T:
        """Return the result of a function, or raise the error of the first process in which the function fails."""
        error: ModelError | None = None
        try:
            result = make()
        except ModelError as problem:
            error = problem
        for worker_error in _world().allgather(None if error is None else vars(error)):
            if worker_error is not None:
                raise ModelError("").but(**worker_error)
        return result


def share() -> Share:
    """Return the share of a network that this process has.

    Raises:
        ModelError: NEST is not installed, or NEST was built without MPI and mpirun started several processes.
    """
    if processes() == 1:
        return WHOLE
    nest = load()
    check_mpi(nest.build_info["have_mpi"])
    return Rank(nest.Rank(), nest.num_processes)


def check_mpi(with_mpi: bool) -> None:
    """Let several processes share the work. Raise an error if NEST was built without MPI."""
    work_together()
    if processes() > 1 and not with_mpi:
        raise ModelError(f"mpirun started {processes()} processes, but this NEST was built without MPI", hint=BUILD)


def end_all(message: str) -> NoReturn:
    """End all processes with one message. If a process ended alone, the other processes would wait for ever.

    If all processes fail in the same way, the first prints the message, and the other processes wait for `PATIENCE_S`.
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
