"""The running machine: a program's arrays, the compiled loop over them, and what the host writes between its steps."""

from __future__ import annotations

import warnings
from collections.abc import Container, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed import FixedPopulation, FixedProjection
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.known import arithmetic_of
from neuro.chips.quantising import names_of, requantise, shares
from neuro.core.clock import NEVER
from neuro.core.errors import ModelError, unknown
from neuro.core.interrupts import AT_ONCE, Interruptible, end_if_stopped, torn
from neuro.model.equations import EquationNeuron
from neuro.program.backend import OverflowWarning, Problem
from neuro.program.currents import Currents, Rates
from neuro.program.program import Floats, Ints
from neuro.program.spikes import ListedSpikes, RecordedSpikes
from neuro_chip import tables as t
from neuro_chip.build import arrays_of, write_registers, write_states
from neuro_chip.learners import Delays, Learners
from neuro_chip.loop import advance, open_all, send_ahead
from neuro_chip.tables import Bound
from neuro_chip.weights import ChipWeights

_CLEARED = (
    *("ring", "arrived", "arrived_all", "v", "u", "g_inh", "hold", "payload", "first"),
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
        arrays: what the loop reads and writes, by the names of `net`; call `bind` after one is replaced.
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
        self.record = RecordedSpikes()
        self._warned: set[str] = set()
        self._torn = False
        self._live = _LIVE + (_WON if any(group.choice.several for group in self.program.groups) else ())
        for k, part in enumerate(self.program.populations):
            write_states(self.arrays, k, fixed.populations[k])
            if part.kind == "poisson":
                self.set_rate(k, part.rate(1))
        self.listed = ListedSpikes(self.program, self.arrays, self.arrays["pops"][:, t.BEGIN].tolist())
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
        clock, by_step = self.arrays["clock"], self.learners or self.delays
        while clock[t.STEP] < end:
            for target in self.currents.targets:  # the host writes the bias that holds from the next step on
                current = self.currents.into(target, self.step + 1)
                self.arrays["bias"][self.slice(target)] = self.cells.bias(target, current)
            before = int(clock[t.STEP])
            for k, rate in self.rates.new(before):
                self.set_rate(k, rate)
            steady = min(self.currents.next_change(before), self.rates.next_change(before))
            stop = before + 1 if by_step else min(end, steady)
            self._torn = bool(by_step)  # what a step teaches is part of it
            advance(self.bound.view, self.bound.words, stop)
            end_if_stopped(self.arrays["stop"])
            if by_step and clock[t.STEP] > before:
                self.learners.after(before + 1)
                self.delays.after(before + 1)
            self._torn = False
            if clock[t.RECORDED]:
                steps, ids, counts = (self.arrays[name] for name in ("rec_steps", "rec_ids", "rec_counts"))
                n = int(clock[t.RECORDED])
                self.record.take([(steps[:n], ids[:n], counts[:n])])
                clock[t.RECORDED] = 0
            if group >= 0 and self.arrays["groups"][group, t.CLOSED]:
                break

    def send_ahead(self, projection: int) -> None:
        """What a generator emitted in the last step is sent with the words of now, before these change."""
        part = self.program.projections[projection]
        if self.program.sends_at_once(part):
            send_ahead(self.bound.view, self.bound.words, part.source, projection)

    def set_rate(self, population: int, rate: Floats) -> None:
        """Change the rate of a poisson_generator."""
        here = self.slice(population)
        self.arrays["mean"][here] = rate * (self.program.resolution * 1e-3)
        self.arrays["nothing"][here] = np.exp(-self.arrays["mean"][here])

    def native(self, columns: int) -> dict[str, int]:
        """Return what only chips count, by name, of the first columns."""
        counts = self.arrays["native"][:, :columns]
        return {
            f"{t.NATIVE[column]} of {self.program.populations[k].name}": int(counts[k, column])
            for k, column in zip(*np.nonzero(counts), strict=True)
        }

    def check_overflows(self) -> None:
        """Tell of each kind of overflow once, or refuse to go on."""
        found = self.native(t.MERGED) | self.learners.overflows()
        arithmetic = arithmetic_of(self.fixed.chip)
        for what in [what for what in found if what not in self._warned]:
            self._warned.add(what)
            text = f"backend '{self.fixed.chip.name}': {found[what]} {what} up to step {self.step}"
            # What would keep the register from overflowing.
            hint = "lower its weights or its input"
            for part, cells in zip(self.program.populations, self.cells.fixed, strict=True):
                if what.endswith(f" of {part.name}") and not part.model.chip and cells.kind in arithmetic.states:
                    hint = arithmetic.way_out(cells)
                    break
            if self._strict:
                raise ModelError(text, hint=f"{hint}, or run without strict=True")
            message = f"{text}; counts().native has their number\n  hint: {hint}"
            warnings.warn(OverflowWarning(message, what, hint), stacklevel=4)

    def start_anew(self, weights: bool) -> None:
        """Back to step 0 and the initial states, and to the initial weights if asked."""
        for name in _CLEARED:
            self.arrays[name][:] = 0
        self._torn = False
        self.arrays["first"][:] = NEVER
        self.arrays["clock"][:] = 0
        self.arrays["clock"][t.STOP_GROUP] = t.NONE
        open_all(self.bound.view, self.bound.words)
        for k in range(len(self.program.populations)):
            write_states(self.arrays, k, self.cells.fixed[k])
        self.record = RecordedSpikes()
        self.listed = ListedSpikes(self.program, self.arrays, self.arrays["pops"][:, t.BEGIN].tolist())
        before, self.currents = self.currents, Currents(self.program)
        for k, part in enumerate(self.program.populations):
            if part.kind == "current" and part.schedule is None:  # amplitudes that were set hold from step 0
                self.currents.set(k, "amplitude", before.parameter(k, "amplitude"), 0)
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

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        if self._torn:
            raise torn()
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
        self.learners.restore(arrays)  # first, since it refuses what an earlier version has saved
        self.weights.take(self.cells.restore(arrays))
        for k in range(len(self.program.populations)):
            write_registers(self.arrays, self.fixed, k, self.cells.fixed[k])
        for name in self._live:
            if (kept := arrays.get(f"live.{name}")) is not None:  # states that were saved before have no payloads
                self.arrays[name][:] = kept
        self._torn = False
        self.arrays["came"][:] = 1  # which slots have input is not kept
        self.record.restore(arrays)
        self.listed.restore(arrays, self.step)
        self.currents.restore(arrays)
        self._list_rates(self.step)
        self.weights.restore(arrays)
        self.delays.restore(arrays)
        self.bind()


_KEPT = "a running chip keeps its scale: describe the network with these values, or lower them"


class ChipRegisters:
    """The populations of a quantised program while it runs.

    Attributes:
        fixed: each population's present registers.
        parameters: each population's present parameters, as described.
    """

    def __init__(self, fixed: FixedProgram) -> None:
        self._program, self._arithmetic = fixed, arithmetic_of(fixed.chip)
        self.fixed = list(fixed.populations)
        self.parameters = [dict(p.parameters) for p in fixed.program.populations]
        self._names = [names_of(part) for part in fixed.program.populations]
        self._good = [dict(parameters) for parameters in self.parameters]

    def names(self, population: int, name: str) -> tuple[str, ...]:
        """The states of the chip's model that a state is, or the sum of which it is."""
        return self._names[population].get(name, (name,))

    def counted_from(self, population: int, parameters: Container[str]) -> list[str]:
        """The potential, if its register counts from a rest that may follow from one of some parameters."""
        model = self._program.program.populations[population].model
        if "E_L" not in parameters and not isinstance(model, EquationNeuron):
            return []
        return [name for name, names in self._names[population].items() if names == ("V_m",)]

    def state(self, population: int, name: str, arrays: Mapping[str, NDArray[np.int32]]) -> Floats:
        """A state in the unit of its model, from the state registers."""
        first, *more = (self._state(population, each, arrays) for each in self.names(population, name))
        return sum(more, start=first)

    def _state(self, population: int, name: str, arrays: Mapping[str, NDArray[np.int32]]) -> Floats:
        part = self.fixed[population]
        if name in self._arithmetic.states.get(part.kind, ()):
            return arrays[name].astype(np.float64)
        if name == "V_m":
            values: Floats = arrays["v"] / part.volt + part.rest
            return values
        return self._arithmetic.current(part, name, arrays)

    def units(self, population: int, name: str, values: Floats) -> dict[str, NDArray[np.int32]]:
        """The state registers of a state, and values in their units.

        Raises:
            ModelError: a value does not fit.
        """
        names, found = self.names(population, name), dict[str, NDArray[np.int32]]()
        for each, share in zip(names, shares(values, names), strict=True):
            register, units = self._units(population, each, share)
            found[register] = found[register] + units if register in found else units
        return found

    def _units(self, population: int, name: str, values: Floats) -> tuple[str, NDArray[np.int32]]:
        part = self.fixed[population]
        register = self.register_of(population, name)
        exact = values
        if name == "V_m":
            exact = (values - part.rest) * part.volt
        elif name in ("I_syn_ex", "I_syn_in"):
            exact = self._arithmetic.units(part, name, values)
        elif (broken := values[values != np.rint(values)]).size:
            raise ModelError(f"population '{part.name}': {name} = {broken[0]:g}: register '{name}' holds whole numbers")
        limit = self._arithmetic.state_limit
        bad = np.flatnonzero(np.abs(exact) > limit)
        if bad.size:
            raise ModelError(
                f"population '{part.name}': {name} = {values[min(bad[0], values.size - 1)]:g}: "
                f"its register '{register}' holds at most {limit} units"
            )
        return register, np.rint(exact).astype(np.int32)

    def bias(self, population: int, current: Floats) -> NDArray[np.int32]:
        """What is added in each step, with a current in pA beside the constant one."""
        return self._arithmetic.bias(self.fixed[population], current)

    def register_of(self, population: int, name: str) -> str:
        """The register of that name, or the one that holds a state or parameter of that name.

        Raises:
            ModelError: the population has no such register.
        """
        part, name = self.fixed[population], self.names(population, name)[0]
        own = [*self._arithmetic.states.get(part.kind, ()), *part.registers]
        stands = self._arithmetic.stands_for
        if stands.get(name) in own:
            return stands[name]
        if name not in own:
            raise unknown("register", name, own).at(None, f"population '{part.name}'")
        return name

    def again(
        self, population: int, weights: Mapping[int, Floats], learning: Container[int]
    ) -> tuple[FixedPopulation, dict[int, FixedProjection]]:
        """Registers of a population for its present parameters, at the scale that it has.

        Args:
            population: which.
            weights: the weights that all projections should have.
            learning: projections that learn on the chip; their rules hold for one scale.

        Returns:
            the population, and the projections onto it.

        Raises:
            ModelError: a register would overflow, or a rule would not hold any more; nothing is changed.
        """
        part = self._program.program.populations[population]
        if part.kind != "neuron":
            return self.fixed[population], {}
        found, wires, problems = requantise(self._program, population, self.parameters[population], weights)
        refused = [replace(problem, way_out=_KEPT) for problem in problems if problem.refused]
        for k, new in wires.items():
            before = self._program.projections[k]
            if k in learning and (before is None or not np.array_equal(before.step, new.step)):
                name = self._program.program.projections[k].name
                why = "the change gives its weights another scale, and the rule in the chip's microcode holds for one"
                way_out = "change the network and compile again"
                refused.append(Problem(True, f"projection '{name}' learns", why, way_out))
        if refused:
            self.parameters[population] = dict(self._good[population])
            raise ModelError(f"{refused[0].what}: {refused[0].why}", hint=refused[0].way_out)
        self.fixed[population] = found
        self._good[population] = dict(self.parameters[population])
        return found, wires

    def snapshot(self) -> dict[str, Ints | Floats]:
        """The parameters by population."""
        return {
            f"parameter.{k}.{name}": values.copy()
            for k, parameters in enumerate(self.parameters)
            for name, values in parameters.items()
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> dict[int, FixedProjection]:
        """Take over a snapshot; return the projections onto all populations at the scales that they have then."""
        found: dict[int, FixedProjection] = {}
        for k, parameters in enumerate(self.parameters):
            for name in parameters:
                parameters[name] = arrays[f"parameter.{k}.{name}"].copy()
            part = self._program.program.populations[k]
            if part.kind == "neuron":
                self.fixed[k], wires, _ = requantise(self._program, k, parameters, {})
                found |= wires
            self._good[k] = dict(parameters)
        return found
