"""What generators of currents, and listed rates, change between steps.

Currents that change at every step are in tables, which are filled for a stretch of steps at a time.
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
"""Steps of a stretch."""

PARTS = ("line_ends", "line_columns", "line_lates", "line_weights", "shares")
"""Arrays of all lines, one line behind the other."""

HELD = 1 << 19
"""About how many currents a stretch holds."""


class VaryingCurrents:
    """What is emitted in the next steps along the lines into driven populations.

    Args:
        program: the whole network.
        currents: what its generators are set to.
        arrays: where the loop finds its tables.
    """

    def __init__(self, program: Program, currents: Currents, arrays: EventArrays) -> None:
        self._program, self._currents, self._a = program, currents, arrays
        self._driven = driven(program)
        self._emissions: dict[int, Emission] = {}
        self._lines: list[CurrentLine] = []
        self._until = -1

    def changed(self) -> None:
        """Something was set: what was worked out is no longer so."""
        self._until = -1

    def prepare(self, step: int, parameter: Parameter) -> tuple[int, bool]:
        """Work out the currents of the steps after `step`.

        Args:
            step: the step before.
            parameter: gives a parameter of a population as it is now. It is passed each time, since an engine that
                is reached from its own parts would be freed by the garbage collector only, long after its last use.

        Returns:
            The last step for which they are known, and whether arrays were replaced.
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
        """Lay out lines and weights anew."""
        self._lines = [k for k in lines_of(self._program, self._currents) if k.weight.size]
        for line in self._lines:
            self._emissions.setdefault(line.projection, Emission(self._program, line.projection))
        columns = sum(self._emissions[line.projection].columns for line in self._lines)
        self._steps = max(int(np.clip(HELD // max(1, columns), SHORTEST, LONGEST)), self._currents.longest)
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in PARTS}

        def add(name: str, values: NDArray[Any]) -> int:
            """Put values behind those of other lines; return where they begin."""
            parts[name].append(values)
            return sum(each.size for each in parts[name]) - values.size

        begun, first, span = set[int](), 0, self._steps + self._currents.longest
        self._a.net["lines"] = np.zeros((len(self._lines), t.LINE_COLUMNS), dtype=np.int64)
        for row, line in zip(self._a.net["lines"], self._lines, strict=True):
            p, emission = self._program.projections[line.projection], self._emissions[line.projection]
            row[t.DRIVEN], row[t.CHARGED], row[t.FIRST_VALUE], row[t.VALUES] = p.target, t.NONE, first, emission.columns
            if p.receptor is not None:
                model: Any = type(self._program.populations[p.target].model)
                tau = model.filters[p.receptor.name][1]
                row[t.CHARGED], share = filtered_current(self._program, p, {tau: parameter(p.target, tau)})
                every = np.broadcast_to(share, self._program.populations[p.target].size)
                row[t.SHARE] = add("shares", self._a.places[p.target].by_place(every))
            elif p.target not in begun:
                row[t.BEGINS] = 1
                begun.add(p.target)
            self._connect(row, line, emission.column, add)
            first += emission.room(span) * emission.columns
        for name, values in parts.items():
            self._a.net[name] = np.concatenate([self._a.net[name][:0], *values])
        self._a.net["emitted"] = np.zeros(first)
        self._a.net["emitted_rows"] = np.zeros((len(self._lines), span), dtype=np.int64)

    def _connect(self, row: Ints, line: CurrentLine, column: Ints, add: Callable[[str, NDArray[Any]], int]) -> None:
        """Enter the synapses of a line: one column to all neurons, one to each, or a list."""
        p = self._program.projections[line.projection]
        place, n = self._a.places[p.target], self._program.populations[p.target].size
        _, post = self._program.connections(line.projection)
        shared = bool(np.all(line.weight == line.weight[0]))
        each = np.array_equal(post, np.arange(n)) and place.inside is None and bool(np.all(p.delay == p.delay[0]))
        steady = bool(np.all(column == column[0]))
        row[t.LINE_STRIDE], weight = (0, line.weight[:1]) if shared else (1, line.weight)
        if each and (steady or np.array_equal(column, column[0] + np.arange(n))):
            row[t.HOW] = t.TO_ALL if steady else t.TO_EACH
            row[t.COLUMN_AT], row[t.LATE] = column[0], p.delay[0]
        else:
            order = np.argsort(post if place.inside is None else place.inside[post], kind="stable")
            counts = np.bincount(post, minlength=n)
            ends = np.concatenate([[0], np.cumsum(place.by_place(counts))])
            row[t.HOW] = t.AS_LISTED
            begin = add("line_columns", column[order])
            add("line_lates", np.broadcast_to(p.delay, p.size)[order].astype(np.int64))
            row[t.LINE_ENDS] = add("line_ends", ends + begin)
            weight = weight if shared else weight[order]
            row[t.LINE_WEIGHT] = add("line_weights", weight) - (0 if shared else begin)
            return
        row[t.LINE_WEIGHT] = add("line_weights", weight)

    def _fill(self, step: int) -> None:
        """Work out what is emitted up to where it ends; a delay before the steps to come, it is still under way."""
        first = step - self._currents.longest + 1
        steps = np.arange(first, first + self._steps + self._currents.longest)
        emitted, rows = self._a.net["emitted"], self._a.net["emitted_rows"]
        for k, line in enumerate(self._lines):
            part = self._program.projections[line.projection]
            rows[k], values = self._emissions[line.projection].drawn(steps, self._currents.parameters(part.source))
            rows[k, (steps <= line.since) | (steps > line.until)] = 0
            begin = self._a.net["lines"][k, t.FIRST_VALUE]
            emitted[begin : begin + values.size] = values.ravel()
        self._a.net["emitted_from"][0] = first
        self._until = step + self._steps


def apply(currents: Currents, program: Program, arrays: EventArrays, view: int, step: int) -> None:
    """Set the currents that hold from step + 1 on; populations whose current changes are woken."""
    for target in currents.targets:
        place = arrays.places[target]
        current = place.by_place(currents.into(target, step + 1))
        now = arrays.net["current"][place.begin : place.end]
        if not np.array_equal(current, now):
            steps.wake_population(view, target, step, program.resolution)
            now[:] = current


class Changing:
    """All that is sent to a network whose currents or rates change while it runs.

    Args:
        program: the whole network.
        arrays: where the loop finds its tables.

    Attributes:
        currents: what generators of currents are set to.
        drives: the currents that change at every step.
    """

    def __init__(self, program: Program, arrays: EventArrays) -> None:
        self._program, self._a, self._rates = program, arrays, Rates(program)
        self.currents = Currents(program)
        self.drives = VaryingCurrents(program, self.currents, arrays)

    def prepare(self, view: int, step: int, parameter: Parameter) -> tuple[int, bool]:
        """Write what generators are to send after a step; the arguments and the result are those of the drives."""
        apply(self.currents, self._program, self._a, view, step)
        for k, rate in self._rates.new(step):
            build.set_rate(self._a, k, self._a.places[k].by_place(rate) if rate.size > 1 else rate, step)
        until, replaced = self.drives.prepare(step, parameter)
        return min(until, self.currents.next_change(step), self._rates.next_change(step)), replaced
