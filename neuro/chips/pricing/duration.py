"""How long a chip takes for a run.

With `step_s` steps are real time: steps x `step_s`. Else they take as long as their work: steps x the barrier, plus
the work of the busiest core: the updates of its neurons, and of each projection's synaptic operations and learning
updates its share of the target's neurons. That is a lower bound: the busiest core may be another in every step, and
the time that spikes travel is left out. The barrier is linear in the tiles of one chip, and from there in the chips.

In real time the steps of the network last their own time, as events come: a chip that is done earlier waits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from neuro.chips.description import CONDITIONS, Chip, Figure, Range
from neuro.chips.pricing.energy import CHIP_TIME, quantity, sourced
from neuro.program.counts import Counts
from neuro.program.program import Program

if TYPE_CHECKING:
    from neuro.chips.placing.placement import Placement

BARRIERS = ("barrier_1_tile_time", "barrier_32_tiles_time")
LARGE_BARRIER = "barrier_768_chips_time"
WORK = ("synaptic_op_time", "neuron_update_active_time", "neuron_update_inactive_time", "learning_update_time")
TILES = 32
CHIPS = 768

Pick = Callable[[Figure], float]
"""Which number of a figure is taken: its value, or an end of its range."""


@dataclass(frozen=True, slots=True)
class Duration:
    """Seconds that a chip takes for a run: the best estimate, and between what it lies."""

    best: float
    low: float
    high: float


def chip_time(
    program: Program, counts: Counts, placement: Placement | None, chip: Chip, run: Run, step_s: float | None = None
) -> Duration | None:
    """How long a chip takes; None if no times are published, or nothing is placed.

    Args:
        program: what ran.
        counts: of the run.
        placement: where its neurons lie.
        chip: has the figures.
        run: its conditions, by which figures hold.
        step_s: how long a step takes, where that is known.
    """
    if step_s is not None:
        return Duration(*3 * [counts.steps * step_s])
    if chip.step_s is not None:
        ends = range_of(chip.step_s, run)
        return Duration(*(counts.steps * each for each in (chip.step_s.value, *ends)))
    if placement is None or not all(name in chip.costs for name in BARRIERS):
        return None
    picks: tuple[Pick, ...] = (lambda f: f.value, lambda f: range_of(f, run)[0], lambda f: range_of(f, run)[1])
    return Duration(
        *(
            counts.steps * barrier(placement, chip, run, p) + _busiest(program, counts, placement, chip, p)
            for p in picks
        )
    )


def waited(time: Duration | None, seconds: float) -> Duration:
    """How long a chip is on in real time: as long as the steps last, or longer where it is late.

    Args:
        time: that it takes, None where that is not known: then it is taken to be in time.
        seconds: that the steps last.
    """
    if time is None:
        return Duration(seconds, seconds, seconds)
    in_time = seconds * (1.0 - 1e-9)  # equal but for the last bits: no waiting
    return Duration(*(seconds if each < in_time else each for each in (time.best, time.low, time.high)))


def barrier(placement: Placement, chip: Chip, run: Run, pick: Pick = lambda figure: figure.value) -> float:
    """Seconds of the end of a step.

    Args:
        placement: where the neurons lie.
        chip: has the figures.
        run: its conditions, of which the chips that are on.
        pick: which number of a figure.
    """
    one, many = (pick(chip.costs[name]) for name in BARRIERS)
    chips = run["chips"]
    if chips > 1 and LARGE_BARRIER in chip.costs:
        return many + (pick(chip.costs[LARGE_BARRIER]) - many) * (chips - 1) / (CHIPS - 1)
    return one + (many - one) * (placement.tiles_used - 1) / (TILES - 1)


def _busiest(program: Program, counts: Counts, placement: Placement, chip: Chip, pick: Pick) -> float:
    """Seconds of work of the core that has most."""
    op, active, inactive, learning = (pick(chip.costs[name]) if name in chip.costs else 0.0 for name in WORK)
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


def told_times(program: Program, chip: Chip, run: Run, step_s: float | None = None) -> list[str]:
    """The figures behind a chip time, with their sources, what it leaves out, and what is extrapolated."""
    if step_s is not None:
        return [f"chip time: a step of {program.resolution:g} ms takes {quantity(step_s, 's')} on the chip, as given"]
    if chip.step_s is not None:
        source = sourced(chip.step_s.source, chip.step_s.conditions)
        step = f"{program.resolution:g} ms takes {chip.step_s.value * 1e3:g} ms on the chip"
        return [f"{CHIP_TIME}a step of {step}: {source}", *_extrapolated({"step_s": chip.step_s}, run)]
    large = LARGE_BARRIER in chip.costs and run["chips"] > 1
    figures = (BARRIERS[1], LARGE_BARRIER) if large else BARRIERS
    names = [name for name in (*figures, *WORK) if name in chip.costs]
    by_source: dict[str, list[str]] = {}
    for name in names:
        figure = chip.costs[name]
        told = by_source.setdefault(sourced(figure.source, figure.conditions), [])
        told.append(f"{name.removesuffix('_time')} {quantity(figure.value, 's')}")
    line = "linear in the chips" if large else "linear in the tiles used"
    bound = f"chip time is a lower bound: steps x barrier, {line}, and the busiest core's work"
    return [
        bound,
        *(f"{CHIP_TIME}{', '.join(told)}: {source}" for source, told in by_source.items()),
        *_extrapolated({name: chip.costs[name] for name in names}, run),
    ]


def _extrapolated(figures: dict[str, Figure], run: Run) -> list[str]:
    """What does not hold for a run, by reason."""
    by_reason: dict[str, list[str]] = {}
    for name, figure in figures.items():
        if why := why_extrapolated(figure, run):
            by_reason.setdefault(why, []).append(name)
    return [f"chip time is extrapolated: {', '.join(names)}: {why}" for why, names in by_reason.items()]


Run = Mapping[str, float]
"""Of `neuro.chips.description.CONDITIONS` by name, what a run has; what is not known is left out."""


def run_of(program: Program, counts: Counts, placement: Placement | None, chips: int) -> Run:
    """The conditions of a run.

    Args:
        program: what ran.
        counts: of the run.
        placement: where its neurons lie, None where nothing is placed.
        chips: that are on.
    """
    found = {"resolution": program.resolution, "chips": float(chips)}
    if placement is not None:
        found["tiles"] = float(placement.tiles_used)
    if counts.neuron_updates:
        spikes = sum(counts.populations[part.name].spikes for part in program.populations if part.kind == "neuron")
        found["rate"] = spikes / (counts.neuron_updates * program.resolution * 1e-3)
    return found


def why_extrapolated(figure: Figure, run: Run) -> str:
    """Why a figure is not known to hold for a run, "" if it does."""
    if figure.guess:
        return figure.guess
    told = [
        f"{name} {_told(run[name], name)}, published for {_span(figure.holds[name], name)}"
        for name in CONDITIONS
        if name in figure.holds and name in run and not _within(run[name], figure.holds[name])
    ]
    return "; ".join(told)


def range_of(figure: Figure, run: Run) -> Range:
    """Between what a figure may lie in a run."""
    return figure.range(bool(why_extrapolated(figure, run)))


def _within(value: float, ends: Range) -> bool:
    return bool(ends[0] * (1.0 - 1e-9) <= value <= ends[1] * (1.0 + 1e-9))


def _told(value: float, name: str) -> str:
    return f"{value:.4g} {CONDITIONS[name][0]}".rstrip()


def _span(ends: Range, name: str) -> str:
    return _told(ends[0], name) if ends[0] == ends[1] else f"{ends[0]:.4g} to {_told(ends[1], name)}"
