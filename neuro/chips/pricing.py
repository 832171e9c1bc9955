"""Counts x figures: what a run would take on a chip, whatever backend it ran on.

Dynamic energy is the counts that all backends share, and the ways of the spikes by the placement, times the table's
figures. Static energy is the power of the chips times the emulated chip time, and in real time the power times what
the steps last. Where a table has `mac`, the same work is priced as dense layers instead: every synapse in every step.

**Chip time.** With `step_s` steps are real time: steps x `step_s`. Else they take as long as their work: steps x the
barrier, plus the work of the busiest core: the updates of its neurons, and of each projection's synaptic operations and
learning updates its share of the target's neurons. That is a lower bound: the busiest core may be another in every
step, and the time that spikes travel is left out. The barrier is linear in the tiles of one chip, and from there in the
chips.

In real time the steps of the network last their own time, as events come: a chip that is done earlier waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

from neuro.chips.description import CONDITIONS, Chip, Figure, Range
from neuro.chips.energy import (
    AS_GIVEN,
    CHIP_TIME,
    FASTEST,
    REAL_TIME,
    STATIC,
    BillItem,
    Energy,
    number,
    quantity,
    sourced,
)
from neuro.chips.fitting import too_late
from neuro.chips.incoming import dense_size, spiking
from neuro.chips.known import ARITHMETICS, arithmetic_of, chip
from neuro.chips.placing import place
from neuro.chips.quantising import refusals
from neuro.chips.spinnaker_rule import SIGNAL_SPIKES
from neuro.core.errors import ModelError
from neuro.program.backend import EngineCounts
from neuro.program.counts import Counts, Tally
from neuro.program.program import Program

if TYPE_CHECKING:
    from neuro.chips.placing import Placement


BARRIERS = ("barrier_1_tile_time", "barrier_32_tiles_time")
LARGE_BARRIER = "barrier_768_chips_time"
WORK = ("synaptic_op_time", "neuron_update_active_time", "neuron_update_inactive_time", "learning_update_time")
TILES = 32
CHIPS = 768

RULES_APPLIED = (
    "learning updates, which are priced, count the plastic synapses of each pre and each post spike, as the published "
    "figure is of one pairwise update; 'rules applied' count the synapses that the chip's learning engine visits at "
    "the end of an epoch: all of them where a product with u_k is due, else each once whose neurons spiked"
)
"""Why Loihi's own count of learning differs from the one in its bill."""

HOST = "cpu"
"""The processor that prices what the host computes."""
RULE_MACS = 4
"""Multiply-accumulates of a rule of trials for one weight: w + span (A s) (1 - s), with s = (w - Wmin) / span."""

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
    """How long a chip is on in real time: as long as the run lasts, or longer where it is late.

    Args:
        time: that it takes, None where that is not known: then it is taken to be in time.
        seconds: that the run lasts.
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
    reasons = [
        f"{name} {_told(run[name], name)}, published for {_span(figure.holds[name], name)}"
        for name in CONDITIONS
        if name in figure.holds
        and name in run
        and not figure.holds[name][0] * (1.0 - 1e-9) <= run[name] <= figure.holds[name][1] * (1.0 + 1e-9)
    ]
    return "; ".join(reasons)


def range_of(figure: Figure, run: Run) -> Range:
    """Between what a figure may lie in a run."""
    return figure.range(bool(why_extrapolated(figure, run)))


def _told(value: float, name: str) -> str:
    return f"{value:.4g} {CONDITIONS[name][0]}".rstrip()


def _span(ends: Range, name: str) -> str:
    return _told(ends[0], name) if ends[0] == ends[1] else f"{ends[0]:.4g} to {_told(ends[1], name)}"


def price(
    program: Program,
    counts: EngineCounts,
    placement: Placement | None,
    chip: Chip,
    *,
    step_s: float | None = None,
    chips: int | None = None,
    duration_s: float | None = None,
    ran_on: str = "",
) -> Energy:
    """The bill of a run.

    Args:
        program: what ran.
        counts: of the run, on any backend.
        placement: where its neurons lie on the chip; None for a target that has no mesh.
        chip: the target.
        step_s: how long a step takes on the chip in s, where that is known or demanded, e.g. by real time.
        chips: that are on, if not those that the placement uses, e.g. all of a board.
        duration_s: how long the run lasts in real time in s, if not as long as its steps, e.g. the time of recordings
            whose frames are shown over more steps.
        ran_on: the backend of the run: the chip that it emulates does not refuse the network.

    Raises:
        ModelError: no cost of the chip is published, it needs a placement, the program does not fit on it, or
            `step_s`, `chips` or `duration_s` cannot be.
    """
    check_costs(chip)
    if step_s is not None and not (isinstance(step_s, (int, float)) and 0.0 < step_s < math.inf):
        raise ModelError(f"step_s = {step_s!r}: expected a number > 0 in s")
    if chips is not None and (type(chips) is not int or chips < 1):
        raise ModelError(f"chips = {chips!r}: expected a whole number >= 1")
    used = 1 if placement is None else placement.chips_used
    if chips is not None and placement is not None and chips < used:
        raise ModelError(f"chips = {chips}: the network needs {used} on {chip.name}")
    if duration_s is not None and not (isinstance(duration_s, (int, float)) and 0.0 <= duration_s < math.inf):
        raise ModelError(f"duration_s = {duration_s!r}: expected a number >= 0 in s")
    tally = Tally(program).between(None, counts)
    bill = _Bill(program, tally, chip, placement, chips or used, step_s, duration_s, ran_on == chip.name)
    if "mac" in chip.costs:
        return bill.dense()
    if chip.mesh is not None and placement is None:
        raise ModelError(f"chip '{chip.name}' needs a placement", hint="neuro.chips.place(program, chip)")
    if placement is not None:
        check_fits(program, placement, chip)
    return bill.spiking(counts)


def check_costs(chip: Chip) -> None:
    """Refuse a chip of which nothing can be priced."""
    if not chip.costs:
        raise ModelError(
            f"chip '{chip.name}' has no costs: none is published",
            hint=f"write a table with 'like: {chip.name}' and 'costs: ...', and name its file as the chip",
        )


def check_fits(program: Program, placement: Placement, chip: Chip) -> None:
    """Refuse a placement in which something does not fit, or a delay beyond the chip's register; reports all."""
    problems = dict.fromkeys((*placement.problems, *too_late(program, chip)))
    refused = tuple(problem.error() for problem in problems if problem.refused)
    if refused:
        raise ModelError(f"network '{program.name}' does not fit on chip '{chip.name}'", others=refused)


def unrunnable(program: Program, chip: Chip, placed: bool) -> str:
    """Return why a chip cannot run a network, as far as that is known of the chip; "" if it can."""
    if chip.arithmetic in ARITHMETICS:
        problems = refusals(program, chip)
    else:
        problems = () if placed else tuple(too_late(program, chip))
    more = f" (and {len(problems) - 1} more, see neuro fit)" if len(problems) > 1 else ""
    return f"{problems[0].what}: {problems[0].why}{more}" if problems else ""


MOVES = {"spike_in_tile": "local", "hop_east_west": "east_west", "hop_north_south": "north_south", "packet": "chip"}
"""Costs of the moves of a spike, and what they are in `Hops`."""


class _Bill:
    """Collects the items and notes of one run on one chip."""

    def __init__(
        self,
        program: Program,
        counts: Counts,
        chip: Chip,
        placement: Placement | None,
        chips: int,
        step_s: float | None,
        duration_s: float | None,
        ran: bool,
    ) -> None:
        self.program, self.counts, self.chip = program, counts, chip
        self.placement, self.chips, self.step_s = placement, chips, step_s
        self.run = run_of(program, counts, placement, chips)
        self.seconds = counts.steps * program.resolution * 1e-3 if duration_s is None else duration_s
        # What ran on the chip, perhaps with options of a user's, is not refused.
        self.refused = "" if "mac" in chip.costs or ran else unrunnable(program, chip, placement is not None)
        self.items: list[BillItem] = []
        self.notes: list[str] = []

    def add(self, what: str, kind: str, of: str, count: float) -> None:
        """Add an item if there is anything to count."""
        if count and what not in self.chip.costs:
            self.items.append(BillItem(what, kind, of, count, None, None, "", ""))
        elif count:
            self.items.append(self._item(self.chip, what, kind, of, count, count, count))

    def _item(self, of_table: Chip, what: str, kind: str, of: str, count: float, least: float, most: float) -> BillItem:
        """Return a line with a figure of a table, with between `least` and `most` of its unit."""
        return _line(of_table.costs[what], self.run, what, kind, of, count, least, most)

    def on(self, time: Duration | None) -> list[BillItem]:
        """Chips that are on: the range is that of their power and that of the time."""
        if STATIC not in self.chip.costs or time is None or not time.best:
            return []
        seconds = (self.chips * each for each in (time.best, time.low, time.high))
        return [self._item(self.chip, STATIC, "chip", self.chip.name, *seconds)]

    def dense(self) -> Energy:
        """Every synapse in every step."""
        for index in spiking(self.program):
            macs = self.counts.steps * dense_size(self.program, index)
            self.add("mac", "projection", self.program.projections[index].name, macs)
        self.notes.append("the same network as dense layers: every synapse in every step, a grid as a convolution")
        self.notes.append("neuron updates, learning and static power are not in the sums")
        return self.done(None)

    def spiking(self, raw: EngineCounts) -> Energy:
        """Neurons, synapses, ways, learning, then the chip."""
        placement = self.placement
        senders = {part.source for part in self.program.projections}
        for index, population in enumerate(self.program.populations):
            updates = self.counts.populations[population.name]
            if population.kind == "neuron":
                active = updates.neuron_updates_active
                self.add("neuron_update_active", "population", population.name, active)
                self.add("neuron_update_inactive", "population", population.name, updates.neuron_updates - active)
            if index in senders and "packet" in self.chip.costs:
                self.add("packet", "population", population.name, int(raw.spikes[index].sum()))
        for index, part in enumerate(self.program.projections):
            made = self.counts.projections[part.name]
            self.add("synaptic_op", "projection", part.name, made.synaptic_ops)
            hops = None if placement is None else placement.hops(index)
            for what, name in MOVES.items() if hops is not None else ():
                if what in self.chip.costs:  # moves of the kinds that the table prices
                    moves = int(raw.spikes[part.source] @ getattr(hops, name))
                    self.add(what, "projection", part.name, moves)
            # On SpiNNaker spikes bring a signal to the neurons; its emulator counts these spikes.
            brought = raw.native.get(f"{SIGNAL_SPIKES} in {part.name}", 0)
            if brought and self.chip.arithmetic == "spinnaker":
                for what in ("packet", "synaptic_op"):
                    self.add(what, "signal", self.program.signals[part.signal].name, brought)
            by_host = part.synapse.learns == "trials" or part.synapse.delays
            self.add("weight_write" if by_host else "learning_update", "projection", part.name, made.learning_updates)
            if part.signal >= 0 and part.synapse.learns:
                self.add("signal_update", "projection", part.name, part.size * self.counts.steps)
            if by_host and (macs := RULE_MACS * made.learning_updates):
                note = f"host: {RULE_MACS} multiply-accumulates of a {HOST} a weight, as r_stdp takes"
                self.notes += [] if note in self.notes else [note]
                self.items.append(self._item(chip(HOST), "mac", "host", HOST, macs, macs, macs))
        time = chip_time(self.program, self.counts, placement, self.chip, self.run, self.step_s)
        self.explain(raw, time)
        return self.done(time)

    def explain(self, raw: EngineCounts, time: Duration | None) -> None:
        """Note what is assumed and what is left out."""
        placement = self.placement
        if self.refused:
            self.notes.append(f"{self.chip.name} refuses the network, so there is no total: {self.refused}")
        if time is not None:
            self.notes += told_times(self.program, self.chip, self.run, self.step_s)
        if placement is not None and self.chips != placement.chips_used:
            used, on = placement.chips_used, self.chips
            self.notes.append(f"the network uses {used} chip{'s' * (used > 1)}, {on} are on, as given")
        if time is not None and time.best > self.seconds * (1.0 + 1e-9):
            takes, lasts = quantity(time.best, "s"), quantity(self.seconds, "s")
            self.notes.append(f"late: real time is not kept, the chip takes {takes} for {lasts}")
        if STATIC not in self.chip.costs:
            self.notes.append("static power is not in the sums: no figure is published")
        elif time is None:
            self.notes.append("static power is in the sums in real time only: no time of a step is published")
        elif placement is None and self.chip.costs[STATIC].value and self.chips == 1:
            self.notes.append("nothing is placed: one chip is taken")
        if any(part.kind != "neuron" for part in self.program.populations):
            self.notes.append("generators are the host's: their spikes are priced, their updates are not")
        if any(item.what == "weight_write" for item in self.items):
            self.notes.append("the rule for trials is applied by the host, which writes each weight that changes")
        signals = any(part.signal >= 0 for part in self.program.projections)
        if signals and self.chip.arithmetic == "spinnaker" and SIGNAL_SPIKES not in "".join(raw.native):
            self.notes.append(
                "spikes that bring a signal are counted in a run on the chip only, so they are not priced"
            )
        if placement is not None and self.chip.arithmetic in ARITHMETICS and self.counts.steps:
            parts = [core.parts for core in placement.cores]
            self.notes += arithmetic_of(self.chip).told_of_learning(self.program, self.chip, parts, self.visits())
        if any(name.startswith("rules applied") for name in raw.native):
            self.notes.append(RULES_APPLIED)
        bare = sorted({item.what for item in self.items if item.joules_each is None})
        if bare:
            self.notes.append(f"not priced, as no figure is published: {', '.join(bare)}")
        events, spikes = (sum(int(part.sum()) for part in parts) for parts in (raw.events, raw.spikes))
        if self.chip.arithmetic in ARITHMETICS and arithmetic_of(self.chip).one_bit and events != spikes:
            self.notes.append(
                f"{number(spikes)} spikes in {number(events)} events: several of a neuron in one step are priced "
                "as several, of which the chip would send one"
            )

    def visits(self) -> dict[int, tuple[float, float]]:
        """Of a mean step, by projection, the synapses of pre spikes and those of post spikes."""
        made = [self.counts.projections[part.name] for part in self.program.projections]
        both = [(each.synaptic_ops, max(0, each.learning_updates - each.synaptic_ops)) for each in made]
        return {k: (pre / self.counts.steps, post / self.counts.steps) for k, (pre, post) in enumerate(both)}

    def done(self, time: Duration | None) -> Energy:
        """The bill."""
        real = waited(time, self.seconds)
        known = time is not None or (STATIC in self.chip.costs and "mac" not in self.chip.costs)
        waiting = self._timed(real, REAL_TIME) if known and real != time else None
        return self._timed(time, FASTEST if self.step_s is None else AS_GIVEN, waiting)

    def _timed(self, time: Duration | None, clock: str, waiting: Energy | None = None) -> Energy:
        chip, steps = self.chip, self.counts.steps
        best, ends = (None, None) if time is None else (time.best, (time.low, time.high))
        lines = (*self.items, *self.on(time)), tuple(self.notes)
        about = chip.name, chip.title, self.chips, best, steps
        return Energy(*about, *lines, "run", ends, self.seconds, clock, waiting, self.refused)


def _line(figure: Figure, run: Run, what: str, kind: str, of: str, count: float, least: float, most: float) -> BillItem:
    low, high = range_of(figure, run)
    known = (figure.value, count * figure.value, figure.source, figure.conditions)
    why = why_extrapolated(figure, run)
    return BillItem(what, kind, of, count, *known, least * low, most * high, figure.spread, why)


def dense(
    macs: Mapping[str, float],
    target: str | PathLike[str],
    *,
    steps: float = 1,
    of: str = "run",
    notes: Iterable[str] = (),
) -> Energy:
    """The bill of multiply-accumulates, of which a user's own program says how many there are.

    Args:
        macs: how many, by what they are for, such as layers.
        target: the name of a processor, or a table file with the cost `mac`.
        steps: how often they are done, for the bill's head.
        of: what the bill is of.
        notes: what is assumed of the counts.

    Raises:
        ModelError: there is no such target, or it has no cost `mac`.
    """
    processor = chip(target)
    if "mac" not in processor.costs:
        raise ModelError(f"'{processor.name}' has no cost of a multiply-accumulate", hint="cpu, gpu or arm")
    figure = processor.costs["mac"]
    items = tuple(_line(figure, {}, "mac", "layers", name, n, n, n) for name, n in macs.items())
    return Energy(
        processor.name, processor.title, 1, None, steps, items, (*notes, "static power is not in the sums"), of
    )


def bill(
    program: Program,
    counts: EngineCounts,
    target: str | PathLike[str],
    *,
    step_s: float | None = None,
    chips: int | None = None,
    duration_s: float | None = None,
    ran_on: str = "",
) -> Energy:
    """What a run would take on a target.

    Args:
        program: what ran.
        counts: what it took, on any backend.
        target: the name of a chip or processor, or a table file.
        step_s: how long a step takes on the chip in s, if not as its table says.
        chips: that are on, if not those that the network needs.
        duration_s: how long the run lasts in real time in s, if not as long as its steps.
        ran_on: the backend of the run, as of `price`.

    Raises:
        ModelError: there is no such target, the network does not fit on it, it has no published costs, or `step_s`,
            `chips` or `duration_s` cannot be.
    """
    priced = chip(target)
    placed = priced.mesh is not None or priced.arithmetic in ARITHMETICS
    placement = place(program, priced) if placed else None
    return price(program, counts, placement, priced, step_s=step_s, chips=chips, duration_s=duration_s, ran_on=ran_on)
