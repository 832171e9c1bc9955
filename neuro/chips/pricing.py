"""Price of a run on a chip, for a run on any backend: counts of operations x published figures.

Dynamic energy is a sum of counts times figures of the chip's table. The counts are the operations that all backends
count, and the moves of spikes in the placement. Static energy is the power of the chips times the chip time, or in real
time times the duration of the steps. A table with `mac` prices dense layers: every synapse in every step.

**Chip time.** With `step_s` it is steps x `step_s`. Otherwise it is steps x the barrier, plus the work of the busiest
core: the updates of its neurons, and its share (by target neurons) of each projection's synaptic operations and
learning updates. The result is a lower bound: another core may be the busiest in each step, and the travel time of
spikes is not counted. The barrier is linear in the tiles of one chip, and beyond one chip linear in the chips.

In real time each step of the network lasts its simulated time, as with live events, and a faster chip waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

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
from neuro.chips.hosting import ROW, HostWork, host_items, host_notes
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
    "learning updates, which the bill prices, count the plastic synapses of each pre and each post spike, because the "
    "published figure is that of one pairwise update; 'rules applied' count the synapses that the chip's learning "
    "engine visits at the end of an epoch: all in epochs with a u_k product, otherwise each synapse with a spike once"
)
"""Note on the two counts of learning: the count that Loihi makes, and the count that the bill prices."""

HOST = "cpu"
"""Name of the processor with the figures for the work of the host."""
RULE_MACS = 4
"""Multiply-accumulates per weight of a rule for trials: w + span (A s) (1 - s), with s = (w - Wmin) / span."""

Pick = Callable[[Figure], float]
"""Function that returns a number of a figure: its value, or an end of its range."""


@dataclass(frozen=True, slots=True)
class Duration:
    """Time in s of a run on a chip: the best estimate, and the range."""

    best: float
    low: float
    high: float


def chip_time(
    program: Program, counts: Counts, placement: Placement | None, chip: Chip, run: Run, step_s: float | None = None
) -> Duration | None:
    """Return the time that a chip needs, or None if no times are published or nothing is placed.

    Args:
        program: the program that ran.
        counts: counts of the run.
        placement: placement of the neurons.
        chip: the chip with the figures.
        run: conditions of the run, which decide on the range of figures.
        step_s: duration of a step on the chip in s, if known.
    """
    if step_s is not None:
        return Duration(*3 * [counts.steps * step_s])
    if chip.step_s is not None:
        ends = range_of(chip.step_s, run)
        return Duration(*(counts.steps * seconds for seconds in (chip.step_s.value, *ends)))
    if placement is None or not all(name in chip.costs for name in BARRIERS):
        return None
    picks: tuple[Pick, ...] = (lambda f: f.value, lambda f: range_of(f, run)[0], lambda f: range_of(f, run)[1])
    return Duration(
        *(
            counts.steps * barrier(placement, chip, run, p) + _busiest(program, counts, placement, chip, p)
            for p in picks
        )
    )


def time_with_waiting(time: Duration | None, seconds: float) -> Duration:
    """Return the time that a chip is on in real time: the duration of the run, or more if the chip is late.

    Args:
        time: time that the chip needs; None if unknown: the chip then counts as in time.
        seconds: duration of the run.
    """
    if time is None:
        return Duration(seconds, seconds, seconds)
    in_time = seconds * (1.0 - 1e-9)  # a difference in the last bits only does not count as waiting
    return Duration(*(seconds if needed < in_time else needed for needed in (time.best, time.low, time.high)))


def barrier(placement: Placement, chip: Chip, run: Run, pick: Pick = lambda figure: figure.value) -> float:
    """Return the seconds of the barrier at the end of a step.

    Args:
        placement: placement of the neurons.
        chip: the chip with the figures.
        run: conditions of the run, including the number of chips that are on.
        pick: selects a number of a figure.
    """
    one_tile, many_tiles = (pick(chip.costs[name]) for name in BARRIERS)
    chips = run["chips"]
    if chips > 1 and LARGE_BARRIER in chip.costs:
        return many_tiles + (pick(chip.costs[LARGE_BARRIER]) - many_tiles) * (chips - 1) / (CHIPS - 1)
    return one_tile + (many_tiles - one_tile) * (placement.tiles_used - 1) / (TILES - 1)


def _busiest(program: Program, counts: Counts, placement: Placement, chip: Chip, pick: Pick) -> float:
    """Return the seconds of work of the busiest core."""
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


def time_notes(program: Program, chip: Chip, run: Run, step_s: float | None = None) -> list[str]:
    """Return notes on a chip time: figures with their sources, assumptions, and extrapolated figures."""
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
        texts = by_source.setdefault(sourced(figure.source, figure.conditions), [])
        texts.append(f"{name.removesuffix('_time')} {quantity(figure.value, 's')}")
    line = "linear in the chips" if large else "linear in the tiles used"
    bound = f"chip time is a lower bound: steps x barrier, {line}, and the busiest core's work"
    return [
        bound,
        *(f"{CHIP_TIME}{', '.join(texts)}: {source}" for source, texts in by_source.items()),
        *_extrapolated({name: chip.costs[name] for name in names}, run),
    ]


def _extrapolated(figures: dict[str, Figure], run: Run) -> list[str]:
    """Return notes on the figures that are extrapolated, by reason."""
    by_reason: dict[str, list[str]] = {}
    for name, figure in figures.items():
        if why := why_extrapolated(figure, run):
            by_reason.setdefault(why, []).append(name)
    return [f"chip time is extrapolated: {', '.join(names)}: {why}" for why, names in by_reason.items()]


Run = Mapping[str, float]
"""Conditions of a run by name, see `neuro.chips.description.CONDITIONS`; unknown conditions are left out."""


def run_of(program: Program, counts: Counts, placement: Placement | None, chips: int) -> Run:
    """Return the conditions of a run.

    Args:
        program: the program that ran.
        counts: counts of the run.
        placement: placement of the neurons, None if nothing is placed.
        chips: number of chips that are on.
    """
    conditions = {"resolution": program.resolution, "chips": float(chips)}
    if placement is not None:
        conditions["tiles"] = float(placement.tiles_used)
    if counts.neuron_updates:
        spikes = sum(counts.populations[part.name].spikes for part in program.populations if part.kind == "neuron")
        conditions["rate"] = spikes / (counts.neuron_updates * program.resolution * 1e-3)
    return conditions


def why_extrapolated(figure: Figure, run: Run) -> str:
    """Return the reason why a figure may not hold for a run; "" if it holds."""
    if figure.guess:
        return figure.guess
    reasons = [
        f"{name} {_with_unit(run[name], name)}, published for {_span(figure.holds[name], name)}"
        for name in CONDITIONS
        if name in figure.holds
        and name in run
        and not figure.holds[name][0] * (1.0 - 1e-9) <= run[name] <= figure.holds[name][1] * (1.0 + 1e-9)
    ]
    return "; ".join(reasons)


def range_of(figure: Figure, run: Run) -> Range:
    """Return the range of a figure in a run."""
    return figure.range(bool(why_extrapolated(figure, run)))


def _with_unit(value: float, name: str) -> str:
    return f"{value:.4g} {CONDITIONS[name][0]}".rstrip()


def _span(ends: Range, name: str) -> str:
    return _with_unit(ends[0], name) if ends[0] == ends[1] else f"{ends[0]:.4g} to {_with_unit(ends[1], name)}"


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
    host: Iterable[HostWork] = (),
) -> Energy:
    """Return the bill of a run.

    Args:
        program: the program that ran.
        counts: counts of the run, on any backend.
        placement: placement of the neurons on the chip; None for a target without a mesh.
        chip: the target.
        step_s: duration of a step on the chip in s, if known or given, e.g. by real time.
        chips: number of chips that are on, e.g. all of a board; by default the chips that the placement uses.
        duration_s: duration of the run in real time in s, e.g. of recordings whose frames are shown over more steps;
            by default the duration of its steps.
        ran_on: backend of the run. A chip emulated by this backend does not refuse the network.
        host: operations outside of the network. A processor prices them by its own `mac`, a chip by the `mac` of
            `HOST`.

    Raises:
        ModelError: no cost of the chip is published, a placement is missing, the program does not fit, or `step_s`,
            `chips` or `duration_s` is not allowed.
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
    bill.host = tuple(host)
    if "mac" in chip.costs:
        return bill.dense()
    if chip.mesh is not None and placement is None:
        raise ModelError(f"chip '{chip.name}' needs a placement", hint="neuro.chips.place(program, chip)")
    if placement is not None:
        check_fits(program, placement, chip)
    return bill.spiking(counts)


def check_costs(chip: Chip) -> None:
    """Refuse a chip without published costs."""
    if not chip.costs:
        raise ModelError(
            f"chip '{chip.name}' has no costs: none is published",
            hint=f"write a table with 'like: {chip.name}' and 'costs: ...', and name its file as the chip",
        )


def check_fits(program: Program, placement: Placement, chip: Chip) -> None:
    """Refuse a placement with parts that do not fit, or delays beyond the chip's register; one error lists all."""
    problems = dict.fromkeys((*placement.problems, *too_late(program, chip)))
    refused = tuple(problem.error() for problem in problems if problem.refused)
    if refused:
        raise ModelError(f"network '{program.name}' does not fit on chip '{chip.name}'", others=refused)


def unrunnable(program: Program, chip: Chip, is_placed: bool) -> str:
    """Return the known reason why a chip cannot run a network; "" if none is known."""
    if chip.arithmetic in ARITHMETICS:
        problems = refusals(program, chip)
    else:
        problems = () if is_placed else tuple(too_late(program, chip))
    others_text = f" (and {len(problems) - 1} more, see neuro fit)" if len(problems) > 1 else ""
    return f"{problems[0].what}: {problems[0].why}{others_text}" if problems else ""


MOVES = {"spike_in_tile": "local", "hop_east_west": "east_west", "hop_north_south": "north_south", "packet": "chip"}
"""Costs of the moves of a spike, each with the attribute of `Hops` that counts them."""


class _Bill:
    """Builder of a bill: the items and notes of a run on a chip."""

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
        # A network that ran on the chip, perhaps with a user's options, is not refused.
        self.refused = "" if "mac" in chip.costs or ran else unrunnable(program, chip, placement is not None)
        self.items: list[BillItem] = []
        self.notes: list[str] = []
        self.host: tuple[HostWork, ...] = ()

    def add(self, cost: str, kind: str, part_name: str, count: float) -> None:
        """Add an item if its count is not 0."""
        if count and cost not in self.chip.costs:
            self.items.append(BillItem(cost, kind, part_name, count, None, None, "", ""))
        elif count:
            self.items.append(self._item(self.chip, cost, kind, part_name, count, count, count))

    def _item(self, of_table: Chip, cost: str, kind: str, of: str, count: float, low: float, high: float) -> BillItem:
        """Return a line with a figure of a table, for between `low` and `high` of its unit."""
        return _line(of_table.costs[cost], self.run, cost, kind, of, count, low, high)

    def static_items(self, time: Duration | None) -> list[BillItem]:
        """Return the line of static energy, with a range from the ranges of power and time."""
        if STATIC not in self.chip.costs or time is None or not time.best:
            return []
        seconds = (self.chips * time_s for time_s in (time.best, time.low, time.high))
        return [self._item(self.chip, STATIC, "chip", self.chip.name, *seconds)]

    def dense(self) -> Energy:
        """Return the bill of every synapse in every step."""
        for index in spiking(self.program):
            macs = self.counts.steps * dense_size(self.program, index)
            self.add("mac", "projection", self.program.projections[index].name, macs)
        self.notes.append("the same network as dense layers: every synapse in every step, a grid as a convolution")
        self.notes.append("neuron updates, learning and static power are not in the sums")
        return self.finished(None)

    def spiking(self, raw: EngineCounts) -> Energy:
        """Return the bill of neurons, synapses, moves of spikes, learning, and the chip."""
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
                if what in self.chip.costs:  # the table has only some kinds of moves
                    moves = int(raw.spikes[part.source] @ getattr(hops, name))
                    self.add(what, "projection", part.name, moves)
            # On SpiNNaker spikes carry a signal to the neurons. The emulator counts them.
            carried = raw.native.get(f"{SIGNAL_SPIKES} in {part.name}", 0)
            if carried and self.chip.arithmetic == "spinnaker":
                for what in ("packet", "synaptic_op"):
                    self.add(what, "signal", self.program.signals[part.signal].name, carried)
            by_host = part.synapse.learns == "trials" or part.synapse.delays
            self.add("weight_write" if by_host else "learning_update", "projection", part.name, made.learning_updates)
            if part.signal >= 0 and part.synapse.learns:
                self.add("signal_update", "projection", part.name, part.size * self.counts.steps)
            if by_host and (macs := RULE_MACS * made.learning_updates):
                note = f"host: {RULE_MACS} multiply-accumulates of a {HOST} per weight, as for r_stdp"
                self.notes += [] if note in self.notes else [note]
                self.items.append(self._item(chip(HOST), "mac", "host", HOST, macs, macs, macs))
        time = chip_time(self.program, self.counts, placement, self.chip, self.run, self.step_s)
        self.explain(raw, time)
        return self.finished(time)

    def explain(self, raw: EngineCounts, time: Duration | None) -> None:
        """Add notes on assumptions and missing costs."""
        placement = self.placement
        if self.refused:
            self.notes.append(f"{self.chip.name} refuses the network, so there is no total: {self.refused}")
        if time is not None:
            self.notes += time_notes(self.program, self.chip, self.run, self.step_s)
        if placement is not None and self.chips != placement.chips_used:
            used, on = placement.chips_used, self.chips
            self.notes.append(f"the network uses {used} chip{'s' * (used > 1)}, {on} are on, as given")
        if time is not None and time.best > self.seconds * (1.0 + 1e-9):
            needed, duration = quantity(time.best, "s"), quantity(self.seconds, "s")
            self.notes.append(f"late: slower than real time, the chip needs {needed} for {duration}")
        if STATIC not in self.chip.costs:
            self.notes.append("static power is not in the sums: no figure is published")
        elif time is None:
            self.notes.append("static power is in the sums in real time only: no time of a step is published")
        elif placement is None and self.chip.costs[STATIC].value and self.chips == 1:
            self.notes.append("nothing is placed: one chip is assumed")
        if any(part.kind != "neuron" for part in self.program.populations):
            self.notes.append("generators run on the host: their spikes are priced, their updates are not")
        if any(item.what == "weight_write" for item in self.items):
            self.notes.append("the host applies the rule for trials and writes each weight that changes")
        signals = any(part.signal >= 0 for part in self.program.projections)
        if signals and self.chip.arithmetic == "spinnaker" and SIGNAL_SPIKES not in "".join(raw.native):
            self.notes.append("spikes that carry a signal are only counted in a run on the chip: they are not priced")
        if placement is not None and self.chip.arithmetic in ARITHMETICS and self.counts.steps:
            parts = [core.parts for core in placement.cores]
            self.notes += arithmetic_of(self.chip).learning_notes(self.program, self.chip, parts, self.visits())
        if any(name.startswith("rules applied") for name in raw.native):
            self.notes.append(RULES_APPLIED)
        unpriced = sorted({item.what for item in self.items if item.joules_each is None})
        if unpriced:
            self.notes.append(f"not priced, as no figure is published: {', '.join(unpriced)}")
        events, spikes = (sum(int(part.sum()) for part in parts) for parts in (raw.events, raw.spikes))
        if self.chip.arithmetic in ARITHMETICS and arithmetic_of(self.chip).one_bit and events != spikes:
            self.notes.append(
                f"{number(spikes)} spikes in {number(events)} events: each of several spikes of a neuron in one step "
                "is priced, but the chip would send one"
            )

    def visits(self) -> dict[int, tuple[float, float]]:
        """Return the mean number of synapses per step visited by pre spikes and by post spikes, by projection."""
        made = [self.counts.projections[part.name] for part in self.program.projections]
        operations = [(c.synaptic_ops, max(0, c.learning_updates - c.synaptic_ops)) for c in made]
        return {k: (pre / self.counts.steps, post / self.counts.steps) for k, (pre, post) in enumerate(operations)}

    def finished(self, time: Duration | None) -> Energy:
        """Return the bill."""
        processor = self.chip if "mac" in self.chip.costs else chip(HOST)
        if self.host or all(item.kind != ROW for item in self.items):  # a rule for trials has its row already
            self.items += host_items(self.host, self.counts.steps, processor)
        self.notes += host_notes(self.host)
        in_real_time = time_with_waiting(time, self.seconds)
        has_time = time is not None or (STATIC in self.chip.costs and "mac" not in self.chip.costs)
        waiting = self._timed(in_real_time, REAL_TIME) if has_time and in_real_time != time else None
        return self._timed(time, FASTEST if self.step_s is None else AS_GIVEN, waiting)

    def _timed(self, time: Duration | None, clock: str, waiting: Energy | None = None) -> Energy:
        chip, steps = self.chip, self.counts.steps
        best, time_range = (None, None) if time is None else (time.best, (time.low, time.high))
        lines = (*self.items, *self.static_items(time)), tuple(self.notes)
        head = chip.name, chip.title, self.chips, best, steps
        return Energy(*head, *lines, "run", time_range, self.seconds, clock, waiting, self.refused)


def _line(figure: Figure, run: Run, cost: str, kind: str, of: str, count: float, least: float, most: float) -> BillItem:
    low, high = range_of(figure, run)
    best = (figure.value, count * figure.value, figure.source, figure.conditions)
    reason = why_extrapolated(figure, run)
    return BillItem(cost, kind, of, count, *best, least * low, most * high, figure.spread, reason)


def dense(
    macs: Mapping[str, float],
    target: str | PathLike[str],
    *,
    steps: float = 1,
    of: str = "run",
    notes: Iterable[str] = (),
) -> Energy:
    """Return the bill of a user's own program, from its number of multiply-accumulates.

    Args:
        macs: number of multiply-accumulates by the name of a part, e.g. a layer.
        target: name of a processor, or a table file with the cost `mac`.
        steps: number of repetitions, for the bill's head.
        of: name of the run in the bill.
        notes: assumptions of the counts.

    Raises:
        ModelError: the target does not exist, or has no cost `mac`.
    """
    processor = chip(target)
    if "mac" not in processor.costs:
        raise ModelError(f"'{processor.name}' has no cost of a multiply-accumulate", hint="use cpu, gpu or arm")
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
    host: Iterable[HostWork] = (),
) -> Energy:
    """Return the bill of a run on a target.

    Args:
        program: the program that ran.
        counts: counts of the run, on any backend.
        target: name of a chip or processor, or a table file.
        step_s: duration of a step on the chip in s; by default from its table.
        chips: number of chips that are on; by default the number that the network needs.
        duration_s: duration of the run in real time in s; by default the duration of its steps.
        ran_on: backend of the run, see `price`.
        host: operations outside of the network, see `price`.

    Raises:
        ModelError: the target does not exist, has no published costs, or is too small for the network; or `step_s`,
            `chips` or `duration_s` is not allowed.
    """
    priced = chip(target)
    is_placed = priced.mesh is not None or priced.arithmetic in ARITHMETICS
    placement = place(program, priced) if is_placed else None
    options: Any = {"step_s": step_s, "chips": chips, "duration_s": duration_s, "ran_on": ran_on, "host": host}
    return price(program, counts, placement, priced, **options)
