"""The populations of a running program: reading and setting their registers and parameters."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed import FixedPopulation, FixedProjection
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.known import arithmetic_of
from neuro.chips.quantising import names_of, requantise, shares
from neuro.core.errors import ModelError, unknown
from neuro.model.equations import EquationNeuron
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints

_FIXED_SCALE = "a running chip keeps its scale: describe the network with these values, or lower them"


class ChipRegisters:
    """The populations of a running quantised program.

    Attributes:
        fixed: each population's present registers.
        parameters: each population's present parameters, in units of the language.
    """

    def __init__(self, fixed: FixedProgram) -> None:
        self._program, self._arithmetic = fixed, arithmetic_of(fixed.chip)
        self.fixed = list(fixed.populations)
        self.parameters = [dict(p.parameters) for p in fixed.program.populations]
        self._names = [names_of(part) for part in fixed.program.populations]
        self._good = [dict(parameters) for parameters in self.parameters]

    def names(self, population: int, name: str) -> tuple[str, ...]:
        """Return the states of the chip's model whose sum equals a state of the population."""
        return self._names[population].get(name, (name,))

    def relative_to_rest(self, population: int, parameters: Container[str]) -> list[str]:
        """Return the name of the potential if one of `parameters` can change the resting potential, stored as 0."""
        model = self._program.program.populations[population].model
        if "E_L" not in parameters and not isinstance(model, EquationNeuron):
            return []
        return [name for name, names in self._names[population].items() if names == ("V_m",)]

    def state(self, population: int, name: str, arrays: Mapping[str, NDArray[np.int32]]) -> Floats:
        """Return a state in the unit of its model, from the state registers."""
        first, *other_states = (self._state(population, state, arrays) for state in self.names(population, name))
        return sum(other_states, start=first)

    def _state(self, population: int, name: str, arrays: Mapping[str, NDArray[np.int32]]) -> Floats:
        part = self.fixed[population]
        if name in self._arithmetic.states.get(part.kind, ()):
            return arrays[name].astype(np.float64)
        if name == "V_m":
            values: Floats = arrays["v"] / part.volt + part.rest
            return values
        return self._arithmetic.current(part, name, arrays)

    def units(self, population: int, name: str, values: Floats) -> dict[str, NDArray[np.int32]]:
        """Return the state registers that hold a state, with the values in units of each register.

        Raises:
            ModelError: a value does not fit.
        """
        names, registers = self.names(population, name), dict[str, NDArray[np.int32]]()
        for state, share in zip(names, shares(values, names), strict=True):
            register, units = self._units(population, state, share)
            registers[register] = registers[register] + units if register in registers else units
        return registers

    def _units(self, population: int, name: str, values: Floats) -> tuple[str, NDArray[np.int32]]:
        part = self.fixed[population]
        register = self.register_of(population, name)
        exact = values
        if name == "V_m":
            exact = (values - part.rest) * part.volt
        elif name in ("I_syn_ex", "I_syn_in"):
            exact = self._arithmetic.units(part, name, values)
        elif (fractional := values[values != np.rint(values)]).size:
            raise ModelError(
                f"population '{part.name}': {name} = {fractional[0]:g}: register '{name}' holds whole numbers"
            )
        limit = self._arithmetic.state_limit
        bad = np.flatnonzero(np.abs(exact) > limit)
        if bad.size:
            raise ModelError(
                f"population '{part.name}': {name} = {values[min(bad[0], values.size - 1)]:g}: "
                f"its register '{register}' holds at most {limit} units"
            )
        return register, np.rint(exact).astype(np.int32)

    def bias(self, population: int, current: Floats) -> NDArray[np.int32]:
        """Return the bias of each step: the constant bias plus the bias of an extra current in pA."""
        return self._arithmetic.bias(self.fixed[population], current)

    def register_of(self, population: int, name: str) -> str:
        """Return the register that holds a state or parameter. The name of a register is returned unchanged.

        Raises:
            ModelError: the population has no such register.
        """
        part, name = self.fixed[population], self.names(population, name)[0]
        register_names = [*self._arithmetic.states.get(part.kind, ()), *part.registers]
        holders = self._arithmetic.stands_for
        if holders.get(name) in register_names:
            return holders[name]
        if name not in register_names:
            raise unknown("register", name, register_names).at(None, f"population '{part.name}'")
        return name

    def requantised(
        self, population: int, weights: Mapping[int, Floats], learning: Container[int]
    ) -> tuple[FixedPopulation, dict[int, FixedProjection]]:
        """Return new registers of a population for the present parameters, at the present scale.

        Args:
            population: the index of the population.
            weights: the weights of all projections before rounding.
            learning: projections that learn on the chip; their rules hold for one scale only.

        Returns:
            the population, and the projections onto it.

        Raises:
            ModelError: a register would overflow, or a rule would no longer hold; nothing is changed.
        """
        part = self._program.program.populations[population]
        if part.kind != "neuron":
            return self.fixed[population], {}
        cells, wires, problems = requantise(self._program, population, self.parameters[population], weights)
        refused = [replace(problem, way_out=_FIXED_SCALE) for problem in problems if problem.refused]
        for k, new in wires.items():
            old_part = self._program.projections[k]
            if k in learning and (old_part is None or not np.array_equal(old_part.step, new.step)):
                name = self._program.program.projections[k].name
                reason = "the change gives its weights another scale, but the chip's microcode is for one scale"
                way_out = "change the network and compile again"
                refused.append(Problem(True, f"projection '{name}' learns", reason, way_out))
        if refused:
            self.parameters[population] = dict(self._good[population])
            raise ModelError(f"{refused[0].what}: {refused[0].why}", hint=refused[0].way_out)
        self.fixed[population] = cells
        self._good[population] = dict(self.parameters[population])
        return cells, wires

    def snapshot(self) -> dict[str, Ints | Floats]:
        """Return the parameters by population."""
        return {
            f"parameter.{k}.{name}": values.copy()
            for k, parameters in enumerate(self.parameters)
            for name, values in parameters.items()
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> dict[int, FixedProjection]:
        """Restore a snapshot; return the projections onto all populations at their restored scales."""
        projections: dict[int, FixedProjection] = {}
        for k, parameters in enumerate(self.parameters):
            for name in parameters:
                parameters[name] = arrays[f"parameter.{k}.{name}"].copy()
            part = self._program.program.populations[k]
            if part.kind == "neuron":
                self.fixed[k], wires, _ = requantise(self._program, k, parameters, {})
                projections |= wires
            self._good[k] = dict(parameters)
        return projections
