"""Engines of one network with different seeds, which are advanced, read and set together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Engine, SettableSynapses, counter
from neuro.program.program import Floats, Ints, Program


class Engines(Protocol):
    """Engines at the same step. The first axis of arrays has an entry for each engine."""

    def run(self, steps: int, forget: bool) -> None:
        """Advance all engines; `forget` drops the recorded spikes."""

    def list_spikes(self, lists: Sequence[tuple[int, Ints, Ints, Ints]]) -> None:
        """Schedule spikes of listed populations in the next steps.

        Args:
            lists: tuples (population, offsets, ticks, ids). Engine k emits the entries `offsets[k] : offsets[k + 1]`,
                by tick, then id, without repeated ids in a tick. Ticks count from the present step.
        """

    def fired(self, population: int) -> Ints:
        """Return the spike count of each neuron since the start or the last reset, (engines, neurons)."""

    def set_rate(self, population: int, rates: Floats) -> None:
        """Set the rates in Hz of a poisson_generator, (engines, neurons)."""

    def signal(self, signal: int, values: Floats) -> None:
        """Set a signal, (engines, neurons of its population)."""

    def clear(self, projection: int, chosen: NDArray[np.bool_]) -> None:
        """Set the states of synapses that learn by moves to 0 in the chosen engines."""

    def merge(self, projection: int, before: Floats) -> Floats:
        """Set the weights of a projection that learns by moves to `before` plus the changes of all engines.

        Args:
            projection: index of the projection.
            before: weights that all engines had, (synapses,).

        Returns:
            The new weights.
        """


@runtime_checkable
class Joins(Protocol):
    """An engine that its backend can join with other engines of the same network."""

    def joined(self, engines: Sequence[Engine]) -> Engines:
        """Return all `engines`, including this engine, as one."""


def join_engines(program: Program, engines: Sequence[Engine]) -> Engines:
    """Return engines of a network as one: joined by their backend, or called one after the other."""
    first = engines[0]
    return first.joined(engines) if isinstance(first, Joins) else OneByOne(program, engines)


class OneByOne:
    """Engines that are called one after the other; see `Engines`."""

    def __init__(self, program: Program, engines: Sequence[Engine]) -> None:
        self._program, self._engines, self._fired = program, engines, [counter(engine) for engine in engines]

    def run(self, steps: int, forget: bool) -> None:
        """Advance all engines."""
        for engine in self._engines:
            engine.run(steps)
            if forget:
                engine.forget(engine.step)

    def list_spikes(self, lists: Sequence[tuple[int, Ints, Ints, Ints]]) -> None:
        """Schedule spikes of listed populations."""
        for population, offsets, ticks, ids in lists:
            for engine, first, end in zip(self._engines, offsets[:-1], offsets[1:], strict=True):
                engine.inject(population, engine.step + ticks[first:end], ids[first:end])

    def fired(self, population: int) -> Ints:
        """Return the spike count of each neuron."""
        return np.array([fired(population) for fired in self._fired])

    def set_rate(self, population: int, rates: Floats) -> None:
        """Set the rates of a poisson_generator."""
        for engine, engine_rates in zip(self._engines, rates, strict=True):
            engine.set(population, {"rate": engine_rates})

    def signal(self, signal: int, values: Floats) -> None:
        """Set a signal."""
        for engine, engine_values in zip(self._engines, values, strict=True):
            engine.signal(signal, engine_values)

    def clear(self, projection: int, chosen: NDArray[np.bool_]) -> None:
        """Set the states of synapses to 0 in the chosen engines."""
        part = self._program.projections[projection]
        for engine in (member for member, is_chosen in zip(self._engines, chosen, strict=True) if is_chosen):
            assert isinstance(engine, SettableSynapses)
            for state in part.synapse.states:
                engine.set_synapses(projection, state.name, np.zeros(part.size))

    def merge(self, projection: int, before: Floats) -> Floats:
        """Add up the weight changes of all engines."""
        changes = [engine.get_synapses(projection, "weight") - before for engine in self._engines]
        after: Floats = before + np.sum(changes, axis=0)
        for engine in self._engines:
            engine.set_weights(projection, after)
        return after
