"""Parameters of current generators over time, and the resulting currents.

Currents that change in few steps (`Currents`) are written by the caller at each change, outside of the loop over time.
Other currents are computed for each step (`Emission`).
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
"""Values, each with the step after which it holds."""


def generator_of(population: Population) -> CurrentGenerator:
    """Return the model of a population of kind "current"."""
    assert isinstance(population.model, CurrentGenerator)
    return population.model


def driven(program: Program) -> list[int]:
    """Return the populations with a current that must be computed for every step.

    Such a current can change at every step, or charges a receptor.
    """
    carrying = [p for p in program.projections if p.carries == "current"]
    varying = [generator_of(program.populations[p.source]).varies or p.receptor is not None for p in carrying]
    return sorted({p.target for p, varies in zip(carrying, varying, strict=True) if varies})


class Currents:
    """Store of the parameters and weights of all currents, with the steps after which they hold.

    The current that a generator emits in step k over a delay of D steps is the external current of step k + D + 1. A
    value that is set after step k is first emitted in step k + 1. Example: a value set after step 4 over a delay of 2
    steps is emitted in step 5 and is an external current from step 8 on.

    Args:
        program: the whole network.

    Attributes:
        targets: indices of the populations without input from currents that change at every step.
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
        hold_steps = [
            generator_of(program.populations[k]).steps_per_value(program.resolution) for k in self._parameters
        ]
        self._past = self.longest + max(hold_steps, default=1)
        computed_targets = driven(program)
        self.targets = sorted({program.projections[q].target for q in self._weights} - set(computed_targets))
        self._steady = [q for q in self._weights if program.projections[q].target in self.targets]
        self._changes = self._steps_of_change()

    def __contains__(self, population: int) -> bool:
        return population in self._parameters

    def parameter(self, population: int, word: str) -> Floats:
        """Return the present value of a parameter, one value per neuron."""
        return self._parameters[population][word][-1][1]

    def parameters(self, population: int) -> Mapping[str, History]:
        """Return the histories that still have an effect, by parameter; for dc and step generators the amplitude."""
        return self._parameters[population]

    def weights(self, projection: int) -> History:
        """Return the history of weights that still have an effect."""
        return self._weights[projection]

    def set(self, population: int, word: str, values: Floats, step: int) -> None:
        """Set a parameter for the currents emitted after `step`."""
        n = self._program.populations[population].size
        self._append(self._parameters[population][word], step, np.broadcast_to(values, n))

    def set_weights(self, projection: int, weights: Floats, step: int) -> None:
        """Set the weights of a projection that carries a current, for the currents emitted after `step`."""
        n = self._program.projections[projection].size
        self._append(self._weights[projection], step, np.broadcast_to(weights, n))

    def _append(self, history: History, step: int, values: Floats) -> None:
        """Add values, and drop values whose last current has arrived."""
        history.append((step, values.astype(np.float64)))
        while history[1][0] + self._past < step:
            del history[0]
        self._changes = self._steps_of_change()

    def _steps_of_change(self) -> Ints:
        """Return the steps at which the current changes."""
        steps = [0]
        for q in self._steady:
            p = self._program.projections[q]
            source = self._program.populations[p.source]
            since = [since + 1 for since, _ in [*self._parameters[p.source]["amplitude"], *self._weights[q]]]
            for delay in np.unique(p.delay):
                steps += [min(e, NEVER // 2) + int(delay) + 1 for e in (source.start, source.stop, *since)]
        return np.unique(np.array(steps, dtype=np.int64))

    def next_change(self, step: int) -> int:
        """Return the last step before the next change after step + 1, or `NEVER`."""
        if not self._steady:
            return int(NEVER)
        later = self._changes[self._changes > step + 1]
        return int(later[0]) - 1 if later.size else int(NEVER)

    def into(self, population: int, step: int) -> Floats:
        """Return the current in pA into every neuron of a population in a step."""
        current = np.zeros(self._program.populations[population].size)
        for q in self._steady:
            if self._program.projections[q].target == population:
                self._add(current, q, step)
        return current

    def full(self, population: int, replacements: Mapping[int, Floats] | None = None) -> Floats:
        """Return the current in pA into every neuron of a population while all generators are on.

        Args:
            population: index of the target.
            replacements: amplitudes instead of the present ones, by generator: one value for all neurons, or one per
                neuron. For a generator with listed amplitudes, the largest amplitude of each neuron counts.
        """
        replacements = replacements or {}
        current = np.zeros(self._program.populations[population].size)
        for q in self._steady:
            p, weights = self._program.projections[q], self._weights[q]
            if p.target == population:
                pre, post = self._program.connections(q)
                source = self._program.populations[p.source]
                if p.source in replacements:
                    largest = replacements[p.source]
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
        is_on = (emitted >= source.start) & (emitted < source.stop)
        np.add.at(current, post, np.where(is_on, amplitude, 0.0) * weight)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return the parameters and weights with the steps after which they hold."""
        histories = {
            _name(k, word): history for k, words in self._parameters.items() for word, history in words.items()
        }
        histories |= {f"current_weights.{q}": history for q, history in self._weights.items()}
        return {name: np.array([[float(since), *v] for since, v in history]) for name, history in histories.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace all values by those of a snapshot."""
        for k, words in self._parameters.items():
            for word in words:
                words[word] = [(int(row[0]), row[1:].copy()) for row in arrays[_name(k, word)]]
        for q in self._weights:
            self._weights[q] = [(int(row[0]), row[1:].copy()) for row in arrays[f"current_weights.{q}"]]
        self._changes = self._steps_of_change()


def _first(population: Population) -> dict[str, History]:
    """Return the initial histories: the value from step 1 on, and the value from each step of a schedule on."""
    if population.schedule is None:
        words = population.parameters if generator_of(population).varies else ("amplitude",)
        wide = {w: np.broadcast_to(population.parameters[w], population.size).astype(np.float64) for w in words}
        return {word: [(0, values.copy())] for word, values in wide.items()}
    changes = zip((population.schedule.steps - 1).tolist(), population.schedule.values, strict=True)
    steps = [(since, np.broadcast_to(values, population.size)) for since, values in changes]
    return {"amplitude": [(0, np.zeros(population.size)), *steps]}


def _under_way(history: History, emitted: Ints) -> History:
    """Return the part of a history that applies to the given steps of emission."""
    if not emitted.size:
        return []
    first = max(0, bisect_left(history, int(emitted.min()), key=itemgetter(0)) - 1)
    return history[first : bisect_left(history, int(emitted.max()), key=itemgetter(0))]


def _name(population: int, word: str) -> str:
    """Return the name of a history in a snapshot."""
    return f"current.{population}" if word == "amplitude" else f"current.{population}.{word}"


@dataclass(frozen=True, slots=True, eq=False)
class CurrentLine:
    """Synapses of a projection, with the weights of one interval of time.

    Attributes:
        projection: index of the projection.
        since, until: the line carries the currents emitted in steps since < k <= until.
        weight: weight of each synapse.
    """

    projection: int
    since: int
    until: int
    weight: Floats


def lines_of(program: Program, currents: Currents) -> list[CurrentLine]:
    """Return all lines into driven populations, by target, then in the order of projections and weights."""
    lines = []
    for target in driven(program):
        for q, p in enumerate(program.projections):
            if p.target == target and p.carries == "current":
                history = currents.weights(q)
                ends = [since for since, _ in history[1:]] + [int(NEVER)]
                lines += [CurrentLine(q, since, end, w) for (since, w), end in zip(history, ends, strict=True)]
    return lines


class Emission:
    """Current from a generator along a projection, with a column for each neuron or each synapse.

    Args:
        program: the whole network.
        projection: index of the projection.

    Attributes:
        columns: number of columns.
        column: the column of each synapse.
        first: the first step in which the generator is on.
    """

    def __init__(self, program: Program, projection: int) -> None:
        part = program.projections[projection]
        source = program.populations[part.source]
        self._source, self._model, self._h = source, generator_of(source), program.resolution
        pre, _ = program.connections(projection)
        is_individual = self._model.individual
        self._pre: Ints | slice = pre if is_individual else slice(None)
        self.columns = part.size if is_individual else source.size
        self.column: Ints = np.arange(part.size) if is_individual else pre
        self._key = keyed_random.key(program.seed, "noise", part.name if is_individual else source.name)
        self.first = max(1, source.start)

    def moments(self, steps: Ints) -> Ints:
        """Return, for each step, the step in which its current was drawn. Generators can hold values."""
        hold_steps = self._model.steps_per_value(self._h)
        return self.first + (steps - self.first) // hold_steps * hold_steps

    def on(self, steps: Ints) -> Ints:
        """Return the steps in which the generator is on."""
        return steps[(steps >= self.first) & (steps < self._source.stop)]

    def at(self, moments: Ints, parameters: Mapping[str, Floats]) -> Floats:
        """Return the current of some steps for parameters of each neuron, shape (steps, columns)."""
        t: Floats = (moments.astype(np.float64) * self._h)[:, None]
        expanded = {w: v[self._pre] if v.size > 1 else v for w, v in parameters.items()}
        z: Floats = keyed_random.normal_table(self._key, moments, self.columns) if self._model.draws else t
        return np.broadcast_to(self._model.values(expanded, t, z), (moments.size, self.columns))

    def table(self, steps: Ints, histories: Mapping[str, History]) -> tuple[Ints, Floats]:
        """Return the current of neighbouring steps. A value that is held for several steps is stored once.

        Returns:
            For each step an index into the rows of the values, and the values. Row 0 is 0, for steps in which the
            generator is off.
        """
        rows, values = np.zeros(steps.size, dtype=np.int64), [np.zeros((1, self.columns))]
        is_on = self.on(steps)
        if is_on.size:
            moments, value_index = np.unique(self.moments(is_on), return_inverse=True)
            values += [self.at(m, p) for m, p in _pieces(moments, histories)]
            begin = int(is_on[0] - steps[0])
            rows[begin : begin + is_on.size] = value_index + 1
        return rows, np.concatenate(values)

    def during(self, steps: Ints, histories: Mapping[str, History]) -> Floats:
        """Return the current of neighbouring steps, shape (steps, columns)."""
        rows, values = self.table(steps, histories)
        return values[rows]

    def room(self, steps: int) -> int:
        """Return the largest number of rows that `table` can return for this number of steps."""
        return int(np.unique(self.moments(np.arange(self.first, self.first + steps))).size) + 2


def _pieces(moments: Ints, histories: Mapping[str, History]) -> Iterable[tuple[Ints, dict[str, Floats]]]:
    """Yield moments between which no parameter changes, and the parameters."""
    changes = np.unique([since for history in histories.values() for since, _ in history])
    cuts = np.searchsorted(moments, changes, side="right")
    for part in np.split(moments, np.unique(cuts[(cuts > 0) & (cuts < moments.size)])):
        yield part, {word: _at(history, int(part[0])) for word, history in histories.items()}


def _at(history: History, step: int) -> Floats:
    """Return the value in a step, with shape (1,) if equal for all neurons."""
    values = next(values for since, values in reversed(history) if since < step)
    return values[:1] if np.all(values == values[:1]) else values


def filtered_current(program: Program, part: Projection, parameters: Mapping[str, Floats]) -> tuple[int, Floats]:
    """Return the state that filters a current to a receptor, and the fraction of the current added to it per step.

    A current I through the filter exp(-t / tau) / tau of a synaptic current adds (1 - exp(-h / tau)) I per step.

    Args:
        program: the whole network.
        part: a projection with a named receptor.
        parameters: present parameters of the target.
    """
    model = program.populations[part.target].model
    assert part.receptor is not None
    state, tau = type(model).filters[part.receptor.name]  # type: ignore[attr-defined]
    names = [each.name for each in model.states]
    return names.index(state), -np.expm1(-program.resolution / parameters[tau])


class Rates:
    """The rates of all generators of kind "poisson" with listed rates.

    Args:
        program: the whole network.
    """

    def __init__(self, program: Program) -> None:
        self._listed = [
            (k, p.schedule) for k, p in enumerate(program.populations) if p.kind == "poisson" and p.schedule is not None
        ]

    def at(self, step: int) -> list[tuple[int, Floats]]:
        """Return the populations and their rates in Hz in a step, shape (1,) or (size,)."""
        return [(k, schedule.at(step)) for k, schedule in self._listed]

    def new(self, step: int) -> list[tuple[int, Floats]]:
        """Return the populations whose rate changes from step to step + 1, and the new rates."""
        return [(k, schedule.at(step + 1)) for k, schedule in self._listed if (schedule.steps == step + 1).any()]

    def next_change(self, step: int) -> int:
        """Return the last step before the next change after step + 1, or `NEVER`."""
        return min((schedule.next_change(step) for _, schedule in self._listed), default=NEVER)
