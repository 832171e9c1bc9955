"""The engine of the emulated chips: it drives the machine and translates registers for its callers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed_program import FixedProgram
from neuro.core.errors import ModelError, unknown
from neuro.program.backend import EngineCounts, Outcome, Spikes, Trial
from neuro.program.program import Floats, Ints
from neuro.program.spikes import carrying
from neuro_chip import tables as t
from neuro_chip.build import STATES, write_registers
from neuro_chip.machine import Machine
from neuro_chip.trials import ChipTrials


class ChipEngine:
    """A quantised program in execution; `neuro.program.backend.Engine` says what each method does.

    Args:
        fixed: registers and words.
        strict: whether an overflow during a run is an error instead of a warning.
    """

    def __init__(self, fixed: FixedProgram, strict: bool) -> None:
        self.fixed, self.program = fixed, fixed.program
        self._machine = Machine(fixed, strict)
        self._trials = ChipTrials(self._machine) if self.program.trials is not None else None

    # time

    @property
    def step(self) -> int:
        """The last finished step."""
        return self._machine.step

    def run(self, steps: int) -> None:
        """Advance."""
        self._machine.advance_to(self.step + steps)
        self._machine.check_overflows()

    # trials

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        assert self._trials is not None
        return self._trials.present(trial)

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply a rule's `teach` to the inputs of one neuron: the host does."""
        assert self._trials is not None
        self._trials.learn(projection, neuron, tick, lesson)

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply a rule's `encourage` to every weight of some maps: the host does."""
        assert self._trials is not None
        self._trials.encourage(projection, maps)

    # input

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population."""
        if self._machine.listed.add(population, steps, ids, self.step, payloads):
            self._machine.bind()

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine of every synapse that listens."""
        self._machine.learners.signal(signal, values, self.step)

    # reading and writing

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """A state in physical units, or a parameter as described, of every neuron or of some."""
        part, here = self.program.populations[population], self._machine.slice(population)
        if name in [state.name for state in part.model.states]:
            arrays = {register: self._machine.arrays[array][here] for register, array in STATES.items()}
            every = self._machine.cells.state(population, name, arrays)
        elif part.kind == "current" and name == "amplitude":
            every = self._machine.currents.parameter(population, "amplitude").copy()
        else:
            every = np.broadcast_to(self._machine.cells.parameters[population][name], part.size).copy()
        return every if ids is None else every[ids]

    def are_finite(self, population: int, states: Sequence[str]) -> bool:
        """As `neuro.program.backend.are_finite`: registers hold whole numbers."""
        return True

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters: all, or none where a register would overflow."""
        part = self.program.populations[population]
        names = [state.name for state in part.model.states]
        states = {name: each for name, each in values.items() if name in names}
        parameters = {name: each.copy() for name, each in values.items() if name not in names}
        for name in self._machine.cells.counted_from(population, parameters):
            states.setdefault(name, self.get(population, name))
        if part.kind == "current":
            machine, amplitude = self._machine, {population: parameters["amplitude"]}
            for target in machine.currents.targets:  # refused here, not when it is on its way
                machine.cells.bias(target, machine.currents.full(target, amplitude))
        before = dict(self._machine.cells.parameters[population])
        self._machine.cells.parameters[population].update(parameters)
        if part.kind == "poisson":
            self._machine.set_rate(population, parameters["rate"])
        elif part.kind == "current":
            self._machine.currents.set(population, "amplitude", parameters["amplitude"], self.step)
        elif parameters and part.kind != "listed":
            self._requantise(population)
        try:
            written = [self._machine.cells.units(population, name, each).items() for name, each in states.items()]
        except ModelError:
            self._machine.cells.parameters[population] = before
            self._requantise(population)
            raise
        found: dict[str, NDArray[np.int32]] = {}
        for register, units in chain.from_iterable(written):  # of one current that is both, the sum
            found[register] = found[register] + units if register in found else units
        for register, units in found.items():
            self._machine.arrays[STATES[register]][self._machine.slice(population)] = units

    def _requantise(self, population: int) -> None:
        """New registers of a population under its scale, and the words of what it receives where its gain changed."""
        found, wires = self._machine.cells.again(population, self._machine.weights.wanted(), self._machine.learners)
        write_registers(self._machine.arrays, self.fixed, population, found)
        self._machine.weights.take(wires)
        self._machine.bind()

    def registers(self, population: int, name: str) -> Ints:
        """A register, by its own name or that of what it stands for."""
        here = self._machine.slice(population)
        register = self._machine.cells.register_of(population, name)
        if register in STATES:
            return self._machine.arrays[STATES[register]][here].astype(np.int64)
        values = self._machine.cells.fixed[population].registers[register]
        return np.broadcast_to(values, here.stop - here.start).copy()

    def synapse_registers(self, projection: int, name: str) -> Ints:
        """The mantissa ("weight", "mantissa") or the tag ("t", "c") of every synapse, or its delay where that learns.

        Raises:
            ModelError: there is no such register.
        """
        for kept in (self._machine.learners, self._machine.delays):
            if projection in kept and (found := kept.raw(projection, name)) is not None:
                return found
        if name not in ("weight", "mantissa"):
            delay = ("delay",) if projection in self._machine.delays else ()
            raise unknown("register of synapses", name, ("weight", "t", *delay))
        if projection in self._machine.learners:
            return self._machine.learners.mantissas(projection).astype(np.int64)
        return self._machine.weights.raw(projection)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """A state of every synapse in physical units."""
        machine, learnt = self._machine, projection in self._machine.learners
        if projection in machine.delays and name == "delay":
            return machine.delays.read(projection)
        if learnt and name != "weight":
            return machine.learners.read(projection, name)
        return machine.weights.read(projection, machine.learners.mantissas(projection) if learnt else None)

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change the numbers of a synapse model."""
        if self.program.projections[projection].synapse.learns != "trials":
            name = self.program.projections[projection].name
            raise ModelError(
                f"the rule of '{name}' is in the chip's microcode: it cannot be changed while it runs",
                hint="change the network and compile again",
            )
        self._machine.weights.rules[projection] = parameters.copy()

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or those that are chosen: the host writes them, rounded to mantissas."""
        self._machine.send_ahead(projection)
        self._machine.weights.set(projection, weights, chosen)
        if projection in self._machine.learners:
            self._machine.learners.set(projection, self._machine.weights.mantissas[projection])
        self._machine.bind()

    # accounts

    def spikes(self, population: int, since: int) -> Spikes:
        """Recorded spikes after a step."""
        here = self._machine.slice(population)
        return carrying(self.program.populations[population], self._machine.record.spikes(here.start, here.stop, since))

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        self._machine.record.forget(before)

    def counts(self) -> EngineCounts:
        """Counts since the start or the last reset."""
        machine, a = self._machine, self._machine.arrays
        parts = [(part, machine.slice(k)) for k, part in enumerate(self.program.populations)]
        native = machine.native(t.NATIVE_COLUMNS) | machine.weights.native() | machine.learners.native()
        return EngineCounts(
            steps=self.step,
            events=tuple(a["events"][here].copy() for _, here in parts),
            spikes=tuple(a["events" if part.model.graded else "spikes"][here].copy() for part, here in parts),
            active=a["active"].copy(),
            trial_updates=machine.weights.updates.copy(),
            native=native,
        )

    def memory(self) -> dict[str, int]:
        """Bytes by what they hold."""
        machine, names = self._machine, ("words", "lags", "rows", "targets")
        synapses = sum(machine.arrays[name].nbytes for name in names)
        return {
            "neurons": sum(a.nbytes for a in machine.arrays.values()) - synapses,
            "synapses": synapses + machine.weights.nbytes() + machine.learners.nbytes(),
            "spikes": machine.record.nbytes(),
        }

    def reset(self, weights: bool) -> None:
        """Back to step 0."""
        self._machine.start_anew(weights)
        if self._trials:
            self._trials.start_anew()

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        changes = np.array(self._trials.changes if self._trials else 0)
        return {**self._machine.snapshot(), "trials.changes": changes}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        self._machine.restore(arrays)
        if self._trials:
            self._trials.changes = int(arrays["trials.changes"])
