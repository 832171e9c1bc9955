"""Compilation of a network to a simulation, after a report of the backend's refusals and approximations."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from neuro.compiler import compile_network
from neuro.core.checks import check, is_number
from neuro.core.errors import ModelError
from neuro.core.memory import free_memory
from neuro.core.quantities import Quantity
from neuro.core.values import shown
from neuro.model.network import Network
from neuro.model.neurons import Neuron
from neuro.program.backend import Backend, Distributed, Draws, Problem, find_backend
from neuro.program.program import WHOLE, Program
from neuro.run.simulation import Simulation

if TYPE_CHECKING:
    from neuro.run.copies import Copies

_COPIES = Quantity(kind="integer", at_least=1, at_most=100_000)
_THREADS = Quantity(kind="integer", at_least=1, at_most=max(64, os.cpu_count() or 1))


class ModelWarning(UserWarning):
    """Warning: a network runs, but some of its parameters are likely a mistake."""


class ApproximationWarning(UserWarning):
    """Warning: a backend runs a network, but not exactly as described."""


@overload
def compile(
    net: Network,
    backend: str | PathLike[str] | Backend = ...,
    seed: int = ...,
    threads: int = ...,
    copies: None = ...,
    **options: Any,
) -> Simulation: ...


@overload
def compile(
    net: Network,
    backend: str | PathLike[str] | Backend = ...,
    seed: int = ...,
    threads: int = ...,
    *,
    copies: int,
    **options: Any,
) -> Copies: ...


def compile(
    net: Network,
    backend: str | PathLike[str] | Backend = "event",
    seed: int = 0,
    threads: int = 1,
    copies: int | None = None,
    **options: Any,
) -> Simulation | Copies:
    """Compile a network for a backend.

    Args:
        net: the network.
        backend: the name of an installed backend, the table file of a chip, or the backend itself.
        seed: seed of all random numbers; the same seed gives the same run on every float backend.
        threads: number of cores; results do not depend on it.
        copies: number of simulations to run together, with the seeds `seed`, `seed` + 1, ...; see `Copies`.
        options: options of the backend.

    Returns:
        A `Simulation`, or `Copies` if `copies` is set.

    Raises:
        ModelError: the network cannot run as described. The error lists all refusals of the backend.
    """
    if not isinstance(net, Network):
        raise ModelError(f"neuro.compile: found {net!r}: expected a Network", hint="neuro.load reads one from YAML")
    threads = check(_THREADS, threads, "threads")
    if not is_number(seed) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**63:
        limit_text = " and < 2^63" if is_number(seed) and seed >= 2**63 else ""
        raise ModelError(f"seed = {shown(seed)}: expected a whole number >= 0{limit_text}")
    if isinstance(backend, (str, PathLike)):
        chosen = find_backend(backend)
    elif isinstance(backend, type) or not all(hasattr(backend, word) for word in ("name", "problems", "build")):
        raise ModelError(f"backend = {shown(backend)}: expected the name of a backend, or a backend itself")
    else:
        chosen = backend
    if copies is not None:
        from neuro.run.copies import Copies

        copies = check(_COPIES, copies, "copies")
        parts = {"backend": chosen, "threads": threads, **options}
        return Copies([compile(net, seed=int(seed) + k, **parts) for k in range(copies)])
    try:
        share = chosen.share() if isinstance(chosen, Distributed) else WHOLE
        program = compile_network(net, int(seed), threads, share, isinstance(chosen, Draws))
        _caution(program)
        _report(chosen.name, chosen.problems(program, **options))
        return Simulation(net, chosen.name, program, chosen.build(program, threads=threads, **options))
    except MemoryError as error:
        free = free_memory()
        at_hand = f"; {free:,} bytes are free" if free is not None else ""
        raise ModelError(f"network '{net.name}' does not fit into memory: {error}{at_hand}") from None


def _caution(program: Program) -> None:
    """Warn of parameters that are likely a mistake."""
    for part in program.populations:
        if isinstance(part.model, Neuron) and (caution := part.model.caution(part.parameters, program.resolution)):
            origin = f"{part.origin}: " if part.origin else ""
            warnings.warn(f"{origin}population '{part.name}': {part.model.name}: {caution}", ModelWarning, stacklevel=3)


def _report(backend: str, problems: Iterable[Problem]) -> None:
    """Raise one error for all refusals; warn of each approximation."""
    all_problems = list(problems)
    refused = tuple(problem.error() for problem in all_problems if problem.refused)
    if refused:
        count = f"{len(refused)} problem" + "s" * (len(refused) > 1)
        raise ModelError(f"backend '{backend}' cannot run this network ({count})", others=refused)
    for problem in all_problems:
        warnings.warn(f"backend '{backend}': {problem.error()}", ApproximationWarning, stacklevel=3)
