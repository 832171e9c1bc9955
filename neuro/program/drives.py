"""Currents that change at every step, and along which lines they go; rates that change at listed steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from neuro.core import keyed_random
from neuro.program.currents import NEVER, Currents, History, driven, generator_of
from neuro.program.program import Floats, Ints, Program, Projection


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
