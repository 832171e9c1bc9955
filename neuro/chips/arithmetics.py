"""The families of chips whose arithmetic is emulated, by name: a new one is a folder like `loihi` and an entry here."""

from __future__ import annotations

from neuro.chips.arithmetic import Arithmetic
from neuro.chips.description import Chip
from neuro.chips.loihi.arithmetic import LOIHI
from neuro.chips.loihi2 import LOIHI2
from neuro.chips.spinnaker import SPINNAKER
from neuro.core.errors import ModelError

ARITHMETICS = {arithmetic.name: arithmetic for arithmetic in (LOIHI, LOIHI2, SPINNAKER)}


def arithmetic_of(chip: Chip) -> Arithmetic:
    """The arithmetic of a chip.

    Raises:
        ModelError: none is known here.
    """
    if chip.arithmetic not in ARITHMETICS:
        raise ModelError(
            f"chip '{chip.name}' has no arithmetic here: expected one of {', '.join(ARITHMETICS)}",
            hint="its limits and costs serve placing and energy only",
        )
    return ARITHMETICS[chip.arithmetic]


def placed_as(chip: Chip) -> Arithmetic:
    """The arithmetic by which a chip packs synapses, sends spikes and counts delays: Loihi 1's where none is known."""
    return ARITHMETICS.get(chip.arithmetic, LOIHI)
