"""Reading and setting of values between steps, translated between physical units and the registers of a chip."""

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
    """Base class that reads and sets values of a machine. A population or projection is given by its index.

    Attributes:
        fixed: the program in registers of neurons and words of synapses.
        program: the program that runs.
    """

    fixed: FixedProgram
    program: Program
    _machine: Machine

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine of every synapse with this signal."""
        self._machine.learners.signal(signal, values, self._machine.step)

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """Return a state in physical units, or a parameter, of all neurons or of some."""
        part, neurons = self.program.populations[population], self._machine.slice(population)
        if name in [state.name for state in part.model.states]:
            arrays = {register: self._machine.arrays[array][neurons] for register, array in STATES.items()}
            all_values = self._machine.cells.state(population, name, arrays)
        elif part.kind == "current" and name == "amplitude":
            all_values = self._machine.currents.parameter(population, "amplitude").copy()
        else:
            all_values = np.broadcast_to(self._machine.cells.parameters[population][name], part.size).copy()
        return all_values if ids is None else all_values[ids]

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters: all of them, or none if a register would overflow."""
        part = self.program.populations[population]
        names = [state.name for state in part.model.states]
        states = {name: value for name, value in values.items() if name in names}
        parameters = {name: value.copy() for name, value in values.items() if name not in names}
        for name in self._machine.cells.relative_to_rest(population, parameters):
            states.setdefault(name, self.get(population, name))
        if part.kind == "current":
            machine, amplitude = self._machine, {population: parameters["amplitude"]}
            for target in machine.currents.targets:  # an overflow is refused now, not in a later step
                machine.cells.bias(target, machine.currents.full(target, amplitude))
        old_parameters = dict(self._machine.cells.parameters[population])
        self._machine.cells.parameters[population].update(parameters)
        if part.kind == "poisson":
            self._machine.set_rate(population, parameters["rate"])
        elif part.kind == "current":
            self._machine.currents.set(population, "amplitude", parameters["amplitude"], self._machine.step)
        elif parameters and part.kind != "listed":
            self._requantise(population)
        try:
            all_units = [self._machine.cells.units(population, name, value).items() for name, value in states.items()]
        except ModelError:
            self._machine.cells.parameters[population] = old_parameters
            self._requantise(population)
            raise
        sums: dict[str, NDArray[np.int32]] = {}
        for register, units in chain.from_iterable(all_units):  # several states can share a register
            sums[register] = sums[register] + units if register in sums else units
        for register, units in sums.items():
            self._machine.arrays[STATES[register]][self._machine.slice(population)] = units

    def _requantise(self, population: int) -> None:
        """Write new registers of a population at the present scale, and new words of projections whose gain changed."""
        weights = self._machine.weights.before_rounding()
        cells, wires = self._machine.cells.requantised(population, weights, self._machine.learners)
        write_registers(self._machine.arrays, self.fixed, population, cells)
        self._machine.weights.take(wires)
        self._machine.bind()

    def registers(self, population: int, name: str) -> Ints:
        """Return a register. `name` is the name of the register, or of the state or parameter that it stores."""
        neurons = self._machine.slice(population)
        register = self._machine.cells.register_of(population, name)
        if register in STATES:
            return self._machine.arrays[STATES[register]][neurons].astype(np.int64)
        values = self._machine.cells.fixed[population].registers[register]
        return np.broadcast_to(values, neurons.stop - neurons.start).copy()

    def synapse_registers(self, projection: int, name: str) -> Ints:
        """Return a register of each synapse.

        The names are "weight" or "mantissa" for the mantissa, "t" or "c" for the tag, and "delay" for a learnt delay.

        Raises:
            ModelError: there is no such register.
        """
        for memory in (self._machine.learners, self._machine.delays):
            if projection in memory and (values := memory.raw(projection, name)) is not None:
                return values
        if name not in ("weight", "mantissa"):
            delay = ("delay",) if projection in self._machine.delays else ()
            raise unknown("register of synapses", name, ("weight", "t", *delay))
        if projection in self._machine.learners:
            return self._machine.learners.mantissas(projection).astype(np.int64)
        return self._machine.weights.raw(projection)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """Return a state of every synapse in physical units."""
        machine, learns = self._machine, projection in self._machine.learners
        if projection in machine.delays and name == "delay":
            return machine.delays.read(projection)
        if learns and name != "weight":
            return machine.learners.read(projection, name)
        return machine.weights.read(projection, machine.learners.mantissas(projection) if learns else None)

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change the parameters of a synapse model."""
        if self.program.projections[projection].synapse.learns != "trials":
            name = self.program.projections[projection].name
            raise ModelError(
                f"the rule of '{name}' is in the chip's microcode: it cannot be changed while it runs",
                hint="change the network and compile again",
            )
        self._machine.weights.rules[projection] = parameters.copy()

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or the chosen ones; the host writes them, rounded to mantissas."""
        self._machine.send_ahead(projection)
        self._machine.weights.set(projection, weights, chosen)
        if projection in self._machine.learners:
            self._machine.learners.set(projection, self._machine.weights.mantissas[projection])
        self._machine.bind()
