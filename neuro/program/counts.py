"""Counts of a run, which are equal on all backends: they follow from spikes and connections only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from neuro.program.backend import EngineCounts
from neuro.program.program import Grid, Ints, Program

BY_SPIKES = ("pairs", "chip", "moves")
"""Kinds of learning with an update of all plastic synapses of a neuron at each of its spikes."""


@dataclass(frozen=True, slots=True)
class PopulationCounts:
    """Counts of one population.

    Attributes:
        spikes: spikes with their multiplicity.
        neuron_updates: neurons x steps (0 for generators).
        neuron_updates_active: neuron-steps with an arrival or a spike.
    """

    spikes: int
    neuron_updates: int
    neuron_updates_active: int


@dataclass(frozen=True, slots=True)
class ProjectionCounts:
    """Counts of one projection.

    Attributes:
        synaptic_ops: synapses of the source neuron, summed over all spikes; an expected value if the backend draws
            the synapses.
        learning_updates: plastic synapses of each pre and each post spike, and weights changed after trials.
    """

    synaptic_ops: int
    learning_updates: int


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of a run: totals, and the counts of each population and projection.

    Attributes:
        steps: number of steps.
        spikes, neuron_updates, neuron_updates_active: sums over the populations.
        synaptic_ops, learning_updates: sums over the projections.
        populations, projections: counts by name of the part.
        native: counts of this backend only, such as a chip's overflows, by name.
    """

    steps: int
    populations: Mapping[str, PopulationCounts]
    projections: Mapping[str, ProjectionCounts]
    native: Mapping[str, int] = field(default_factory=dict)

    @property
    def spikes(self) -> int:
        """Spikes of all populations with their multiplicity."""
        return sum(part.spikes for part in self.populations.values())

    @property
    def neuron_updates(self) -> int:
        """Neurons x steps."""
        return sum(part.neuron_updates for part in self.populations.values())

    @property
    def neuron_updates_active(self) -> int:
        """Neuron-steps with an arrival or a spike."""
        return sum(part.neuron_updates_active for part in self.populations.values())

    @property
    def synaptic_ops(self) -> int:
        """Synapses of the source neuron, summed over all spikes."""
        return sum(part.synaptic_ops for part in self.projections.values())

    @property
    def learning_updates(self) -> int:
        """Plastic synapses of each pre and each post spike, plus weights changed after trials."""
        return sum(part.learning_updates for part in self.projections.values())


class Tally:
    """Conversion of an engine's raw counts to `Counts`.

    Args:
        program: the network with the connections.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self._fans: dict[int, tuple[Ints, Ints]] = {}

    def between(self, before: EngineCounts | None, after: EngineCounts) -> Counts:
        """Return the counts from one moment (None: the start) to another."""
        if before is not None:
            after = difference(after, before)
        populations = {
            part.name: PopulationCounts(
                spikes=int(after.spikes[index].sum()),
                neuron_updates=part.size * after.steps if part.kind == "neuron" else 0,
                neuron_updates_active=int(after.active[index]),
            )
            for index, part in enumerate(self.program.populations)
        }
        projections = {}
        for index, part in enumerate(self.program.projections):
            spikes, updates = after.spikes[part.source], int(after.trial_updates[index])
            if part.undrawn is None:
                operations = int(spikes @ self._fan(index)[0])
            else:
                operations = round(int(spikes.sum()) * part.size / self.program.populations[part.source].size)
            if part.synapse.learns in BY_SPIKES:
                outgoing, incoming = self._fan(index)
                updates += int(after.events[part.source] @ outgoing) + int(after.events[part.target] @ incoming)
            projections[part.name] = ProjectionCounts(synaptic_ops=operations, learning_updates=updates)
        return Counts(after.steps, populations, projections, dict(after.native))

    def _fan(self, index: int) -> tuple[Ints, Ints]:
        """Return the number of synapses of each source; for learning by spikes, also onto each target."""
        if index not in self._fans:
            self._fans[index] = fan_out(self.program, index), self._fan_in(index)
        return self._fans[index]

    def _fan_in(self, index: int) -> Ints:
        part = self.program.projections[index]
        n_pre = self.program.populations[part.source].size
        n_post = self.program.populations[part.target].size
        if part.layout == "one_to_one":
            return np.ones(n_post, dtype=np.int64)
        if part.layout == "dense":
            return np.full(n_post, n_pre, dtype=np.int64)
        if part.synapse.learns not in BY_SPIKES:
            return np.zeros(0, dtype=np.int64)
        if part.grid is not None:
            return np.bincount(self.program.synapses(index)[1], minlength=n_post)
        return part.share.total(np.bincount(part.targets, minlength=n_post).astype(np.int64))


def fan_out(program: Program, projection: int) -> Ints:
    """Return the number of synapses of each source neuron of a projection (by index), shape (sources,)."""
    program.refuse_undrawn(projection)
    part = program.projections[projection]
    n_pre = program.populations[part.source].size
    if part.layout == "one_to_one":
        return np.ones(n_pre, dtype=np.int64)
    if part.layout == "dense":
        return np.full(n_pre, program.populations[part.target].size, dtype=np.int64)
    if part.grid is not None:
        return _grid_fan_out(part.grid)
    return part.rows.fan_out()


def difference(after: EngineCounts, before: EngineCounts) -> EngineCounts:
    """Return the counts between two moments."""
    return EngineCounts(
        steps=after.steps - before.steps,
        events=tuple(a - b for a, b in zip(after.events, before.events, strict=True)),
        spikes=tuple(a - b for a, b in zip(after.spikes, before.spikes, strict=True)),
        active=after.active - before.active,
        trial_updates=after.trial_updates - before.trial_updates,
        native={name: count - before.native.get(name, 0) for name, count in after.native.items()},
    )


def total(first: EngineCounts, second: EngineCounts) -> EngineCounts:
    """Return the sum of the counts of two runs of one program."""
    names = sorted({*first.native, *second.native})
    return EngineCounts(
        steps=first.steps + second.steps,
        events=tuple(a + b for a, b in zip(first.events, second.events, strict=True)),
        spikes=tuple(a + b for a, b in zip(first.spikes, second.spikes, strict=True)),
        active=first.active + second.active,
        trial_updates=first.trial_updates + second.trial_updates,
        native={name: first.native.get(name, 0) + second.native.get(name, 0) for name in names},
    )


def _grid_fan_out(grid: Grid) -> Ints:
    """Return the number of targets of every source of a grid, i.e. of targets with a kernel that covers the source."""

    def covering(length: int, padding: int, kernel: int, n_places: int) -> Ints:
        offset = np.arange(length)[:, None] + padding - np.arange(n_places)[None, :] * grid.stride
        covered: Ints = ((offset >= 0) & (offset < kernel)).sum(axis=1)
        return covered

    rows = covering(grid.height, grid.top, grid.kernel_height, grid.rows)
    columns = covering(grid.width, grid.left, grid.kernel_width, grid.columns)
    sheet: Ints = np.outer(rows, columns).reshape(-1) * grid.reach
    return np.tile(sheet, grid.channels)
