"""Descriptions of chips, with their limits and costs, and the mapping of a network to a chip's integers and cores.

from neuro.chips import chip, place, quantise

print(quantise(sim.program, chip("loihi")))     # registers, words and rounding errors
print(place(sim.program, chip("loihi")))        # cores, memory, hops
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.chips.description import Chip as Chip
    from neuro.chips.energy import (
        COLUMNS as COLUMNS,
        BillItem as BillItem,
        Energy as Energy,
        between as between,
        cells as cells,
        footnotes as footnotes,
    )
    from neuro.chips.fixed import FixedPopulation as FixedPopulation, FixedProjection as FixedProjection
    from neuro.chips.fixed_program import FixedProgram as FixedProgram, filled as filled
    from neuro.chips.hosting import HostWork as HostWork, mean_work as mean_work
    from neuro.chips.inputs import longest_lag as longest_lag
    from neuro.chips.known import arithmetic_of as arithmetic_of, chip as chip, chips as chips
    from neuro.chips.loihi_registers import bounds as bounds
    from neuro.chips.neurobench_report import neurobench as neurobench
    from neuro.chips.placing import Placement as Placement, place as place
    from neuro.chips.pricing import bill as bill, dense as dense, price as price
    from neuro.chips.quantising import names_of as names_of, quantise as quantise


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
