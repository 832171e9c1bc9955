"""Engines of one network that differ in their seeds, advanced, read and set as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Engine, SettableSynapses, counter
from neuro.program.program import Floats, Ints, Program


class Engines(Protocol):
    """Engines that stand at the same step. Arrays have a first axis, an entry for each engine."""

    def run(self, steps: int, forget: bool) -> None:
        """Advance all; with `forget` what they record of spikes is dropped."""

    def list_spikes(self, lists: Sequence[tuple[int, Ints, Ints, Ints]]) -> None:
        """Let listed populations emit in the steps to come.

        Args:
            lists: population; `offsets`, so that those of engine k are `offsets[k] : offsets[k + 1]`; `ticks`, steps
                after the present one; `ids`. Of an engine they are by tick, then id, and no id twice in a tick.
        """

    def fired(self, population: int) -> Ints:
        """How often each neuron has fired since the start or the last reset, (engines, neurons)."""

    def set_rate(self, population: int, rates: Floats) -> None:
        """Set the rates in Hz of a poisson_generator, (engines, neurons)."""

    def signal(self, signal: int, values: Floats) -> None:
        """Set a signal, (engines, neurons of its population)."""

    def clear(self, projection: int, which: NDArray[np.bool_]) -> None:
        """Let the states of synapses that learn by moves be 0 in those engines for which `which` says so."""

    def merge(self, projection: int, before: Floats) -> Floats:
        """Let the weights of a projection that learns by moves be `before` and what each engine has added; return them.

        Args:
            projection: the projection.
            before: weights that all had, (synapses,).
        """


@runtime_checkable
class Joins(Protocol):
    """An engine that joins others of its network."""

    def joined(self, engines: Sequence[Engine]) -> Engines:
        """All of `engines`, of which it is one, as one."""


def together(program: Program, engines: Sequence[Engine]) -> Engines:
    """Engines of a network as one, as its backend does it, or one by one."""
    first = engines[0]
    return first.joined(engines) if isinstance(first, Joins) else OneByOne(program, engines)


class OneByOne:
    """Engines that are called one after the other; see `Engines`."""

    def __init__(self, program: Program, engines: Sequence[Engine]) -> None:
        self._program, self._engines, self._fired = program, engines, [counter(engine) for engine in engines]

    def run(self, steps: int, forget: bool) -> None:
        """Advance all."""
        for engine in self._engines:
            engine.run(steps)
            if forget:
                engine.forget(engine.step)

    def list_spikes(self, lists: Sequence[tuple[int, Ints, Ints, Ints]]) -> None:
        """Let listed populations emit."""
        for population, offsets, ticks, ids in lists:
            for engine, first, end in zip(self._engines, offsets[:-1], offsets[1:], strict=True):
                engine.inject(population, engine.step + ticks[first:end], ids[first:end])

    def fired(self, population: int) -> Ints:
        """How often each neuron has fired."""
        return np.array([fired(population) for fired in self._fired])

    def set_rate(self, population: int, rates: Floats) -> None:
        """Set the rates of a poisson_generator."""
        for engine, each in zip(self._engines, rates, strict=True):
            engine.set(population, {"rate": each})

    def signal(self, signal: int, values: Floats) -> None:
        """Set a signal."""
        for engine, each in zip(self._engines, values, strict=True):
            engine.signal(signal, each)

    def clear(self, projection: int, which: NDArray[np.bool_]) -> None:
        """Let the states of synapses be 0."""
        part = self._program.projections[projection]
        for engine in (each for each, chosen in zip(self._engines, which, strict=True) if chosen):
            assert isinstance(engine, SettableSynapses)
            for state in part.synapse.states:
                engine.set_synapses(projection, state.name, np.zeros(part.size))

    def merge(self, projection: int, before: Floats) -> Floats:
        """Add up what each has learnt."""
        gained = [engine.get_synapses(projection, "weight") - before for engine in self._engines]
        after: Floats = before + np.sum(gained, axis=0)
        for engine in self._engines:
            engine.set_weights(projection, after)
        return after
