"""How long a chip takes for a run.

With `step_s` steps are real time: steps x `step_s`. Else they take as long as their work: steps x the barrier, linear
in the number of tiles through the two published points, plus the work of the busiest core: the updates of its
neurons, and of each projection's synaptic operations and learning updates its share of the target's neurons. That is
a lower bound: the busiest core may be another in every step, and the time that spikes travel is left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.chips.description import Chip
from neuro.chips.pricing.energy import CHIP_TIME, quantity, sourced
from neuro.program.counts import Counts
from neuro.program.program import Program

if TYPE_CHECKING:
    from neuro.chips.placing.placement import Placement

BARRIERS = ("barrier_1_tile_time", "barrier_32_tiles_time")
WORK = ("synaptic_op_time", "neuron_update_active_time", "neuron_update_inactive_time", "learning_update_time")
TILES = 32


def chip_time(program: Program, counts: Counts, placement: Placement | None, chip: Chip) -> float | None:
    """Seconds that a chip takes for a run; None if no times are published, or nothing is placed."""
    if chip.step_s is not None:
        return counts.steps * chip.step_s.value
    if placement is None or not all(name in chip.costs for name in BARRIERS):
        return None
    one, many = (chip.costs[name].value for name in BARRIERS)
    barrier = one + (many - one) * (placement.tiles_used - 1) / (TILES - 1)
    return counts.steps * barrier + _busiest(program, counts, placement, chip)


def _busiest(program: Program, counts: Counts, placement: Placement, chip: Chip) -> float:
    """Seconds of work of the core that has most."""
    op, active, inactive, learning = (chip.costs[name].value if name in chip.costs else 0.0 for name in WORK)
    work = [0.0] * len(program.populations)
    for index, part in enumerate(program.populations):
        updates = counts.populations[part.name]
        if part.kind == "neuron":
            work[index] += updates.neuron_updates_active * active
            work[index] += (updates.neuron_updates - updates.neuron_updates_active) * inactive
    for projection in program.projections:
        made = counts.projections[projection.name]
        work[projection.target] += made.synaptic_ops * op
        if projection.synapse.learns != "trials" and not projection.synapse.delays:
            work[projection.target] += made.learning_updates * learning
    sizes = [part.size for part in program.populations]
    loads = (sum(work[p] * (last - first) / sizes[p] for p, first, last in core.parts) for core in placement.cores)
    return max(loads, default=0.0)


def told_times(program: Program, chip: Chip) -> list[str]:
    """The figures behind a chip time, with their sources, and what it leaves out."""
    if chip.step_s is not None:
        source = sourced(chip.step_s.source, chip.step_s.conditions)
        step = f"{program.resolution:g} ms takes {chip.step_s.value * 1e3:g} ms on the chip"
        return [f"{CHIP_TIME}a step of {step}: {source}"]
    by_source: dict[str, list[str]] = {}
    for name in (*BARRIERS, *WORK):
        if name in chip.costs:
            figure = chip.costs[name]
            figures = by_source.setdefault(sourced(figure.source, figure.conditions), [])
            figures.append(f"{name.removesuffix('_time')} {quantity(figure.value, 's')}")
    bound = "chip time is a lower bound: steps x barrier, linear in the tiles used, and the busiest core's work"
    return [bound, *(f"{CHIP_TIME}{', '.join(names)}: {source}" for source, names in by_source.items())]
