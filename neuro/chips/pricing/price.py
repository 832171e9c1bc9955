"""Counts x figures: what a run would take on a chip, whatever backend it ran on.

Dynamic energy is the counts that all backends share, and the ways of the spikes by the placement, times the table's
figures. Static energy is the power of the chips times the emulated chip time, and in real time the power times what
the steps last. Where a table has `mac`, the same work
is priced as dense layers instead: every synapse in every step.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from os import PathLike
from typing import TYPE_CHECKING

from neuro.chips.arithmetics import ARITHMETICS, arithmetic_of
from neuro.chips.description import Chip
from neuro.chips.known import chip
from neuro.chips.placing.capacity import too_late
from neuro.chips.placing.fan_out import dense_size, spiking
from neuro.chips.placing.place import place
from neuro.chips.pricing.duration import Duration, chip_time, range_of, run_of, told_times, waited, why_extrapolated
from neuro.chips.pricing.energy import AS_GIVEN, FASTEST, REAL_TIME, STATIC, BillItem, Energy, number, quantity
from neuro.chips.quantising.quantise import refusals
from neuro.core.errors import ModelError
from neuro.program.backend import EngineCounts
from neuro.program.counts import Counts, Tally
from neuro.program.program import Ints, Program

if TYPE_CHECKING:
    from neuro.chips.placing.placement import Placement
    from neuro.chips.placing.routes import Hops


def price(
    program: Program,
    counts: EngineCounts,
    placement: Placement | None,
    chip: Chip,
    *,
    step_s: float | None = None,
    chips: int | None = None,
) -> Energy:
    """The bill of a run.

    Args:
        program: what ran.
        counts: of the run, on any backend.
        placement: where its neurons lie on the chip; None for a target that has no mesh.
        chip: the target.
        step_s: how long a step takes on the chip in s, where that is known or demanded, e.g. by real time.
        chips: that are on, if not those that the placement uses, e.g. all of a board.

    Raises:
        ModelError: no cost of the chip is published, it needs a placement, the program does not fit on it, or
            `step_s` or `chips` cannot be.
    """
    check_costs(chip)
    _check_machine(chip, placement, step_s, chips)
    used = 1 if placement is None else placement.chips_used
    bill = _Bill(program, Tally(program).between(None, counts), chip, placement, chips or used, step_s)
    if "mac" in chip.costs:
        return bill.dense()
    if chip.mesh is not None and placement is None:
        raise ModelError(f"target '{chip.name}' needs a placement", hint="neuro.chips.place(program, chip)")
    if placement is not None:
        check_fits(program, placement, chip)
    return bill.spiking(counts)


def _check_machine(chip: Chip, placement: Placement | None, step_s: float | None, chips: int | None) -> None:
    """Refuse a time of a step, or a number of chips, that cannot be."""
    if step_s is not None and not (isinstance(step_s, (int, float)) and 0.0 < step_s < math.inf):
        raise ModelError(f"step_s = {step_s!r}: expected a number > 0 in s")
    if chips is not None and (type(chips) is not int or chips < 1):
        raise ModelError(f"chips = {chips!r}: expected a whole number >= 1")
    if chips is not None and placement is not None and chips < placement.chips_used:
        raise ModelError(f"chips = {chips}: the network needs {placement.chips_used} on {chip.name}")


def check_costs(chip: Chip) -> None:
    """Refuse a target of which nothing can be priced."""
    if not chip.costs:
        raise ModelError(
            f"target '{chip.name}' has no costs: none is published",
            hint=f"write a table with 'like: {chip.name}' and 'costs: ...', and name its file as the target",
        )


def check_fits(program: Program, placement: Placement, chip: Chip) -> None:
    """Refuse a placement in which something does not fit, or a delay beyond the chip's register; all of it is told."""
    problems = dict.fromkeys((*placement.problems, *too_late(program, chip)))
    refused = tuple(problem.error() for problem in problems if problem.refused)
    if refused:
        raise ModelError(f"network '{program.name}' does not fit on target '{chip.name}'", others=refused)


def unrunnable(program: Program, chip: Chip, placed: bool) -> Iterator[str]:
    """Notes that what is priced cannot run on the chip, as far as that is known of it."""
    as_if = "priced as if it could"
    if chip.arithmetic in ARITHMETICS:
        if refused := len(refusals(program, chip)):
            count = f"{refused} refusal" + "s" * (refused > 1)
            yield f"{chip.name} cannot run this network ({count}, see neuro fit): {as_if}"
    elif not placed:
        for problem in too_late(program, chip):
            yield f"{chip.name} cannot run this network: {problem.what}: {problem.why}: {as_if}"


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
    ) -> None:
        self.program, self.counts, self.chip = program, counts, chip
        self.placement, self.chips, self.step_s = placement, chips, step_s
        self.run = run_of(program, counts, placement, chips)
        self.seconds = counts.steps * program.resolution * 1e-3
        self.items: list[BillItem] = []
        self.notes: list[str] = []

    def add(self, what: str, kind: str, of: str, count: float) -> None:
        """Add an item if there is anything to count."""
        if count and what not in self.chip.costs:
            self.items.append(BillItem(what, kind, of, count, None, None, "", ""))
        elif count:
            self.items.append(self._item(what, kind, of, count, count, count))

    def _item(self, what: str, kind: str, of: str, count: float, least: float, most: float) -> BillItem:
        """A line with a figure, of which there are between `least` and `most`."""
        figure = self.chip.costs[what]
        low, high = range_of(figure, self.run)
        known = (figure.value, count * figure.value, figure.source, figure.conditions)
        why = why_extrapolated(figure, self.run)
        return BillItem(what, kind, of, count, *known, least * low, most * high, figure.spread, why)

    def on(self, time: Duration | None) -> list[BillItem]:
        """Chips that are on: the range is that of their power and that of the time."""
        if STATIC not in self.chip.costs or time is None or not time.best:
            return []
        seconds = (self.chips * each for each in (time.best, time.low, time.high))
        return [self._item(STATIC, "chip", self.chip.name, *seconds)]

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
        self.neurons(raw)
        for index, part in enumerate(self.program.projections):
            made = self.counts.projections[part.name]
            self.add("synaptic_op", "projection", part.name, made.synaptic_ops)
            if placement is not None:
                self.ways(part.name, raw.spikes[part.source], placement.hops(index))
            by_host = part.synapse.learns == "trials" or part.synapse.delays
            self.add("weight_write" if by_host else "learning_update", "projection", part.name, made.learning_updates)
        time = chip_time(self.program, self.counts, placement, self.chip, self.run, self.step_s)
        self.explain(raw, time)
        return self.done(time)

    def neurons(self, raw: EngineCounts) -> None:
        """The updates of neurons and, where every spike is a packet, those sent."""
        senders = {part.source for part in self.program.projections}
        for index, part in enumerate(self.program.populations):
            made = self.counts.populations[part.name]
            if part.kind == "neuron":
                active = made.neuron_updates_active
                self.add("neuron_update_active", "population", part.name, active)
                self.add("neuron_update_inactive", "population", part.name, made.neuron_updates - active)
            if index in senders and "packet" in self.chip.costs:
                self.add("packet", "population", part.name, int(raw.spikes[index].sum()))

    def ways(self, name: str, spikes: Ints, hops: Hops) -> None:
        """The moves of a projection's spikes, of the kinds that the table prices."""
        moves = {
            "spike_in_tile": hops.local,
            "hop_east_west": hops.east_west,
            "hop_north_south": hops.north_south,
            "packet": hops.chip,
        }
        for what, each in moves.items():
            if what in self.chip.costs:
                self.add(what, "projection", name, int(spikes @ each))

    def explain(self, raw: EngineCounts, time: Duration | None) -> None:
        """Note what is assumed and what is left out."""
        placement = self.placement
        self.notes += unrunnable(self.program, self.chip, placement is not None)
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
        bare = sorted({item.what for item in self.items if item.joules_each is None})
        if bare:
            self.notes.append(f"not priced, as no figure is published: {', '.join(bare)}")
        events, spikes = (sum(int(part.sum()) for part in parts) for parts in (raw.events, raw.spikes))
        if self.chip.arithmetic in ARITHMETICS and arithmetic_of(self.chip).one_bit and events != spikes:
            self.notes.append(
                f"{number(spikes)} spikes in {number(events)} events: several of a neuron in one step are priced "
                "as several, of which the chip would send one"
            )

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
        return Energy(*about, *lines, "run", ends, self.seconds, clock, waiting)


def bill(
    program: Program,
    counts: EngineCounts,
    target: str | PathLike[str],
    *,
    step_s: float | None = None,
    chips: int | None = None,
) -> Energy:
    """What a run would take on a target.

    Args:
        program: what ran.
        counts: what it took, on any backend.
        target: the name of a chip or processor, or a table file.
        step_s: how long a step takes on the chip in s, if not as its table says.
        chips: that are on, if not those that the network needs.

    Raises:
        ModelError: there is no such target, the network does not fit on it, it has no published costs, or `step_s` or
            `chips` cannot be.
    """
    priced = chip(target)
    placement = place(program, priced) if priced.mesh is not None else None
    return price(program, counts, placement, priced, step_s=step_s, chips=chips)
