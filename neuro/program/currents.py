"""What generators of currents are set to, and the currents that follow.

Currents that are constant between a few steps are written by whoever runs a network when they change (`Currents`), so
that no loop over time need carry them. Others are worked out for each step (`Emission`).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.model.neurons import CurrentGenerator
from neuro.program.program import Floats, Ints, Population, Program, Projection

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
                source = self._program.populations[p.source]
                if p.source in instead:
                    largest = instead[p.source]
                elif source.schedule is None:
                    largest = self.parameter(p.source, "amplitude")
                else:
                    largest = np.abs(source.schedule.values).max(axis=0, initial=0.0)
                value = np.broadcast_to(largest, source.size)
                np.add.at(current, post, value[pre] * weights[-1][1])
        return current

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


@dataclass(frozen=True, slots=True, eq=False)
class CurrentLine:
    """The synapses of a projection with the weights of one time.

    Attributes:
        projection: index of the projection.
        since, until: what is emitted in steps since < k <= until goes along it.
        weight: of each synapse.
    """

    projection: int
    since: int
    until: int
    weight: Floats


def lines_of(program: Program, currents: Currents) -> list[CurrentLine]:
    """All lines into driven populations, by target, then in the order of the projections and of their weights."""
    found = []
    for target in driven(program):
        for q, p in enumerate(program.projections):
            if p.target == target and p.carries == "current":
                history = currents.weights(q)
                ends = [since for since, _ in history[1:]] + [int(NEVER)]
                found += [CurrentLine(q, since, end, w) for (since, w), end in zip(history, ends, strict=True)]
    return found


class Emission:
    """What a generator emits along one projection: one column for each of its neurons, or for each synapse.

    Args:
        program: the whole network.
        projection: index of the projection.

    Attributes:
        columns: how many.
        column: of each synapse.
        first: the first step in which the generator is on.
    """

    def __init__(self, program: Program, projection: int) -> None:
        part = program.projections[projection]
        source = program.populations[part.source]
        self._source, self._model, self._h = source, generator_of(source), program.resolution
        pre, _ = program.connections(projection)
        own = self._model.individual
        self._pre: Ints | slice = pre if own else slice(None)
        self.columns = part.size if own else source.size
        self.column: Ints = np.arange(part.size) if own else pre
        self._key = keyed_random.key(program.seed, "noise", part.name if own else source.name)
        self.first = max(1, source.start)

    def moments(self, steps: Ints) -> Ints:
        """The step whose current is emitted in each of some steps in which the generator is on."""
        held = self._model.held(self._h)
        return self.first + (steps - self.first) // held * held

    def on(self, steps: Ints) -> Ints:
        """Those of some steps in which the generator is on."""
        return steps[(steps >= self.first) & (steps < self._source.stop)]

    def at(self, moments: Ints, parameters: Mapping[str, Floats]) -> Floats:
        """The current of some steps for parameters of each neuron, shape (steps, columns)."""
        t: Floats = (moments.astype(np.float64) * self._h)[:, None]
        own = {w: v[self._pre] if v.size > 1 else v for w, v in parameters.items()}
        z: Floats = keyed_random.normal_table(self._key, moments, self.columns) if self._model.draws else t
        return np.broadcast_to(self._model.values(own, t, z), (moments.size, self.columns))

    def drawn(self, steps: Ints, histories: Mapping[str, History]) -> tuple[Ints, Floats]:
        """The current of neighbouring steps, each value once however long it is held.

        Returns:
            For each step a row of the values, whose first is 0: that of steps in which the generator is off.
        """
        rows, values = np.zeros(steps.size, dtype=np.int64), [np.zeros((1, self.columns))]
        on = self.on(steps)
        if on.size:
            moments, back = np.unique(self.moments(on), return_inverse=True)
            values += [self.at(m, p) for m, p in _pieces(moments, histories)]
            begin = int(on[0] - steps[0])
            rows[begin : begin + on.size] = back + 1
        return rows, np.concatenate(values)

    def during(self, steps: Ints, histories: Mapping[str, History]) -> Floats:
        """The current of neighbouring steps, shape (steps, columns)."""
        rows, values = self.drawn(steps, histories)
        return values[rows]

    def room(self, steps: int) -> int:
        """The most rows that `drawn` gives for so many steps."""
        return int(np.unique(self.moments(np.arange(self.first, self.first + steps))).size) + 2


def _pieces(moments: Ints, histories: Mapping[str, History]) -> Iterable[tuple[Ints, dict[str, Floats]]]:
    """Moments between which no parameter changes, and the parameters."""
    changes = np.unique([since for history in histories.values() for since, _ in history])
    cuts = np.searchsorted(moments, changes, side="right")
    for part in np.split(moments, np.unique(cuts[(cuts > 0) & (cuts < moments.size)])):
        yield part, {word: _at(history, int(part[0])) for word, history in histories.items()}


def _at(history: History, step: int) -> Floats:
    """What holds in a step: one value if all neurons share it."""
    values = next(values for since, values in reversed(history) if since < step)
    return values[:1] if np.all(values == values[:1]) else values


def filtered_current(program: Program, part: Projection, parameters: Mapping[str, Floats]) -> tuple[int, Floats]:
    """The state that filters a current to a receptor, and the fraction of the current that a step adds to it.

    A current I through the filter exp(-t / tau) / tau of a synaptic current adds (1 - exp(-h / tau)) I a step.

    Args:
        program: the whole network.
        part: a projection whose receptor is named.
        parameters: of the target, as they are now.
    """
    model = program.populations[part.target].model
    assert part.receptor is not None
    state, tau = type(model).filters[part.receptor.name]  # type: ignore[attr-defined]
    names = [each.name for each in model.states]
    return names.index(state), -np.expm1(-program.resolution / parameters[tau])


class Rates:
    """The rates of all generators of kind "poisson" whose rate is listed.

    Args:
        program: the whole network.
    """

    def __init__(self, program: Program) -> None:
        self._listed = [
            (k, p.schedule) for k, p in enumerate(program.populations) if p.kind == "poisson" and p.schedule is not None
        ]

    def at(self, step: int) -> list[tuple[int, Floats]]:
        """These populations and their rates in Hz in a step, shape (1,) or (size,)."""
        return [(k, listed.at(step)) for k, listed in self._listed]

    def new(self, step: int) -> list[tuple[int, Floats]]:
        """Those of them whose rate in step + 1 is another than in step, and that rate."""
        return [(k, listed.at(step + 1)) for k, listed in self._listed if (listed.steps == step + 1).any()]

    def next_change(self, step: int) -> int:
        """The last step before the next change after step + 1, or a step that never comes."""
        return min((listed.next_change(step) for _, listed in self._listed), default=NEVER)
