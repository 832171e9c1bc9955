"""The running machine: a program's arrays, the compiled loop over them, and what the host writes between its steps."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.quantising.fixed_program import FixedProgram
from neuro.core.clock import NEVER
from neuro.core.errors import ModelError
from neuro.program.backend import OverflowWarning
from neuro.program.currents import Currents
from neuro.program.program import Floats
from neuro.program.rates import Rates
from neuro_chip import tables as t
from neuro_chip.build import arrays_of, write_registers, write_states
from neuro_chip.delays import Delays
from neuro_chip.families.every import family_of
from neuro_chip.learners import Learners
from neuro_chip.loop import advance, send_ahead
from neuro_chip.net import Bound
from neuro_chip.presenting import open_all
from neuro_chip.registers import ChipRegisters
from neuro_chip.spike_lists import Listed, Record
from neuro_chip.weights import ChipWeights

_CLEARED = (
    *("ring", "arrived", "arrived_all", "v", "u", "g_inh", "hold", "first"),
    *("events", "spikes", "active", "native", "set_out"),
)
_LIVE = (*_CLEARED, "emitted", "emitted_times", "groups", "clock", "potential", "mean", "nothing")
_WON = ("muted", "standing", "map_wins")
"""Kept of networks in which several neurons of a group may win."""


class Machine:
    """A quantised program that advances.

    Args:
        fixed: registers and words.
        strict: whether an overflow during a run is an error instead of a warning.

    Attributes:
        fixed, program: what it runs.
        arrays: what the loop reads and writes, by the names of `net`; who replaces one calls `bind`.
        bound: these arrays as kernels take them.
        cells: present registers of the populations.
        weights: the weight memory.
        learners: the projections that learn on the chip.
        delays: those that learn.
        currents, rates: of the generators, as they change.
        listed: spikes that the host sends.
        record: spikes that are kept.
    """

    def __init__(self, fixed: FixedProgram, strict: bool) -> None:
        self.fixed, self.program, self._strict = fixed, fixed.program, strict
        self.arrays = arrays_of(fixed)
        self.cells = ChipRegisters(fixed)
        self.weights = ChipWeights(fixed, self.arrays)
        self.learners = Learners(fixed, self.weights, self.arrays)
        self.delays = Delays(fixed, self.arrays)
        self.currents = Currents(self.program)
        self.rates = Rates(self.program)
        self.record = Record()
        self._warned: set[str] = set()
        self._live = _LIVE + (_WON if any(group.choice.several for group in self.program.groups) else ())
        for k, part in enumerate(self.program.populations):
            write_states(self.arrays, k, fixed.populations[k])
            if part.kind == "poisson":
                self.set_rate(k, part.rate(1))
        self.listed = Listed(self.program, self.arrays)
        self.bound = Bound(self.arrays)

    def bind(self) -> None:
        """Hand the arrays that there are now to the loop."""
        self.bound.take(self.arrays)

    @property
    def step(self) -> int:
        """The last finished step."""
        return int(self.arrays["clock"][t.STEP])

    def slice(self, population: int) -> slice:
        """Where a population lies among all neurons."""
        row = self.arrays["pops"][population]
        return slice(int(row[t.BEGIN]), int(row[t.END]))

    def advance_to(self, end: int, group: int = t.NONE) -> None:
        """Run to a step, or until a group has decided."""
        clock = self.arrays["clock"]
        clock[t.STOP_GROUP] = group
        by_step = self.learners or self.delays
        while clock[t.STEP] < end:
            self._apply_currents()
            before = int(clock[t.STEP])
            for k, rate in self.rates.new(before):
                self.set_rate(k, rate)
            steady = min(self.currents.next_change(before), self.rates.next_change(before))
            stop = before + 1 if by_step else min(end, steady)
            advance(self.bound.view, self.bound.words, stop)
            if by_step and clock[t.STEP] > before:
                self.learners.after(before + 1)
                self.delays.after(before + 1)
            if clock[t.RECORDED]:
                n = int(clock[t.RECORDED])
                self.record.take(*(self.arrays[name][:n] for name in ("rec_steps", "rec_ids", "rec_times")))
                clock[t.RECORDED] = 0
            if group >= 0 and self.arrays["groups"][group, t.CLOSED]:
                break
        clock[t.STOP_GROUP] = t.NONE

    def send_ahead(self, projection: int) -> None:
        """What a generator emitted in the last step is sent with the words of now, before these change."""
        part = self.program.projections[projection]
        if self.program.sends_at_once(part):
            send_ahead(self.bound.view, self.bound.words, part.source, projection)

    def _apply_currents(self) -> None:
        """The host writes the bias that holds from the next step on."""
        for target in self.currents.targets:
            current = self.currents.into(target, self.step + 1)
            self.arrays["bias"][self.slice(target)] = self.cells.bias(target, current)

    def set_rate(self, population: int, rate: Floats) -> None:
        """Change the rate of a poisson_generator."""
        here = self.slice(population)
        self.arrays["mean"][here] = rate * (self.program.resolution * 1e-3)
        self.arrays["nothing"][here] = np.exp(-self.arrays["mean"][here])

    def check_overflows(self) -> None:
        """Tell of each kind of overflow once, or refuse to go on."""
        columns, learnt = self.arrays["native"][:, : t.MERGED], self.learners.overflows()
        if not learnt and not columns.any():
            return
        found = {
            f"{t.NATIVE[column]} of {self.program.populations[k].name}": int(columns[k, column])
            for k, column in zip(*np.nonzero(columns), strict=True)
        } | learnt
        for what in [what for what in found if what not in self._warned]:
            self._warned.add(what)
            text = f"backend '{self.fixed.chip.name}': {found[what]} {what} up to step {self.step}"
            hint = self._way_out(what)
            if self._strict:
                raise ModelError(text, hint=f"{hint}, or run without strict=True")
            message = f"{text}; counts().native has their number\n  hint: {hint}"
            warnings.warn(OverflowWarning(message, what, hint), stacklevel=4)

    def _way_out(self, what: str) -> str:
        """What would keep a register from overflowing."""
        family = family_of(self.fixed.chip)
        for part, cells in zip(self.program.populations, self.cells.fixed, strict=True):
            if what.endswith(f" of {part.name}") and not part.model.chip and cells.kind in family.steps:
                return family.way_out(cells)
        return "lower its weights or its input"

    def start_anew(self, weights: bool) -> None:
        """Back to step 0 and the initial states, and to the initial weights if asked."""
        for name in _CLEARED:
            self.arrays[name][:] = 0
        self.arrays["first"][:] = NEVER
        self.arrays["clock"][:] = 0
        self.arrays["clock"][t.STOP_GROUP] = t.NONE
        open_all(self.bound.view, self.bound.words)
        for k in range(len(self.program.populations)):
            write_states(self.arrays, k, self.cells.fixed[k])
        self.record = Record()
        self.listed = Listed(self.program, self.arrays)
        self._start_currents_anew()
        self._list_rates(1)
        self.weights.start_anew(weights)
        self.learners.start_anew(weights)
        self.delays.start_anew(weights)
        self._warned.clear()
        self.bind()

    def _list_rates(self, step: int) -> None:
        """The host takes the rates that are listed for a step."""
        for k, rate in self.rates.at(step):
            self.set_rate(k, rate)

    def _start_currents_anew(self) -> None:
        """Amplitudes that were set hold from step 0."""
        before, self.currents = self.currents, Currents(self.program)
        for k, part in enumerate(self.program.populations):
            if part.kind == "current" and part.schedule is None:
                self.currents.set(k, "amplitude", before.parameter(k, "amplitude"), 0)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        return {
            **{f"live.{name}": self.arrays[name].copy() for name in self._live},
            **self.record.snapshot(),
            **self.listed.snapshot(),
            **self.currents.snapshot(),
            **self.weights.snapshot(),
            **self.learners.snapshot(),
            **self.delays.snapshot(),
            **self.cells.snapshot(),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        self.weights.take(self.cells.restore(arrays))
        for k in range(len(self.program.populations)):
            write_registers(self.arrays, self.fixed, k, self.cells.fixed[k])
        for name in self._live:
            self.arrays[name][:] = arrays[f"live.{name}"]
        self.arrays["came"][:] = 1  # which slots have input is not kept
        self.record.restore(arrays)
        self.listed.restore(arrays, self.step)
        self.currents.restore(arrays)
        self._list_rates(self.step)
        self.weights.restore(arrays)
        self.learners.restore(arrays)
        self.delays.restore(arrays)
        self.bind()
