"""The network with what was learnt, for every other backend."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro
from neuro.program.program import Floats, Program

Parameters = Mapping[tuple[int, str], Floats]
"""By population and word."""


class Still:
    """A backend that runs nothing: it holds what was learnt, so that a simulation makes a network of it.

    Args:
        weights: by index of the projection; the others are the program's.
        parameters: of neurons, likewise.
    """

    name = "torch"
    description = "holds what was learnt"

    def __init__(self, weights: Mapping[int, Floats], parameters: Parameters) -> None:
        self._weights, self._parameters = weights, parameters

    def problems(self, program: Program, **options: Any) -> list[Any]:
        """Nothing is run, so nothing is refused."""
        return []

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Any:
        """What answers for an engine at step 0."""
        return _Held(program, self._weights, self._parameters)


class _Held:
    step = 0

    def __init__(self, program: Program, weights: Mapping[int, Floats], parameters: Parameters) -> None:
        self._program, self._weights, self._parameters = program, weights, parameters

    def get(self, population: int, name: str, ids: NDArray[np.int64] | None = None) -> Floats:
        """A parameter of all neurons."""
        part = self._program.populations[population]
        return np.broadcast_to(self._parameters.get((population, name), part.parameters[name]), part.size)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """The weight of every synapse."""
        part = self._program.projections[projection]
        return np.broadcast_to(self._weights.get(projection, part.weight), part.size)


def network_of(
    net: neuro.Network,
    seed: int,
    weights: Mapping[int, Floats],
    parameters: Parameters,
    delays: Mapping[str, Floats],
) -> neuro.Network:
    """A network with other weights, parameters and delays (ms); what was drawn at random is listed in it."""
    held: Any = Still(weights, parameters)
    sim = neuro.compile(net, backend=held, seed=seed)
    made, sizes = sim.network(), {part.name: part.size for part in sim.program.populations}
    for name, delay in delays.items():
        part = made.projections[name]
        shaped: Any = float(delay[0]) if delay.size == 1 else delay
        if isinstance(part.rule, neuro.all_to_all) and delay.size > 1:
            shaped = delay.reshape(sizes[part.source], sizes[part.target])
        made.projections[name] = replace(part, delay=shaped)
    return made
