"""NEST's kernel: imported in silence, lent to one simulation at a time, its errors told as ours."""

from __future__ import annotations

import gc
import os
import sys
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.launch import processes
from neuro_nest import ranks
from neuro_nest.watch import watch

INSTALL = "pip install nest-simulator"
OURS = "neuro_nest"
"""A node model that only a kernel of ours has; ResetKernel takes it away."""

_holder: weakref.ref[Any] = weakref.ref(type("Nobody", (), {})())


def load() -> Any:
    """The module `nest`.

    Raises:
        ModelError: it is not installed.
    """
    if sys.modules.get("nest") is not None:
        return sys.modules["nest"]
    flags, words, quiet = sys.getdlopenflags(), sys.argv, os.environ.get("PYNEST_QUIET")
    os.environ["PYNEST_QUIET"] = "1"
    sys.argv = sys.argv[:1]  # NEST reads the command line
    try:
        import nest
    except ImportError as error:
        if error.name != "nest":
            raise ModelError(f"NEST cannot be loaded: {error}", hint=INSTALL) from None
        raise ModelError("backend 'nest' needs NEST, which is not installed", hint=INSTALL) from None
    finally:
        sys.argv = words
        sys.setdlopenflags(flags)
        if quiet is None:
            del os.environ["PYNEST_QUIET"]
    if processes() == 1:  # mpirun tells it itself
        watch()
    return nest


def lend(holder: Any, name: str) -> Any:
    """The kernel, empty, for one simulation.

    Args:
        holder: has it for as long as it lives.
        name: of its network.

    Raises:
        ModelError: another simulation lives, or a network that is none of ours; NEST is not installed, or it does not
            fit how this process was started.
    """
    global _holder
    if _alive(holder):
        gc.collect()
    other = _alive(holder)
    if other is not None:
        raise ModelError(
            f"backend 'nest' cannot run '{name}' beside '{other.program.name}': a process has one NEST",
            hint="drop the first simulation (del sim), or run each in a process of its own",
        )
    nest = load()
    ranks.check(nest.build_info["have_mpi"])
    if nest.network_size and OURS not in nest.node_models:
        raise ModelError(
            f"backend 'nest' cannot run '{name}': NEST holds a network of {nest.network_size} nodes of your own: "
            "expected an empty NEST, as a process has one",
            hint="call nest.ResetKernel() first, which drops that network, or use a process of its own",
        )
    _holder = weakref.ref(holder)
    nest.ResetKernel()
    nest.verbosity = nest.VerbosityLevel.ERROR
    return nest


def sign(nest: Any) -> None:
    """Mark the kernel as ours; after this its resolution and threads cannot change."""
    nest.CopyModel("parrot_neuron", OURS)


def set_nodes(nest: Any, nodes: Any, words: list[dict[str, Any]]) -> None:
    """Set nodes: one dictionary for all, or one for each.

    It is what `nodes.set` calls, which first asks each node where it lies: twenty times the work.
    """
    nest.ll_api.nestkernel.llapi_set_nc_status(nodes._datum, words)


def _alive(holder: Any) -> Any:
    other = _holder()
    return None if other is holder else other


@contextmanager
def told() -> Iterator[None]:
    """Tell NEST's errors as ours, in its words; under MPI they end all processes."""
    nest = load()
    try:
        yield
    except (nest.NESTError, MemoryError) as error:
        if nest.num_processes > 1:
            ranks.end_all(f"NEST: {error}")
        if isinstance(error, MemoryError):
            raise
        raise ModelError(f"NEST: {error}") from None
