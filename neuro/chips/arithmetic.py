"""What a family of chips computes: everything by which one family differs from another, beside limits and costs.

`neuro.chips.loihi` and `neuro.chips.spinnaker` each define one `Arithmetic`; `neuro.chips.arithmetics` lists them.
Quantising, placing and pricing ask the object, never for a name. `options_of` checks what a user sets.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection
from neuro.chips.quantising.inputs import Inputs, Options
from neuro.core.english import a
from neuro.core.errors import ModelError, nearest
from neuro.model.neurons import Model, Neuron
from neuro.program.backend import Problem
from neuro.program.program import Floats, Population, Program

Projections = dict[int, FixedProjection]
"""Projections in words, by their index in the program."""


@dataclass(frozen=True, slots=True)
class Option:
    """Something of quantising that a user may set, part by part.

    Attributes:
        name: as given to `neuro.compile`, e.g. "scales".
        of: the parts that have it.
        fits: whether a value can be.
        expected: what a value is, for messages.
    """

    name: str
    of: Literal["populations", "projections"]
    fits: Callable[[Any], bool]
    expected: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arithmetic:
    """The integers of a family of chips.

    Attributes:
        name: as in a table's `arithmetic`, and in `chip` of the models whose parameters are its registers.
        title: for people.
        models: neuron models of the language that it can be.
        options: what users may set.
        state_limit: the largest magnitude of a state register.
        register_of_one: what the delay register holds of a spike that acts one step after its emission.
        one_bit: whether a spike is one bit, so that several of a neuron in a step become one.
        graded: whether a spike carries a payload.
        in_rows: whether synapses lie in rows as long as the longest, else in blocks; see `neuro.chips.placing.packing`.
        keeps_kernels: whether a core keeps a kernel once, and not each of its synapses.
        multicast: whether routers copy a spike that goes to several cores, else it is sent once for each.
        population: a population of `models` and the projections onto it, with what cannot be.
        native: a population that is described in registers.
        native_projection: a projection onto such a population, with what cannot be.
        relay_projection: a projection onto parrots, which the host relays.
        give_rules: gives rules to the projections that learn on the chip, which are replaced in the mapping; tells what
            is refused and what is approximated.
        kept_options: the options with which a population gets the scale that it has; of the population and the
            projections onto it.
        filled: the largest share of its registers that a population's input takes, of what arrives in each step, in
            words, (recordings, steps, neurons); None where registers saturate, or depend on more.
        told_scale: how the weights of a projection are scaled, for the report; of its target and itself.
        lossless: the way out where weights that are described in registers lose bits, "" where they cannot.
        notes: what is to be known of a program on the machine.
    """

    name: str
    title: str
    models: tuple[type[Neuron], ...]
    options: tuple[Option, ...]
    state_limit: int
    register_of_one: int
    one_bit: bool
    graded: bool
    in_rows: bool
    keeps_kernels: bool
    multicast: bool
    population: Callable[[Inputs, Options], tuple[FixedPopulation, Projections, list[Problem]]]
    native: Callable[[Population], FixedPopulation]
    native_projection: Callable[[Inputs, int], tuple[FixedProjection, list[Problem]]]
    relay_projection: Callable[[Inputs, int], FixedProjection]
    give_rules: Callable[[Program, Chip, Projections, Options], Iterator[Problem]]
    kept_options: Callable[[FixedPopulation, tuple[FixedProjection, ...]], Options]
    filled: Callable[[FixedPopulation, Floats], float] | None
    told_scale: Callable[[FixedPopulation, FixedProjection], str]
    lossless: Callable[[FixedProjection], str]
    notes: Callable[[Program], Iterator[str]]

    def option(self, name: str) -> Option | None:
        """The option of that name, None if it has none."""
        return next((option for option in self.options if option.name == name), None)


EVERYWHERE = ("strict", "order", "neurons_per_core")
"""Options of a chip backend that quantising does not look at, for hints."""


def options_of(program: Program, chip: Chip, arithmetic: Arithmetic, options: Mapping[str, Any]) -> Options:
    """Options by name, checked.

    Args:
        program: has the parts.
        chip: for messages.
        arithmetic: of the chip.
        options: by name, then by part.

    Raises:
        ModelError: one is unknown, is of another chip, or names a part that does not exist or a value that cannot be.
    """
    for name, values in options.items():
        option = arithmetic.option(name)
        if option is None:
            known = [known.name for known in arithmetic.options]
            raise ModelError(f"backend '{chip.name}' has no option '{name}'", hint=nearest(name, [*known, *EVERYWHERE]))
        if not isinstance(values, Mapping):
            raise ModelError(f"{name} = {values!r}: expected values by name, such as {{'exc': ...}}")
        for part, value in values.items():
            _check_part(program, arithmetic, option, part)
            if not option.fits(value):
                raise ModelError(f"{name}['{part}'] = {value!r}: expected {option.expected}")
    return Options(options)


def _check_part(program: Program, arithmetic: Arithmetic, option: Option, name: str) -> None:
    """Refuse a part that does not exist or that has nothing to set."""
    if option.of == "populations":
        models: dict[str, Model] = {part.name: part.model for part in program.populations}
        expected = "populations"
    else:
        models = {part.name: program.populations[part.target].model for part in program.projections}
        expected = "projections onto populations"
    if name not in models:
        raise ModelError(f"{option.name}: unknown part '{name}'", hint=nearest(name, models))
    if not isinstance(models[name], arithmetic.models):
        known = " or ".join(model.__name__ for model in arithmetic.models)
        message = f"{option.name}['{name}']: {a(models[name].name)}: expected {expected} of {known}"
        raise ModelError(message)


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number > 0."""
    kind = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return kind and bool(np.isfinite(value)) and bool(value > 0)


def is_whole(value: Any, allowed: Container[int]) -> bool:
    """Whether a value is a whole number among those allowed."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed
