"""How each family of chips runs here: its registers in the arrays of the loop, and the integer steps of its neurons.

A new family is a module like `loihi` and an entry here.
"""

from __future__ import annotations

from neuro.chips.description import Chip
from neuro_chip import tables as t
from neuro_chip.families import loihi, loihi2, spinnaker
from neuro_chip.families.family import ChipFamily

FAMILIES = {family.arithmetic.name: family for family in (loihi.FAMILY, loihi2.FAMILY, spinnaker.FAMILY)}
STEPS = {kind: step for family in FAMILIES.values() for kind, step in family.steps.items()}
"""The step of each kind of population of all families."""

NUMBERS = {kind: t.STEPPED + place for place, kind in enumerate(STEPS)}
"""What the loop calls each kind, column `KIND` of the table of populations."""


def family_of(chip: Chip) -> ChipFamily:
    """The family of an emulated chip."""
    return FAMILIES[chip.arithmetic]
