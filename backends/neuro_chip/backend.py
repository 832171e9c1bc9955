"""The backend objects; numba is imported only when one builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from neuro.chips.description import Chip
from neuro.chips.known import chip
from neuro.chips.placing.place import place
from neuro.chips.quantising.quantise import quantise
from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity
from neuro.program.backend import Engine, Problem
from neuro.program.program import Program

OF_PLACE = ("order", "neurons_per_core")
_STRICT = Quantity(kind="boolean")
OWN = ("strict", *OF_PLACE)
LEARNING_CASES = (
    "counts_of_learning",
    "cutting_does_not_matter_of_learning",
    "cutting_does_not_matter_when_steered_of_learning",
    "probes_do_not_matter_of_learning",
    "a_seed_repeats_of_learning",
    "seeds_differ_of_learning",
    "threads_do_not_matter_of_learning",
    "a_reset_repeats_of_learning",
    "a_reset_keeps_weights_of_learning",
    "another_population_does_not_matter_of_learning",
    "counts_follow_from_spikes_of_learning",
    "a_saved_state_continues_of_learning",
    "a_state_saved_after_a_change_continues_of_learning",
)
"""Conformance cases of `neuro.testing` in which synapses learn from pairs of spikes."""


class ChipBackend:
    """An emulated chip: integers only, bit-true to the public emulators."""

    arithmetic = "integer"

    def __init__(self, name: str, description: str, unsupported: Mapping[str, str]) -> None:
        self.name, self.description, self.unsupported = name, description, dict(unsupported)

    @property
    def chip(self) -> Chip:
        """Limits and costs of the chip."""
        return chip(self.name)

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """What does not fit into the chip's integers or onto its cores, and what is approximated."""
        fixed = quantise(program, self.chip, **_of_quantise(options))
        return (*fixed.problems, *place(program, self.chip, **_of_place(options)).problems)

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Engine:
        """Make an engine at step 0.

        Args:
            program: what to run.
            threads: accepted; one thread computes.
            options: `strict` (an overflow is an error); `scales`, `shifts`, `exponents`, `signals`, see
                `neuro.chips.quantising.quantise`; `order`, `neurons_per_core`, see `neuro.chips.placing.place`.

        Raises:
            ModelError: the chip refuses the program, or an option is unknown.
        """
        fixed = quantise(program, self.chip, **_of_quantise(options))
        if refused := [problem for problem in fixed.problems if problem.refused]:
            raise ModelError(f"{refused[0].what}: {refused[0].why}", hint=refused[0].way_out)
        from neuro_chip.engine import ChipEngine

        return ChipEngine(fixed, strict=check(_STRICT, options.get("strict", False), "strict"))


def _of_place(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name in OF_PLACE}


def _of_quantise(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name not in OWN}


loihi = ChipBackend("loihi", "Intel Loihi 1, emulated bit for bit: integers, 8-bit weights, cores and their limits", {})
spinnaker = ChipBackend(
    "spinnaker",
    "SpiNNaker 1, emulated: s16.15 neurons, 16-bit saturating ring buffers",
    dict.fromkeys(LEARNING_CASES, "pairwise learning is not emulated on SpiNNaker"),
)
