"""Counts x figures: what a run would take on a chip, whatever backend it ran on.

Dynamic energy is the counts that all backends share, and the ways of the spikes by the placement, times the table's
figures. Static energy is the power of the chips times the emulated chip time. Where a table has `mac`, the same work
is priced as dense layers instead: every synapse in every step.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from neuro.chips.arithmetics import ARITHMETICS, arithmetic_of
from neuro.chips.description import Chip
from neuro.chips.placing.capacity import too_late
from neuro.chips.placing.fan_out import dense_size, spiking
from neuro.chips.pricing.duration import chip_time, told_times
from neuro.chips.pricing.energy import STATIC, Energy, Item, number
from neuro.chips.quantising.quantise import quantise
from neuro.core.errors import ModelError
from neuro.program.backend import EngineCounts
from neuro.program.counts import Counts, Tally
from neuro.program.program import Ints, Program

if TYPE_CHECKING:
    from neuro.chips.placing.placement import Placement
    from neuro.chips.placing.routes import Hops


def price(program: Program, counts: EngineCounts, placement: Placement | None, chip: Chip) -> Energy:
    """The bill of a run.

    Args:
        program: what ran.
        counts: of the run, on any backend.
        placement: where its neurons lie on the chip; None for a target that has no mesh.
        chip: the target.

    Raises:
        ModelError: no cost of the chip is published, it needs a placement, or the program does not fit on it.
    """
    check_costs(chip)
    bill = _Bill(program, Tally(program).between(None, counts), chip)
    if "mac" in chip.costs:
        return bill.dense()
    if chip.mesh is not None and placement is None:
        raise ModelError(f"target '{chip.name}' needs a placement", hint="neuro.chips.place(program, chip)")
    if placement is not None:
        check_fits(program, placement, chip)
    return bill.spiking(counts, placement)


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
    refused = [problem for problem in problems if problem.refused]
    if refused:
        texts = [f"{p.origin}: " * bool(p.origin) + f"{p.what}: {p.why}" for p in refused]
        hints = [f"\n  hint: {p.way_out}" * bool(p.way_out) for p in refused]
        lines = [line + hint for line, hint in zip(texts, hints, strict=True)]
        raise ModelError("\n".join([f"network '{program.name}' does not fit on target '{chip.name}'", *lines]))


def unrunnable(program: Program, chip: Chip, placed: bool) -> Iterator[str]:
    """Notes that what is priced cannot run on the chip, as far as that is known of it."""
    as_if = "priced as if it could"
    if chip.arithmetic in ARITHMETICS:
        refused = sum(problem.refused for problem in quantise(program, chip).problems)
        if refused:
            count = f"{refused} refusal" + "s" * (refused > 1)
            yield f"{chip.name} cannot run this network ({count}, see neuro fit): {as_if}"
    elif not placed:
        for problem in too_late(program, chip):
            yield f"{chip.name} cannot run this network: {problem.what}: {problem.why}: {as_if}"


class _Bill:
    """Collects the items and notes of one run on one chip."""

    def __init__(self, program: Program, counts: Counts, chip: Chip) -> None:
        self.program, self.counts, self.chip = program, counts, chip
        self.items: list[Item] = []
        self.notes: list[str] = []

    def add(self, what: str, kind: str, of: str, count: float) -> None:
        """Add an item if there is anything to count."""
        if not count:
            return
        figure = self.chip.costs.get(what)
        if figure is None:
            self.items.append(Item(what, kind, of, count, None, None, "", ""))
        else:
            joules = count * figure.value
            self.items.append(Item(what, kind, of, count, figure.value, joules, figure.source, figure.conditions))

    def dense(self) -> Energy:
        """Every synapse in every step."""
        for index in spiking(self.program):
            macs = self.counts.steps * dense_size(self.program, index)
            self.add("mac", "projection", self.program.projections[index].name, macs)
        self.notes.append("the same network as dense layers: every synapse in every step, a grid as a convolution")
        self.notes.append("neuron updates, learning and static power are not in the sums")
        return self.done(1, None)

    def spiking(self, raw: EngineCounts, placement: Placement | None) -> Energy:
        """Neurons, synapses, ways, learning, then the chip."""
        self.neurons(raw)
        for index, part in enumerate(self.program.projections):
            made = self.counts.projections[part.name]
            self.add("synaptic_op", "projection", part.name, made.synaptic_ops)
            if placement is not None:
                self.ways(part.name, raw.spikes[part.source], placement.hops(index))
            by_host = part.synapse.learns == "trials" or part.synapse.delays
            self.add("weight_write" if by_host else "learning_update", "projection", part.name, made.learning_updates)
        time = chip_time(self.program, self.counts, placement, self.chip)
        chips = 1 if placement is None else placement.chips_used
        if time is not None and STATIC in self.chip.costs:
            self.add(STATIC, "chip", self.chip.name, chips * time)
        self.explain(raw, placement, time)
        return self.done(chips, time)

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

    def explain(self, raw: EngineCounts, placement: Placement | None, time: float | None) -> None:
        """Note what is assumed and what is left out."""
        self.notes += unrunnable(self.program, self.chip, placement is not None)
        if time is not None:
            self.notes += told_times(self.program, self.chip)
        if STATIC not in self.chip.costs or time is None:
            self.notes.append("static power is not in the sums: no figure is published")
        elif placement is None and self.chip.costs[STATIC].value:
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

    def done(self, chips: int, time: float | None) -> Energy:
        """The bill."""
        chip, steps = self.chip, self.counts.steps
        return Energy(chip.name, chip.title, chips, time, steps, tuple(self.items), tuple(self.notes))
