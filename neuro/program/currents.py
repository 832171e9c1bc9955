"""What generators of currents are set to, and the currents that are constant between a few steps.

These are written by whoever runs a network when they change, so that no loop over time need carry them. Those that
change at every step are worked out by `neuro.program.drives`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.model.neurons import CurrentGenerator
from neuro.program.program import Floats, Ints, Population, Program

NEVER = np.iinfo(np.int64).max


History = list[tuple[int, Floats]]
"""Values with the steps after which they hold."""


def generator_of(population: Population) -> CurrentGenerator:
    """The model of a population of kind "current"."""
    assert isinstance(population.model, CurrentGenerator)
    return population.model


def driven(program: Program) -> list[int]:
    """Populations whose current may change at every step, or charges a receptor, as it does at every step."""
    carrying = [p for p in program.projections if p.carries == "current"]
    varying = [generator_of(program.populations[p.source]).varies or p.receptor is not None for p in carrying]
    return sorted({p.target for p, varies in zip(carrying, varying, strict=True) if varies})


class Currents:
    """Keeps the parameters and weights of all currents with the steps after which they hold.

    What a generator emits in step k over a delay of D steps is the external current of step k + D + 1; what is set
    after step k is first emitted in step k + 1.

    Args:
        program: the whole network.

    Attributes:
        targets: indices of the populations that receive a current that changes at a few steps only.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._parameters = {k: _first(p) for k, p in enumerate(program.populations) if p.kind == "current"}
        self._weights: dict[int, History] = {
            q: [(0, np.broadcast_to(p.weight, p.size).astype(np.float64).copy())]
            for q, p in enumerate(program.projections)
            if p.source in self._parameters
        }
        self.longest = 1 + max([1, *(int(program.projections[q].delay.max(initial=1)) for q in self._weights)])
        held = [generator_of(program.populations[k]).held(program.resolution) for k in self._parameters]
        self._past = self.longest + max(held, default=1)
        elsewhere = driven(program)
        self.targets = sorted({program.projections[q].target for q in self._weights} - set(elsewhere))
        self._steady = [q for q in self._weights if program.projections[q].target in self.targets]
        self._changes = self._steps_of_change()

    def __contains__(self, population: int) -> bool:
        return population in self._parameters

    def parameter(self, population: int, word: str) -> Floats:
        """What is set now, one value a neuron."""
        return self._parameters[population][word][-1][1]

    def parameters(self, population: int) -> Mapping[str, History]:
        """All that is under way, by word; of a dc_generator and one that steps the amplitude."""
        return self._parameters[population]

    def weights(self, projection: int) -> History:
        """The weights that are under way."""
        return self._weights[projection]

    def set(self, population: int, word: str, values: Floats, step: int) -> None:
        """Set a parameter; what is emitted after `step` has it."""
        n = self._program.populations[population].size
        self._append(self._parameters[population][word], step, np.broadcast_to(values, n))

    def set_weights(self, projection: int, weights: Floats, step: int) -> None:
        """Set the weights of a projection that carries a current; what is emitted after `step` has them."""
        n = self._program.projections[projection].size
        self._append(self._weights[projection], step, np.broadcast_to(weights, n))

    def _append(self, history: History, step: int, values: Floats) -> None:
        """Enter values, and drop those of which nothing is under way any more."""
        history.append((step, values.astype(np.float64)))
        while history[1][0] + self._past < step:
            del history[0]
        self._changes = self._steps_of_change()

    def _steps_of_change(self) -> Ints:
        """Steps whose current differs from that of the step before."""
        steps = [0]
        for q in self._steady:
            p = self._program.projections[q]
            source = self._program.populations[p.source]
            since = [since + 1 for since, _ in [*self._parameters[p.source]["amplitude"], *self._weights[q]]]
            for delay in np.unique(p.delay):
                steps += [min(e, NEVER // 2) + int(delay) + 1 for e in (source.start, source.stop, *since)]
        return np.unique(np.array(steps, dtype=np.int64))

    def next_change(self, step: int) -> int:
        """The last step before the next change after step + 1, or a step that never comes."""
        if not self._steady:
            return int(NEVER)
        later = self._changes[self._changes > step + 1]
        return int(later[0]) - 1 if later.size else int(NEVER)

    def into(self, population: int, step: int) -> Floats:
        """The current in pA into every neuron of a population in a step."""
        current = np.zeros(self._program.populations[population].size)
        for q in self._steady:
            if self._program.projections[q].target == population:
                self._add(current, q, step)
        return current

    def full(self, population: int, instead: Mapping[int, Floats] | None = None) -> Floats:
        """The current in pA into every neuron of a population while all generators are on.

        Args:
            population: the target.
            instead: amplitudes that are not the present ones, by generator; one value for all of it, or one each. Of
                one that steps it is the largest of each neuron.
        """
        instead = instead or {}
        current = np.zeros(self._program.populations[population].size)
        for q in self._steady:
            p, weights = self._program.projections[q], self._weights[q]
            if p.target == population:
                pre, post = self._program.connections(q)
                value = np.broadcast_to(
                    instead.get(p.source, self._largest(p.source)), self._program.populations[p.source].size
                )
                np.add.at(current, post, value[pre] * weights[-1][1])
        return current

    def _largest(self, population: int) -> Floats:
        schedule = self._program.populations[population].schedule
        if schedule is None:
            return self.parameter(population, "amplitude")
        largest: Floats = np.abs(schedule.values).max(axis=0, initial=0.0)
        return largest

    def _add(self, current: Floats, q: int, step: int) -> None:
        p = self._program.projections[q]
        source = self._program.populations[p.source]
        pre, post = self._program.connections(q)
        emitted = step - 1 - np.broadcast_to(p.delay, pre.size).astype(np.int64)
        amplitude, weight = np.zeros(pre.size), np.zeros(pre.size)
        for since, values in _under_way(self._parameters[p.source]["amplitude"], emitted):
            amplitude = np.where(emitted > since, values[pre], amplitude)
        for since, values in self._weights[q]:
            weight = np.where(emitted > since, values, weight)
        on = (emitted >= source.start) & (emitted < source.stop)
        np.add.at(current, post, np.where(on, amplitude, 0.0) * weight)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """The parameters and weights with the steps after which they hold."""
        named = {_name(k, word): history for k, words in self._parameters.items() for word, history in words.items()}
        named |= {f"current_weights.{q}": history for q, history in self._weights.items()}
        return {name: np.array([[float(since), *v] for since, v in history]) for name, history in named.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for k, words in self._parameters.items():
            for word in words:
                words[word] = [(int(row[0]), row[1:].copy()) for row in arrays[_name(k, word)]]
        for q in self._weights:
            self._weights[q] = [(int(row[0]), row[1:].copy()) for row in arrays[f"current_weights.{q}"]]
        self._changes = self._steps_of_change()


def _first(population: Population) -> dict[str, History]:
    """What holds from step 1 on, and from each step of a schedule."""
    if population.schedule is None:
        words = population.parameters if generator_of(population).varies else ("amplitude",)
        whole = {w: np.broadcast_to(population.parameters[w], population.size).astype(np.float64) for w in words}
        return {word: [(0, values.copy())] for word, values in whole.items()}
    listed = zip((population.schedule.steps - 1).tolist(), population.schedule.values, strict=True)
    steps = [(since, np.broadcast_to(values, population.size)) for since, values in listed]
    return {"amplitude": [(0, np.zeros(population.size)), *steps]}


def _under_way(history: History, emitted: Ints) -> History:
    """The part of a history that matters to what was emitted in some steps."""
    if not emitted.size:
        return []
    first = max(0, bisect_left(history, int(emitted.min()), key=itemgetter(0)) - 1)
    return history[first : bisect_left(history, int(emitted.max()), key=itemgetter(0))]


def _name(population: int, word: str) -> str:
    """Of a history in a state that is saved."""
    return f"current.{population}" if word == "amplitude" else f"current.{population}.{word}"
