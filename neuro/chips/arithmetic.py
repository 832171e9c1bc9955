"""What a family of chips computes: everything by which one family differs from another, beside limits and costs.

`neuro.chips.loihi` and `neuro.chips.spinnaker` each define one `Arithmetic`; `neuro.chips.arithmetics` lists them. What
is done for all families (quantising, placing, pricing) asks the object, never for a name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from neuro.chips.description import Chip
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection
from neuro.chips.quantising.inputs import Inputs, Options
from neuro.model.neurons import Neuron
from neuro.program.backend import Problem
from neuro.program.program import Floats, Population, Program

Projections = dict[int, FixedProjection]
"""Projections in words, by their index in the program."""


@dataclass(frozen=True, slots=True)
class Option:
    """Something of quantising that a user may set by hand, part by part.

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
        options: what users may set by hand.
        state_limit: the largest magnitude of a state register.
        register_of_one: what the delay register holds of a spike that acts one step after its emission.
        one_bit: whether a spike is one bit, so that several of a neuron in a step become one.
        in_rows: whether synapses lie in rows as long as the longest, else in blocks; see `neuro.chips.placing.packing`.
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
    in_rows: bool
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
