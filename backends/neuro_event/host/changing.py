"""Currents and rates that change while a network runs.

Currents that change at every step are computed in advance for a stretch of steps, and written to tables of the loop.
Currents and rates that change at few steps are written at these steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.program.currents import NEVER, CurrentLine, Currents, Emission, Rates, driven, filtered_current, lines_of
from neuro.program.program import Floats, Ints, Program
from neuro_event.building import build
from neuro_event.building.layout import EventArrays
from neuro_event.loop import steps, tables as t

Parameter: TypeAlias = Callable[[int, str], Floats]

SHORTEST, LONGEST = 64, 1024
"""Smallest and largest number of steps in a stretch."""

PARTS = ("line_ends", "line_columns", "line_lates", "line_weights", "shares")
"""Names of the arrays that hold the values of all lines, one line after the other."""

STRETCH_VALUES = 1 << 19
"""Approximate number of current values in a stretch."""


class VaryingCurrents:
    """The currents of the next steps into populations whose current changes at every step.

    A line is the current of one projection during an interval without a change of weights.

    Args:
        program: the whole network.
        currents: parameters of the current generators and weights of their projections.
        arrays: the arrays of the loop, which receive the tables.
    """

    def __init__(self, program: Program, currents: Currents, arrays: EventArrays) -> None:
        self._program, self._currents, self._arrays = program, currents, arrays
        self._driven = driven(program)
        self._emissions: dict[int, Emission] = {}
        self._lines: list[CurrentLine] = []
        self._until = -1

    def changed(self) -> None:
        """Discard the computed currents, because a parameter or a weight was set."""
        self._until = -1

    def prepare(self, step: int, parameter: Parameter) -> tuple[int, bool]:
        """Compute the currents of the steps after `step`, unless they have been computed.

        Args:
            step: the last finished step.
            parameter: function that returns the present value of a parameter of a population. The engine passes it at
                each call. If this object stored it, engine and object would refer to each other, and only the garbage
                collector would free them.

        Returns:
            The last step with computed currents, and True if arrays were replaced.
        """
        if not self._driven:
            return int(NEVER), False
        replaced = self._until < 0
        if replaced:
            self._lay_out(parameter)
        if self._until <= step:
            self._fill(step)
        return self._until, replaced

    def _lay_out(self, parameter: Parameter) -> None:
        """Rebuild the table of lines, with their synapses and weights."""
        self._lines = [k for k in lines_of(self._program, self._currents) if k.weight.size]
        for line in self._lines:
            self._emissions.setdefault(line.projection, Emission(self._program, line.projection))
        columns = sum(self._emissions[line.projection].columns for line in self._lines)
        self._steps = max(int(np.clip(STRETCH_VALUES // max(1, columns), SHORTEST, LONGEST)), self._currents.longest)
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in PARTS}

        def add(name: str, values: NDArray[Any]) -> int:
            """Append values to an array of all lines; return the index of the first."""
            parts[name].append(values)
            return sum(part.size for part in parts[name]) - values.size

        targets_with_line, first, span = set[int](), 0, self._steps + self._currents.longest
        self._arrays.net["lines"] = np.zeros((len(self._lines), t.LINE_COLUMNS), dtype=np.int64)
        for row, line in zip(self._arrays.net["lines"], self._lines, strict=True):
            p, emission = self._program.projections[line.projection], self._emissions[line.projection]
            row[t.DRIVEN], row[t.CHARGED], row[t.FIRST_VALUE], row[t.VALUES] = p.target, t.NONE, first, emission.columns
            if p.receptor is not None:
                model: Any = type(self._program.populations[p.target].model)
                tau = model.filters[p.receptor.name][1]
                row[t.CHARGED], share = filtered_current(self._program, p, {tau: parameter(p.target, tau)})
                share_by_neuron = np.broadcast_to(share, self._program.populations[p.target].size)
                row[t.SHARE] = add("shares", self._arrays.places[p.target].by_place(share_by_neuron))
            elif p.target not in targets_with_line:
                row[t.BEGINS] = 1
                targets_with_line.add(p.target)
            self._connect(row, line, emission.column, add)
            first += emission.room(span) * emission.columns
        for name, values in parts.items():
            self._arrays.net[name] = np.concatenate([self._arrays.net[name][:0], *values])
        self._arrays.net["emitted"] = np.zeros(first)
        self._arrays.net["emitted_rows"] = np.zeros((len(self._lines), span), dtype=np.int64)

    def _connect(self, row: Ints, line: CurrentLine, column: Ints, add: Callable[[str, NDArray[Any]], int]) -> None:
        """Write the synapses of a line to its row: a single column for all neurons, a column per neuron, or a list.

        A list has columns, delays and weights, sorted by target. Example: if column 0 goes to all neurons with delay 3,
        `HOW` is `TO_ALL`, `COLUMN_AT` is 0, `LATE` is 3, and `line_ends` has no entries.
        """
        part = self._program.projections[line.projection]
        place, n = self._arrays.places[part.target], self._program.populations[part.target].size
        _, post = self._program.connections(line.projection)
        shared = bool(np.all(line.weight == line.weight[0]))
        is_one_to_one = (
            np.array_equal(post, np.arange(n)) and place.inside is None and bool(np.all(part.delay == part.delay[0]))
        )
        has_one_column = bool(np.all(column == column[0]))
        row[t.LINE_STRIDE], weight = (0, line.weight[:1]) if shared else (1, line.weight)
        if is_one_to_one and (has_one_column or np.array_equal(column, column[0] + np.arange(n))):
            row[t.HOW] = t.TO_ALL if has_one_column else t.TO_EACH
            row[t.COLUMN_AT], row[t.LATE] = column[0], part.delay[0]
        else:
            order = np.argsort(post if place.inside is None else place.inside[post], kind="stable")
            counts = np.bincount(post, minlength=n)
            ends = np.concatenate([[0], np.cumsum(place.by_place(counts))])
            row[t.HOW] = t.AS_LISTED
            begin = add("line_columns", column[order])
            add("line_lates", np.broadcast_to(part.delay, part.size)[order].astype(np.int64))
            row[t.LINE_ENDS] = add("line_ends", ends + begin)
            weight = weight if shared else weight[order]
            row[t.LINE_WEIGHT] = add("line_weights", weight) - (0 if shared else begin)
            return
        row[t.LINE_WEIGHT] = add("line_weights", weight)

    def _fill(self, step: int) -> None:
        """Compute the values emitted in the stretch after a step, and the earlier values that are still under way."""
        first = step - self._currents.longest + 1
        steps = np.arange(first, first + self._steps + self._currents.longest)
        emitted, rows = self._arrays.net["emitted"], self._arrays.net["emitted_rows"]
        for k, line in enumerate(self._lines):
            part = self._program.projections[line.projection]
            rows[k], values = self._emissions[line.projection].table(steps, self._currents.parameters(part.source))
            rows[k, (steps <= line.since) | (steps > line.until)] = 0
            begin = self._arrays.net["lines"][k, t.FIRST_VALUE]
            emitted[begin : begin + values.size] = values.ravel()
        self._arrays.net["emitted_from"][0] = first
        self._until = step + self._steps


def apply(currents: Currents, program: Program, arrays: EventArrays, view: int, step: int) -> None:
    """Set the currents from step + 1 on, and wake the populations whose current changes."""
    for target in currents.targets:
        place = arrays.places[target]
        current = place.by_place(currents.into(target, step + 1))
        present_current = arrays.net["current"][place.begin : place.end]
        if not np.array_equal(current, present_current):
            steps.wake_population(view, target, step, program.resolution)
            present_current[:] = current


class Changing:
    """The currents and rates of a network that change while it runs.

    Args:
        program: the whole network.
        arrays: the arrays of the loop, which receive the values.

    Attributes:
        currents: parameters of the current generators and weights of their projections.
        drives: currents that change at every step.
    """

    def __init__(self, program: Program, arrays: EventArrays) -> None:
        self._program, self._arrays, self._rates = program, arrays, Rates(program)
        self.currents = Currents(program)
        self.drives = VaryingCurrents(program, self.currents, arrays)

    def prepare(self, view: int, step: int, parameter: Parameter) -> tuple[int, bool]:
        """Write the currents and rates of the steps after `step`.

        Arguments and results are as in `VaryingCurrents.prepare`. The values are valid up to the returned step.
        """
        apply(self.currents, self._program, self._arrays, view, step)
        for k, rate in self._rates.new(step):
            build.set_rate(self._arrays, k, self._arrays.places[k].by_place(rate) if rate.size > 1 else rate, step)
        until, replaced = self.drives.prepare(step, parameter)
        return min(until, self.currents.next_change(step), self._rates.next_change(step)), replaced
