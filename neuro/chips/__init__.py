"""What is known of chips: limits, costs, and how a float program becomes one of integers on cores.

from neuro.chips import chip, place, quantise

print(quantise(sim.program, chip("loihi")))     # registers, words, and what rounding does
print(place(sim.program, chip("loihi")))        # cores, memory, hops
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily

if TYPE_CHECKING:
    from neuro.chips.description import Chip
    from neuro.chips.known import chip, chips
    from neuro.chips.placing.place import place
    from neuro.chips.placing.placement import Placement
    from neuro.chips.pricing.bill import bill
    from neuro.chips.pricing.energy import COLUMNS, Energy, between, cells
    from neuro.chips.pricing.footnotes import footnotes
    from neuro.chips.pricing.neurobench import neurobench
    from neuro.chips.pricing.price import price
    from neuro.chips.quantising.fixed_program import FixedProgram
    from neuro.chips.quantising.quantise import quantise
    from neuro.chips.quantising.room import filled

_HOMES = {
    "neuro.chips.description": ("Chip",),
    "neuro.chips.known": ("chip", "chips"),
    "neuro.chips.placing.place": ("place",),
    "neuro.chips.placing.placement": ("Placement",),
    "neuro.chips.pricing.bill": ("bill",),
    "neuro.chips.pricing.energy": ("COLUMNS", "Energy", "between", "cells"),
    "neuro.chips.pricing.footnotes": ("footnotes",),
    "neuro.chips.pricing.neurobench": ("neurobench",),
    "neuro.chips.pricing.price": ("price",),
    "neuro.chips.quantising.fixed_program": ("FixedProgram",),
    "neuro.chips.quantising.quantise": ("quantise",),
    "neuro.chips.quantising.room": ("filled",),
}

__all__ = [
    "COLUMNS",
    "Chip",
    "Energy",
    "FixedProgram",
    "Placement",
    "between",
    "bill",
    "cells",
    "chip",
    "chips",
    "filled",
    "footnotes",
    "neurobench",
    "place",
    "price",
    "quantise",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES)
