"""The engine of the emulated chips: it drives the compiled loop and translates registers for its callers."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.quantising.fixed_program import FixedProgram
from neuro.core.clock import NEVER
from neuro.core.errors import ModelError, unknown
from neuro.model.neurons import dc_generator, poisson_generator, spike_generator
from neuro.program.backend import EngineCounts, Outcome, OverflowWarning, Spikes, Trial
from neuro.program.currents import Currents
from neuro.program.program import Floats, Ints
from neuro_chip import tables as t
from neuro_chip.build import STATES, arrays_of, write_registers, write_states
from neuro_chip.learners import Learners
from neuro_chip.listed import Listed
from neuro_chip.loop import Net, advance
from neuro_chip.record import Record
from neuro_chip.registers import Registers
from neuro_chip.trials import Trials
from neuro_chip.weights import Weights

_KEPT = ("ring", "heard", "heard_all", "v", "u", "g_inh", "hold", "first", "events", "spikes", "active", "native")
_LIVE = (*_KEPT, "emitted", "emitted_times", "groups", "clock", "potential", "mean", "nothing")


class ChipEngine:
    """A quantised program in execution; `neuro.program.backend.Engine` says what each method does.

    Args:
        fixed: registers and words.
        strict: whether an overflow during a run is an error instead of a warning.
    """

    def __init__(self, fixed: FixedProgram, strict: bool) -> None:
        self.fixed, self.program, self._strict = fixed, fixed.program, strict
        self._a = arrays_of(fixed)
        self._registers = Registers(fixed)
        self._weights = Weights(fixed, self._a)
        self._learners = Learners(fixed, self._weights, self._a)
        self._currents = Currents(self.program)
        self._record = Record()
        self._told: set[str] = set()
        for k, part in enumerate(self.program.populations):
            write_states(self._a, k, fixed.populations[k])
            if isinstance(part.model, poisson_generator):
                self._set_rate(k, part.parameters["rate"])
        self._listed = Listed(self.program, self._a)
        self._trials = Trials(self) if self.program.trials is not None else None
        self._bind()

    def _bind(self) -> None:
        """Hand the arrays that there are now to the loop."""
        self._net = Net(**{name: self._a[name] for name in Net._fields})

    # time

    @property
    def step(self) -> int:
        """The last finished step."""
        return int(self._a["clock"][t.STEP])

    def run(self, steps: int) -> None:
        """Advance."""
        self.advance_to(self.step + steps)
        self.check_overflows()

    def advance_to(self, end: int, group: int = t.NONE) -> None:
        """Run to a step, or until a group has decided."""
        clock = self._a["clock"]
        clock[t.STOP_GROUP] = group
        while clock[t.STEP] < end:
            self._apply_currents()
            before = int(clock[t.STEP])
            stop = before + 1 if self._learners else min(end, self._currents.next_change(before))
            advance(self._net, stop)
            if self._learners and clock[t.STEP] > before:
                self._learners.after(before + 1)
            if clock[t.RECORDED]:
                n = int(clock[t.RECORDED])
                self._record.take(*(self._a[name][:n] for name in ("rec_steps", "rec_ids", "rec_times")))
                clock[t.RECORDED] = 0
            if group >= 0 and self._a["groups"][group, t.WINNER] >= 0:
                break
        clock[t.STOP_GROUP] = t.NONE

    def _apply_currents(self) -> None:
        """The host writes the bias that holds from the next step on."""
        for target in self._currents.targets:
            current = self._currents.into(target, self.step + 1)
            self._a["bias"][self.slice(target)] = self._registers.bias(target, current)

    def check_overflows(self) -> None:
        """Tell of each kind of overflow once, or refuse to go on."""
        columns = self._a["native"][:, : t.MERGED]
        found = {
            f"{t.NATIVE[column]} of {self.program.populations[k].name}": int(columns[k, column])
            for k, column in zip(*np.nonzero(columns), strict=True)
        } | self._learners.overflows()
        for what in [what for what in found if what not in self._told]:
            self._told.add(what)
            text = f"backend '{self.fixed.chip.name}': {found[what]} {what} up to step {self.step}"
            hint = self._way_out(what)
            if self._strict:
                raise ModelError(text, hint=f"{hint}, or run without strict=True")
            told = f"{text}; counts().native has their number\n  hint: {hint}"
            warnings.warn(told, OverflowWarning, stacklevel=4)

    def _way_out(self, what: str) -> str:
        """What would keep a register from overflowing."""
        for part, cells in zip(self.program.populations, self._registers.fixed, strict=True):
            if not what.endswith(f" of {part.name}") or part.model.chip:
                continue
            if cells.kind == "loihi_lif":
                return f"scales={{'{part.name}': {cells.volt / 4:.4g}}} leaves 4 times the room"
            if "exc_shift" in cells.registers:
                shifts = tuple(min(15, int(cells.registers[f"{word}_shift"][0]) + 2) for word in ("exc", "inh"))
                return f"shifts={{'{part.name}': {shifts}}} leaves 4 times the room"
        return "lower its weights or its input"

    def slice(self, population: int) -> slice:
        """Where a population lies among all neurons."""
        row = self._a["pops"][population]
        return slice(int(row[t.BEGIN]), int(row[t.END]))

    # trials

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        assert self._trials is not None
        return self._trials.present(trial)

    def learn(self, projection: int, neuron: int, decided: int, won: bool) -> None:
        """Apply the trial rule to the inputs of one neuron: the host does."""
        assert self._trials is not None
        self._trials.learn(projection, neuron, decided, won)

    def encourage(self, projection: int, maps: Ints) -> None:
        """Let every weight of some maps grow: the host does."""
        assert self._trials is not None
        self._trials.encourage(projection, maps)

    # input

    def inject(self, population: int, steps: Ints, ids: Ints) -> None:
        """Add spikes of a spike_generator."""
        self._listed.add(population, steps, ids, self.step)
        self._bind()

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine of every synapse that listens."""
        self._learners.signal(signal, values, self.step)

    # reading and writing

    def get(self, population: int, name: str) -> Floats:
        """A state in physical units, or a parameter as described."""
        part, here = self.program.populations[population], self.slice(population)
        if name in [state.name for state in part.model.states]:
            arrays = {register: self._a[array][here] for register, array in STATES.items()}
            return self._registers.state(population, name, arrays)
        if isinstance(part.model, dc_generator) and name == "amplitude":
            return self._currents.amplitude(population).copy()
        return np.broadcast_to(self._registers.parameters[population][name], part.size).copy()

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters: all, or none where a register would overflow."""
        part = self.program.populations[population]
        names = [state.name for state in part.model.states]
        states = {name: each for name, each in values.items() if name in names}
        parameters = {name: each.copy() for name, each in values.items() if name not in names}
        if "E_L" in parameters and "V_m" not in states:
            states["V_m"] = self.get(population, "V_m")  # the register counts from E_L
        if isinstance(part.model, dc_generator):
            for target in self._currents.targets:  # refused here, not when it is on its way
                self._registers.bias(target, self._currents.full(target, {population: parameters["amplitude"]}))
        before = dict(self._registers.parameters[population])
        self._registers.parameters[population].update(parameters)
        if isinstance(part.model, poisson_generator):
            self._set_rate(population, parameters["rate"])
        elif isinstance(part.model, dc_generator):
            self._currents.set_amplitude(population, parameters["amplitude"], self.step)
        elif parameters and not isinstance(part.model, spike_generator):
            self._requantise(population)
        try:
            written = [self._registers.units(population, name, each) for name, each in states.items()]
        except ModelError:
            self._registers.parameters[population] = before
            self._requantise(population)
            raise
        for register, units in written:
            self._a[STATES[register]][self.slice(population)] = units

    def _set_rate(self, population: int, rate: Floats) -> None:
        here = self.slice(population)
        self._a["mean"][here] = rate * (self.program.resolution * 1e-3)
        self._a["nothing"][here] = np.exp(-self._a["mean"][here])

    def _requantise(self, population: int) -> None:
        """New registers of a population under its scale, and the words of what it receives where its gain changed."""
        found, wires = self._registers.again(population, self._weights.wanted(), self._learners)
        write_registers(self._a, population, found)
        self._weights.take(wires)
        self._bind()

    def registers(self, population: int, name: str) -> Ints:
        """A register, by its own name or that of what it stands for."""
        here = self.slice(population)
        register = self._registers.register_of(population, name)
        if register in STATES:
            return self._a[STATES[register]][here].astype(np.int64)
        values = self._registers.fixed[population].registers[register]
        return np.broadcast_to(values, here.stop - here.start).copy()

    def synapse_registers(self, projection: int, name: str) -> Ints:
        """The mantissa ("weight", "mantissa") or the tag ("t", "c") of every synapse.

        Raises:
            ModelError: there is no such register.
        """
        if projection in self._learners:
            tags = self._learners.raw(projection, name)
            if tags is not None:
                return tags
        if name not in ("weight", "mantissa"):
            raise unknown("register of synapses", name, ("weight", "t"))
        if projection in self._learners:
            return self._learners.mantissas(projection).astype(np.int64)
        return self._weights.raw(projection)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """A state of every synapse in physical units."""
        if projection in self._learners:
            if name != "weight":
                return self._learners.read(projection, name)
            return self._weights.read(projection, self._learners.mantissas(projection))
        return self._weights.read(projection)

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change the numbers of a synapse model."""
        if projection in self._learners:
            name = self.program.projections[projection].name
            raise ModelError(
                f"the rule of '{name}' is in the chip's microcode: it cannot be changed while it runs",
                hint="change the network and compile again",
            )
        self._weights.rules[projection] = parameters.copy()

    def set_weights(self, projection: int, weights: Floats) -> None:
        """Replace all weights: the host writes them, rounded to mantissas."""
        self._weights.set(projection, weights)
        if projection in self._learners:
            self._learners.set(projection, self._weights.mantissas[projection])
        self._bind()

    # accounts

    def spikes(self, population: int, since: int) -> Spikes:
        """Recorded spikes after a step."""
        here = self.slice(population)
        return self._record.spikes(here.start, here.stop, since)

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        self._record.forget(before)

    def counts(self) -> EngineCounts:
        """Counts since the start or the last reset."""
        here = [self.slice(k) for k in range(len(self.program.populations))]
        native = {
            f"{t.NATIVE[column]} of {part.name}": int(self._a["native"][k, column])
            for k, part in enumerate(self.program.populations)
            for column in range(t.NATIVE_COLUMNS)
            if self._a["native"][k, column]
        }
        return EngineCounts(
            steps=self.step,
            events=tuple(self._a["events"][place].copy() for place in here),
            spikes=tuple(self._a["spikes"][place].copy() for place in here),
            active=self._a["active"].copy(),
            trial_updates=self._weights.updates.copy(),
            native=native | self._weights.native() | self._learners.native(),
        )

    def memory(self) -> dict[str, int]:
        """Bytes by what they hold."""
        synapses = ("words", "lags", "rows", "targets")
        return {
            "neurons": sum(a.nbytes for name, a in self._a.items() if name not in synapses),
            "synapses": sum(self._a[name].nbytes for name in synapses)
            + self._weights.nbytes()
            + self._learners.nbytes(),
            "spikes": self._record.nbytes(),
        }

    def reset(self, weights: bool) -> None:
        """Back to step 0."""
        for name in _KEPT:
            self._a[name][:] = 0
        self._a["first"][:] = NEVER
        self._a["clock"][:] = 0
        self._a["clock"][t.STOP_GROUP] = t.NONE
        self.open_groups()
        for k in range(len(self.program.populations)):
            write_states(self._a, k, self._registers.fixed[k])
        self._record = Record()
        self._listed = Listed(self.program, self._a)
        self._start_currents_anew()
        self._weights.start_anew(weights)
        self._learners.start_anew(weights)
        self._told.clear()
        if self._trials:
            self._trials.start_anew()
        self._bind()

    def _start_currents_anew(self) -> None:
        """Amplitudes that were set hold from step 0."""
        before, self._currents = self._currents, Currents(self.program)
        for k, part in enumerate(self.program.populations):
            if isinstance(part.model, dc_generator):
                self._currents.set_amplitude(k, before.amplitude(k), 0)

    def open_groups(self) -> None:
        """No group has decided."""
        self._a["groups"][:, t.CLOSED], self._a["groups"][:, t.WINNER] = 0, t.NONE

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        return {
            **{f"live.{name}": self._a[name].copy() for name in _LIVE},
            **self._record.snapshot(),
            **self._listed.snapshot(),
            **self._currents.snapshot(),
            **self._weights.snapshot(),
            **self._learners.snapshot(),
            **self._registers.snapshot(),
            "trials.changes": np.array(self._trials.changes if self._trials else 0),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        self._weights.take(self._registers.restore(arrays))
        for k in range(len(self.program.populations)):
            write_registers(self._a, k, self._registers.fixed[k])
        for name in _LIVE:
            self._a[name][:] = arrays[f"live.{name}"]
        self._record.restore(arrays)
        self._listed.restore(arrays, self.step)
        self._currents.restore(arrays)
        self._weights.restore(arrays)
        self._learners.restore(arrays)
        if self._trials:
            self._trials.changes = int(arrays["trials.changes"])
        self._bind()
