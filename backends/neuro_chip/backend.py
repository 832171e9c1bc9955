"""The backend objects of the emulated chips. numba is imported only when a backend builds an engine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from neuro.chips.arithmetic import Arithmetic
from neuro.chips.description import Chip
from neuro.chips.fitting import cut, fits_one_chip
from neuro.chips.known import CHIPS, arithmetic_of, chip, is_table
from neuro.chips.loihi import LOIHI
from neuro.chips.loihi2 import LOIHI2
from neuro.chips.quantising import quantise
from neuro.chips.spinnaker import SPINNAKER
from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity
from neuro.program.backend import Engine, Problem, unnoted
from neuro.program.program import Program
from neuro_chip.unsupported import LEARNING_CASES, REFRACTORY_CASES

_PLACING_OPTIONS = ("order", "neurons_per_core")
_STRICT = Quantity(kind="boolean")
_NOT_OF_QUANTISE = ("strict", *_PLACING_OPTIONS)


class ChipBackend:
    """An emulated chip: integers only, bit-identical to the public emulators.

    Args:
        family: the arithmetic of the chip.
        description: summary for users.
        unsupported: conformance cases that the chip cannot run, with reasons.
        target: the chip; by default the chip with the family's name.
    """

    arithmetic = "integer"

    def __init__(
        self, family: Arithmetic, description: str, unsupported: Mapping[str, str], target: Chip | None = None
    ) -> None:
        self.family, self.description, self.unsupported = family, description, dict(unsupported)
        self.name = family.name if target is None else target.name
        self._target = target

    @property
    def chip(self) -> Chip:
        """The chip, with its limits and costs."""
        return CHIPS[self.name] if self._target is None else self._target

    def of(self, target: str) -> ChipBackend | None:
        """Return the backend of another chip, by name or table file, in that chip's arithmetic; None for unknown names.

        Raises:
            ModelError: the chip has no emulated arithmetic, or its table cannot be read.
        """
        if not is_table(target) and target not in CHIPS:
            return None
        table = chip(target)
        base = next(backend for backend in FAMILIES if backend.family is arithmetic_of(table))
        if base.name == target:
            return base
        return ChipBackend(base.family, f"{table.title}, in the arithmetic of {base.name}", base.unsupported, table)

    def targets(self) -> Iterable[str]:
        """Return the names of all chips with this arithmetic."""
        return [name for name, entry in CHIPS.items() if entry.arithmetic == self.family.name]

    def problems(self, program: Program, **options: Any) -> Sequence[Problem]:
        """Return all refusals and approximations: by the chip's integers, and by the limits of its cores."""
        fixed = quantise(program, self.chip, **_quantise_options(options))
        placing = {name: value for name, value in options.items() if name in _PLACING_OPTIONS}
        problems = (*unnoted(program), *fixed.problems)
        cores = cut(program, self.chip, **placing)
        if fits_one_chip(program, self.chip, cores):
            return problems
        from neuro.chips.placing import place_cores  # one chip needs no positions of cores

        return (*problems, *place_cores(program, self.chip, cores).problems)

    def build(self, program: Program, *, threads: int = 1, **options: Any) -> Engine:
        """Return an engine at step 0.

        Args:
            program: the program to run.
            threads: ignored; the engine uses one thread.
            options: `strict` (an overflow is an error); `scales`, `shifts`, `exponents`, `signals`, see
                `neuro.chips.quantising`; `order`, `neurons_per_core`, see `neuro.chips.placing`.

        Raises:
            ModelError: the chip refuses the program, or an option is unknown.
        """
        fixed = quantise(program, self.chip, **_quantise_options(options))
        if refused := [problem for problem in fixed.problems if problem.refused]:
            raise ModelError(f"{refused[0].what}: {refused[0].why}", hint=refused[0].way_out)
        from neuro_chip.engine import ChipEngine

        return ChipEngine(fixed, strict=check(_STRICT, options.get("strict", False), "strict"))

    def replay(self, case: Mapping[str, Any], events: NDArray[Any]) -> Mapping[str, NDArray[Any]]:
        """Return the states after each call of SpiNNaker's programs in a case."""
        if self.family is not SPINNAKER:
            message = f"backend '{self.name}' cannot replay calls of SpiNNaker's programs"
            raise ModelError(message, hint="use backend 'spinnaker'")
        from neuro_chip.replay import replay

        return replay(case, events)


def _quantise_options(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name not in _NOT_OF_QUANTISE}


loihi = ChipBackend(LOIHI, "Intel Loihi 1, emulated bit for bit: integers, 8-bit weights, cores and their limits", {})
loihi2 = ChipBackend(
    LOIHI2,
    "Intel Loihi 2, emulated as lava does: graded spikes, sigma-delta and LIF neurons in integers",
    {
        **dict.fromkeys(LEARNING_CASES, "pairwise learning is not emulated on loihi2"),
        **dict.fromkeys(REFRACTORY_CASES, "no fixed-point neuron of Loihi 2 has a refractory period"),
    },
)
spinnaker = ChipBackend(
    SPINNAKER,
    "SpiNNaker 1, emulated: s16.15 neurons, 16-bit saturating ring buffers",
    {},
)
FAMILIES = (loihi, loihi2, spinnaker)
"""One backend for each arithmetic."""
