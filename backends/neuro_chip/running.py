"""The running machine: a program's arrays, the compiled loop over them, and the host's writes between steps."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from neuro.chips.fixed_program import FixedProgram
from neuro.chips.known import arithmetic_of
from neuro.core.errors import ModelError
from neuro.core.interrupts import AT_ONCE, Interruptible, end_if_stopped, torn
from neuro.program.backend import OverflowWarning
from neuro.program.program import Floats
from neuro.program.spikes import RecordedSpikes, nothing_listed
from neuro_chip import tables as t
from neuro_chip.build import arrays_of, write_states
from neuro_chip.loop import advance, send_ahead
from neuro_chip.tables import Bound

if TYPE_CHECKING:
    from neuro.program.currents import Currents, Rates
    from neuro.program.listed import ListedSpikes
    from neuro_chip.learners import Delays, Learners
    from neuro_chip.registers import ChipRegisters
    from neuro_chip.weights import ChipWeights


class RunningMachine:
    """A quantised program that advances.

    Args:
        fixed: registers and words.
        strict: whether an overflow during a run is an error instead of a warning.

    Attributes:
        fixed: registers and words.
        program: the program that runs.
        arrays: arrays of the loop, by the names of `net`; call `bind` after one is replaced.
        bound: the same arrays as arguments of kernels.
        record: recorded spikes.
    """

    def __init__(self, fixed: FixedProgram, strict: bool) -> None:
        self.fixed, self.program, self._strict = fixed, fixed.program, strict
        self.arrays = arrays_of(fixed)
        self._learns = any(wires is not None and wires.rule is not None for wires in fixed.projections)
        self._by_step = self._learns or any(part.synapse.delays for part in self.program.projections)
        if self._by_step:
            self._by_step = bool(self.learners or self.delays)
        self._steady = not any(part.kind == "current" or part.schedule is not None for part in self.program.populations)
        self.record = RecordedSpikes()
        self._warned: set[str] = set()
        self._torn = False
        for k, part in enumerate(self.program.populations):
            write_states(self.arrays, k, fixed.populations[k])
            if part.kind == "poisson":
                self.set_rate(k, part.rate(1))
        self._list_spikes()
        self.bound = Bound(self.arrays)

    @cached_property
    def cells(self) -> ChipRegisters:
        """Present registers of the populations. This and the following objects are made on first use."""
        from neuro_chip.registers import ChipRegisters

        return ChipRegisters(self.fixed)

    @cached_property
    def weights(self) -> ChipWeights:
        """The weight memory."""
        from neuro_chip.weights import ChipWeights

        return ChipWeights(self.fixed, self.arrays)

    @cached_property
    def learners(self) -> Learners:
        """The projections that learn on the chip."""
        from neuro_chip.learners import Learners

        return Learners(self.fixed, self.weights, self.arrays)

    @cached_property
    def delays(self) -> Delays:
        """The delays that learn."""
        from neuro_chip.learners import Delays

        return Delays(self.fixed, self.arrays)

    @cached_property
    def currents(self) -> Currents:
        """The present currents of generators."""
        from neuro.program.currents import Currents

        return Currents(self.program)

    @cached_property
    def rates(self) -> Rates:
        """The listed rates."""
        from neuro.program.currents import Rates

        return Rates(self.program)

    def _list_spikes(self) -> None:
        """Give the described spikes to the loop."""
        self._lists: ListedSpikes | None = None
        if any(part.kind == "listed" for part in self.program.populations):
            from neuro.program.listed import ListedSpikes

            self._lists = ListedSpikes(self.program, self.arrays, self.arrays["pops"][:, t.BEGIN].tolist())
        else:
            self.arrays |= nothing_listed(self.program)

    @property
    def spike_lists(self) -> ListedSpikes:
        """Spikes that the host sends."""
        assert self._lists is not None
        return self._lists

    def bind(self) -> None:
        """Give the present arrays to the loop."""
        self.bound.take(self.arrays)

    @property
    def step(self) -> int:
        """The last finished step."""
        return int(self.arrays["clock"][t.STEP])

    def slice(self, population: int) -> slice:
        """Return the range of a population's neurons among all neurons."""
        row = self.arrays["pops"][population]
        return slice(int(row[t.BEGIN]), int(row[t.END]))

    def advance_to(self, end: int, group: int = t.NONE) -> None:
        """Run to a step, or until a group has decided."""
        if self._torn:
            raise torn()
        self.arrays["clock"][t.STOP_GROUP] = group
        stop = self.arrays["stop"]
        with Interruptible(stop):
            try:
                self._advance_to(end, group)
            except BaseException:
                self._torn |= int(stop[0]) == AT_ONCE
                raise
        self.arrays["clock"][t.STOP_GROUP] = t.NONE

    def _advance_to(self, end: int, group: int) -> None:
        clock, reports_each_step = self.arrays["clock"], self._by_step
        while clock[t.STEP] < end:
            begin = int(clock[t.STEP])
            steady = end if self._steady else min(end, self._prepare(begin))
            stop = begin + 1 if reports_each_step else steady
            self._torn = reports_each_step  # learning is part of a step
            advance(self.bound.view, self.bound.words, stop)
            end_if_stopped(self.arrays["stop"])
            if reports_each_step and clock[t.STEP] > begin:
                self.learners.after(begin + 1)
                self.delays.after(begin + 1)
            self._torn = False
            if clock[t.RECORDED]:
                steps, ids, counts = (self.arrays[name] for name in ("rec_steps", "rec_ids", "rec_counts"))
                n = int(clock[t.RECORDED])
                self.record.take([(steps[:n], ids[:n], counts[:n])])
                clock[t.RECORDED] = 0
            if group >= 0 and self.arrays["groups"][group, t.CLOSED]:
                break

    def _prepare(self, step: int) -> int:
        """Set currents and rates for the steps after `step`; return the last step for which they hold."""
        for target in self.currents.targets:  # the host writes the bias for the next steps
            current = self.currents.into(target, step + 1)
            self.arrays["bias"][self.slice(target)] = self.cells.bias(target, current)
        for k, rate in self.rates.new(step):
            self.set_rate(k, rate)
        return min(self.currents.next_change(step), self.rates.next_change(step))

    def send_ahead(self, projection: int) -> None:
        """Send a generator's spikes of the last step with the present words, before these change."""
        part = self.program.projections[projection]
        if self.program.sends_at_once(part):
            send_ahead(self.bound.view, self.bound.words, part.source, projection)

    def set_rate(self, population: int, rate: Floats) -> None:
        """Change the rate of a poisson_generator."""
        neurons = self.slice(population)
        self.arrays["mean"][neurons] = rate * (self.program.resolution * 1e-3)
        self.arrays["nothing"][neurons] = np.exp(-self.arrays["mean"][neurons])

    def native(self, columns: int) -> dict[str, int]:
        """Return the counts in the first columns that exist only on chips, by name."""
        counts = self.arrays["native"][:, :columns]
        return {
            f"{t.NATIVE[column]} of {self.program.populations[k].name}": int(counts[k, column])
            for k, column in zip(*np.nonzero(counts), strict=True)
        }

    def check_overflows(self) -> None:
        """Warn once about each kind of overflow, or raise an error if `strict`."""
        overflows = self.native(t.MERGED) | (self.learners.overflows() if self._learns else {})
        arithmetic = arithmetic_of(self.fixed.chip)
        for overflow in [name for name in overflows if name not in self._warned]:
            self._warned.add(overflow)
            text = f"backend '{self.fixed.chip.name}': {overflows[overflow]} {overflow} up to step {self.step}"
            # The hint explains how to keep the register from overflowing.
            hint = "lower its weights or its input"
            for part, cells in zip(self.program.populations, self.cells.fixed, strict=True):
                if overflow.endswith(f" of {part.name}") and not part.model.chip and cells.kind in arithmetic.states:
                    hint = arithmetic.way_out(cells)
                    break
            if self._strict:
                raise ModelError(text, hint=f"{hint}, or run without strict=True")
            message = f"{text}; counts().native has their number\n  hint: {hint}"
            warnings.warn(OverflowWarning(message, overflow, hint), stacklevel=4)
