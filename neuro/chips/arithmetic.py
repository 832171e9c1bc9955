"""Interface between a chip family and quantising, placing and pricing: all differences between families.

`neuro.chips.loihi`, `neuro.chips.loihi2` and `neuro.chips.spinnaker` each define one `Arithmetic`; `neuro.chips.known`
lists them. Quantising, placing and pricing call its methods and never look at a chip's name. Limits and costs are in
the table of each chip. `options_of` checks the options that a user sets.
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
    """An option of quantising that a user may set for each population or projection.

    Attributes:
        name: name of the argument of `neuro.compile`, e.g. "scales".
        of: the kind of parts that have the option.
        fits: function that returns True for an allowed value.
        expected: description of an allowed value, for messages.
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
"""Option of families whose learning can take its dopamine from a signal."""


class Arithmetic(ABC):
    """The integer arithmetic of a family of chips.

    Attributes:
        name: name in `arithmetic` of a chip's table, and in `chip` of the models whose parameters are registers of the
            family.
        title: name of the family for readers.
        models: neuron models of the language that the family can run.
        options: options that users may set.
        state_limit: largest magnitude of a state register.
        native_volt: units of the voltage register per mV, for neurons described in registers.
        register_of_one: content of the delay register for a delay of one step.
        one_bit: whether a spike is one bit, so that several spikes of a neuron in a step are merged.
        graded: whether a spike carries a payload.
        in_rows: whether synapses are stored in rows as long as the longest one, otherwise in blocks; see
            `neuro.chips.incoming`.
        keeps_kernels: whether a core stores a kernel once instead of each of its synapses.
        multicast: whether routers copy a spike for several cores; otherwise a source sends a spike to each core.
        receptors: input slots of a neuron per future step. With 1, words of any sign are summed in 32 bits. With 2,
            each sign has a slot that saturates.
        word: type of the array of words.
        stands_for: the register that holds each state and parameter of the language.
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
        """Return the option with a name, or None."""
        return next((option for option in self.options if option.name == name), None)

    @abstractmethod
    def population(self, inputs: Inputs, options: Options) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """Quantise a population of `models` and the projections onto it; also return refusals and approximations."""

    def native(self, part: Population) -> FixedPopulation:
        """Return a population described in registers, which are its parameters."""
        registers = {name: values.astype(np.int64) for name, values in part.parameters.items() if name != "tau_minus"}
        initial = {name: values.astype(np.int64) for name, values in part.initial.items()}
        return FixedPopulation(part.name, part.model.name, registers, initial, self.native_volt)

    @abstractmethod
    def native_projection(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Quantise a projection onto a population in registers; also return the refusals and approximations."""

    @abstractmethod
    def relay_projection(self, inputs: Inputs, index: int) -> FixedProjection:
        """Return a projection onto parrots. The host relays every spike, independent of the weight."""

    def give_rules(
        self, program: Program, chip: Chip, cells: list[FixedPopulation], wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Set the rules of the projections that learn on the chip; yield refusals and approximations.

        Args:
            program: the whole network.
            chip: the chip for which the network is quantised.
            cells: the quantised populations.
            wires: the quantised projections. Projections that learn are replaced by copies with a rule.
            options: options that users set.
        """
        for index in range(len(program.projections)):
            yield from self.give_rule(program, chip, index, wires, options)

    def give_rule(
        self, program: Program, chip: Chip, index: int, wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Set the rule of one projection, see `give_rules`.

        The default implementation accepts only rules in the family's own registers and refuses other learning
        projections.
        """
        projection = program.projections[index]
        if (problem := foreign(program, chip, index)) is not None:
            yield problem
        elif projection.synapse.delays:
            reason = f"delays do not change while {chip.name} runs"
            yield refused(projection, projection.synapse.name, reason, LEARN_ELSEWHERE)
        elif projection.synapse.learns in ("pairs", "chip") and (index not in wires or wires[index].rule is None):
            yield refused(
                projection,
                projection.synapse.name,
                f"pairwise learning is not emulated on {chip.name}",
                f"run it on loihi or event, or send static weights: {SAVE_FROZEN}",
            )

    def core_bytes(self, program: Program, chip: Chip, population: int, neurons: int) -> int:
        """Return the bytes of a core's own memory for learning onto some neurons; 0 if the family counts none."""
        return 0

    def learning_notes(
        self,
        program: Program,
        chip: Chip,
        cores: Sequence[Sequence[tuple[int, int, int]]],
        visits: Mapping[int, tuple[float, float]] | None = None,
    ) -> Iterator[str]:
        """Yield notes on the memory and time for learning on the cores, if figures are published.

        Args:
            program: the whole network.
            chip: the chip with the limits.
            cores: the parts (population, first, last) of each core, with the neurons first <= i < last.
            visits: mean number of synapses per step that pre spikes and post spikes visit, by projection. None: every
        neuron spikes once.
        """
        yield from ()

    @abstractmethod
    def scale_options(self, cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
        """Return the options that fix the present scale of a population and of the projections onto it."""

    def filled(self, cells: FixedPopulation, arriving: Floats) -> float:
        """Return the largest input of a population as a share of its register's range, for families with one receptor.

        Args:
            cells: the population.
            arriving: input of each step in words, shape (recordings, steps, neurons).
        """
        raise NotImplementedError

    @abstractmethod
    def scale_text(self, cells: FixedPopulation, wires: FixedProjection) -> str:
        """Return the scale of the weights of a projection onto a population as text for the report."""

    def lossless(self, wires: FixedProjection) -> str:
        """Return a hint that avoids lost bits of weights in registers; "" if no bits can be lost."""
        return ""

    def notes(self, program: Program) -> Iterator[str]:
        """Yield notes on how the machine runs a program."""
        yield from ()

    @abstractmethod
    def current(self, cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
        """Return a synaptic current in pA, from the state registers."""

    @abstractmethod
    def units(self, cells: FixedPopulation, name: str, values: Floats) -> Floats:
        """Return a synaptic current in pA as units of its register."""

    @abstractmethod
    def bias(self, cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
        """Return the bias of each step: the constant bias plus the bias of an extra current in pA.

        Raises:
            ModelError: the bias overflows its register.
        """

    @abstractmethod
    def words(self, wires: FixedProjection, mantissas: Words) -> Words:
        """Convert mantissas to words, the amounts that a spike adds."""

    @abstractmethod
    def way_out(self, cells: FixedPopulation) -> str:
        """Return a hint that prevents overflow of a population's registers; "" for none."""


EVERYWHERE = ("strict", "order", "neurons_per_core")
"""Options of a chip backend that quantising ignores, for hints."""


def options_of(program: Program, chip: Chip, arithmetic: Arithmetic, options: Mapping[str, Any]) -> Options:
    """Check the options of a user and return them by name.

    Args:
        program: the whole network.
        chip: the chip, for messages.
        arithmetic: the chip's arithmetic.
        options: values by option, then by part.

    Raises:
        ModelError: an option is unknown or belongs to another chip, a part does not exist, or a value is not allowed.
    """
    for name, values in options.items():
        option = arithmetic.option(name)
        if option is None:
            names = [names.name for names in arithmetic.options]
            raise ModelError(f"backend '{chip.name}' has no option '{name}'", hint=nearest(name, [*names, *EVERYWHERE]))
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
                subject = f"{name}['{part}']: {a(models[part].name)}"
                raise ModelError(f"{subject}: expected {expected} of {known_models}")
            if not option.fits(value):
                raise ModelError(f"{name}['{part}'] = {value!r}: expected {option.expected}")
    return Options(options)


def is_positive(value: Any) -> bool:
    """Return whether a value is a finite number > 0."""
    kind = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return kind and bool(np.isfinite(value)) and bool(value > 0)


def is_whole(value: Any, allowed: Container[int]) -> bool:
    """Return whether a value is one of the allowed whole numbers."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed
