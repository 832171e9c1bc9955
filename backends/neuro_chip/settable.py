"""What the engine of a chip reads and sets between steps: it translates registers for its callers."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed_program import FixedProgram
from neuro.core.errors import ModelError, unknown
from neuro.program.program import Floats, Ints, Program
from neuro_chip.build import STATES, write_registers
from neuro_chip.machine import Machine


class Settable:
    """A machine whose values are read and set by the numbers of its program's parts.

    Attributes:
        fixed: registers and words.
        program: what it runs.
    """

    fixed: FixedProgram
    program: Program
    _machine: Machine

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine of every synapse that listens."""
        self._machine.learners.signal(signal, values, self._machine.step)

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
            self._machine.currents.set(population, "amplitude", parameters["amplitude"], self._machine.step)
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
