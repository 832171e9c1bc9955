"""Noise currents: drawn from the keyed stream, and sent by NEST's step_current_generators."""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.core.clock import Clock
from neuro.model.neurons import noise_generator
from neuro.program.currents import Currents, generator_of
from neuro.program.drives import Emission
from neuro.program.program import Population, Program
from neuro_nest.kernel import set_nodes


def is_noise(part: Population) -> bool:
    """Whether its currents are drawn here."""
    return isinstance(part.model, noise_generator)


def nodes_of(program: Program, population: int) -> int:
    """How many nodes stand for a population: of noise of which each connection has its own, as many as connections."""
    part = program.populations[population]
    if not (is_noise(part) and generator_of(part).individual):
        return part.size
    return max(1, sum(p.size for p in program.projections if p.source == population))


def first_node(program: Program, projection: int) -> int | None:
    """The node of the first synapse of a projection each of whose synapses has a node, else None."""
    source = program.projections[projection].source
    part = program.populations[source]
    if not (is_noise(part) and generator_of(part).individual):
        return None
    return sum(p.size for p in program.projections[:projection] if p.source == source)


class Noise:
    """What a noise_generator sends.

    Args:
        program: the whole network.
        population: index of the generator.
        currents: what generators are set to.
    """

    def __init__(self, program: Program, population: int, currents: Currents) -> None:
        self._population, self._currents, self._clock = population, currents, Clock(program.resolution)
        self._stop = program.populations[population].stop
        outgoing = [q for q, p in enumerate(program.projections) if p.source == population]
        if not generator_of(program.populations[population]).individual:
            outgoing = outgoing[:1]
        self._emissions = [Emission(program, q) for q in outgoing]

    def emit(self, nest: Any, nodes: Any, after: int, to: int) -> None:
        """Tell NEST what is sent in steps after < k <= to."""
        if not self._emissions:
            return
        steps = np.arange(after + 1, to + 1)
        anew = (steps == after + 1) | (steps == self._stop)
        drawn = self._emissions[0].on(steps)
        anew[np.isin(steps, drawn[self._emissions[0].moments(drawn) == drawn])] = True
        histories = self._currents.parameters(self._population)
        sent = np.concatenate([emission.during(steps, histories)[anew] for emission in self._emissions], axis=1)
        times = self._clock.array_ms(steps[anew])
        set_nodes(nest, nodes, [{"amplitude_times": times, "amplitude_values": values} for values in sent.T.copy()])
