"""What a family of chips computes: everything by which one family differs from another, beside limits and costs.

`neuro.chips.loihi` and `neuro.chips.spinnaker` each define one `Arithmetic`; `neuro.chips.known` lists them.
Quantising, placing and pricing ask the object, never for a name. `options_of` checks what a user sets.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from neuro.chips.description import Chip
from neuro.chips.fixed import FixedPopulation, FixedProjection, Words
from neuro.chips.inputs import LEARN_ELSEWHERE, Inputs, Options, foreign, refused
from neuro.core.errors import ModelError, a, nearest
from neuro.model.neurons import Model, Neuron
from neuro.program.backend import SAVE_FROZEN, Problem
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


SIGNALS = Option(
    "signals",
    "projections",
    lambda value: is_positive(value),
    "the largest dopamine that the signal sets in 1/ms, a number > 0",
)
"""The option of families whose learning hears signals."""


class Arithmetic(ABC):
    """The integers of a family of chips.

    Attributes:
        name: as in a table's `arithmetic`, and in `chip` of the models whose parameters are its registers.
        title: for people.
        models: neuron models of the language that it can be.
        options: what users may set.
        state_limit: the largest magnitude of a state register.
        native_volt: units of the voltage register per mV of neurons that are described in registers.
        register_of_one: what the delay register holds of a spike that acts one step after its emission.
        one_bit: whether a spike is one bit, so that several of a neuron in a step become one.
        graded: whether a spike carries a payload.
        in_rows: whether synapses lie in rows as long as the longest, else in blocks; see `neuro.chips.incoming`.
        keeps_kernels: whether a core keeps a kernel once, and not each of its synapses.
        multicast: whether routers copy a spike that goes to several cores, else it is sent once for each.
        receptors: slots of a neuron for each step to come: 1, words of any sign are summed in 32 bits; 2, one for each
            sign, which saturate.
        word: type of the array of words.
        stands_for: the register that holds a state or a parameter, by the names of the language.
        states: the state registers of each kind of population (`FixedPopulation.kind`).
    """

    name: str
    title: str
    models: tuple[type[Neuron], ...]
    options: tuple[Option, ...]
    state_limit: int
    native_volt = 1.0
    register_of_one: int
    one_bit = False
    graded = False
    in_rows = False
    keeps_kernels = False
    multicast = False
    receptors = 1
    word: type[np.signedinteger[Any]] = np.int32
    stands_for: Mapping[str, str]
    states: Mapping[str, tuple[str, ...]]

    def option(self, name: str) -> Option | None:
        """Return the option of that name, None if it has none."""
        return next((option for option in self.options if option.name == name), None)

    @abstractmethod
    def population(self, inputs: Inputs, options: Options) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """Bring a population of `models` and the projections onto it into integers, and tell what cannot be."""

    def native(self, part: Population) -> FixedPopulation:
        """Return a population that is described in registers: its parameters are the registers."""
        registers = {name: values.astype(np.int64) for name, values in part.parameters.items() if name != "tau_minus"}
        initial = {name: values.astype(np.int64) for name, values in part.initial.items()}
        return FixedPopulation(part.name, part.model.name, registers, initial, self.native_volt)

    @abstractmethod
    def native_projection(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Bring a projection onto a population in registers into words, and tell what cannot be."""

    @abstractmethod
    def relay_projection(self, inputs: Inputs, index: int) -> FixedProjection:
        """Return a projection onto parrots, which the host relays: every spike counts, whatever its weight."""

    def give_rules(
        self, program: Program, chip: Chip, cells: list[FixedPopulation], wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Give rules to the projections that learn on the chip; yield what is refused and what is approximated.

        Args:
            program: the whole network.
            chip: for which it is quantised.
            cells: the populations in registers.
            wires: the projections in words; those that learn are replaced.
            options: what users set.
        """
        for index in range(len(program.projections)):
            yield from self.give_rule(program, chip, index, wires, options)

    def give_rule(
        self, program: Program, chip: Chip, index: int, wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Give a rule to one projection, as `give_rules` does.

        A family has no rules but those in its own registers, unless it overrides this method: other projections that
        learn are refused.
        """
        part = program.projections[index]
        if (problem := foreign(program, chip, index)) is not None:
            yield problem
        elif part.synapse.delays:
            why = f"delays do not change while {chip.name} runs"
            yield refused(part, part.synapse.name, why, LEARN_ELSEWHERE)
        elif part.synapse.learns in ("pairs", "chip") and (index not in wires or wires[index].rule is None):
            yield refused(
                part,
                part.synapse.name,
                f"pairwise learning is not emulated on {chip.name}",
                f"run it on loihi or event, or send static weights: {SAVE_FROZEN}",
            )

    def core_bytes(self, program: Program, chip: Chip, population: int, neurons: int) -> int:
        """Return the bytes of a core's own memory that learning onto some neurons takes, 0 where none is known."""
        return 0

    def told_of_learning(
        self,
        program: Program,
        chip: Chip,
        cores: Sequence[Sequence[tuple[int, int, int]]],
        visits: Mapping[int, tuple[float, float]] | None = None,
    ) -> Iterator[str]:
        """Yield what learning takes of the memory and of the time of the cores, as far as that is known.

        Args:
            program: has the projections.
            chip: has the limits.
            cores: populations on each, and their neurons first <= i < last.
            visits: of a step, by projection, the synapses of pre spikes and those of post spikes; None: all neurons
                spike once.
        """
        yield from ()

    @abstractmethod
    def kept_options(self, cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
        """Return the options with which a population and the projections onto it get the scale that they have."""

    def filled(self, cells: FixedPopulation, arriving: Floats) -> float:
        """Return the largest share of its registers that a population's input takes; of families with one receptor.

        Args:
            cells: the population.
            arriving: what arrives in each step, in words, (recordings, steps, neurons).
        """
        raise NotImplementedError

    @abstractmethod
    def told_scale(self, cells: FixedPopulation, wires: FixedProjection) -> str:
        """Return how the weights of a projection onto some cells are scaled, for the report."""

    def lossless(self, wires: FixedProjection) -> str:
        """Return the way out where weights that are described in registers lose bits, "" where they cannot."""
        return ""

    def notes(self, program: Program) -> Iterator[str]:
        """Yield what is to be known of a program on the machine."""
        yield from ()

    @abstractmethod
    def current(self, cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
        """Return a synaptic current in pA, of its name, from the state registers."""

    @abstractmethod
    def units(self, cells: FixedPopulation, name: str, values: Floats) -> Floats:
        """Return a synaptic current in pA as units of its register."""

    @abstractmethod
    def bias(self, cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
        """Return what is added in each step, with a current in pA beside the constant one.

        Raises:
            ModelError: it overflows its register.
        """

    @abstractmethod
    def words(self, wires: FixedProjection, mantissas: Words) -> Words:
        """Return what a spike adds for some mantissas."""

    @abstractmethod
    def way_out(self, cells: FixedPopulation) -> str:
        """Return what would keep the registers of a population from overflowing, "" where nothing is known."""


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
        if option.of == "populations":
            models: dict[str, Model] = {part.name: part.model for part in program.populations}
        else:
            models = {part.name: program.populations[part.target].model for part in program.projections}
        expected = "populations" if option.of == "populations" else "projections onto populations"
        for part, value in values.items():
            if part not in models:
                raise ModelError(f"{name}: unknown part '{part}'", hint=nearest(part, models))
            if not isinstance(models[part], arithmetic.models):
                known_models = " or ".join(model.__name__ for model in arithmetic.models)
                found = f"{name}['{part}']: {a(models[part].name)}"
                raise ModelError(f"{found}: expected {expected} of {known_models}")
            if not option.fits(value):
                raise ModelError(f"{name}['{part}'] = {value!r}: expected {option.expected}")
    return Options(options)


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number > 0."""
    kind = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return kind and bool(np.isfinite(value)) and bool(value > 0)


def is_whole(value: Any, allowed: Container[int]) -> bool:
    """Whether a value is a whole number among those allowed."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed
