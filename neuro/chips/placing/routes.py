"""The ways of spikes between cores: hops of each source neuron, along which traffic is priced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neuro.chips.placing.fill import spread, travel
from neuro.chips.placing.incoming import Incoming
from neuro.chips.placing.mesh import Places
from neuro.chips.placing.split import Split
from neuro.program.program import Ints, Program


@dataclass(frozen=True, slots=True, eq=False)
class Hops:
    """What one spike of each source neuron of a projection moves; int64, shape (sources,).

    Attributes:
        cores: cores it is sent to for this projection.
        local: those of them on the tile from which it starts (its own core among them).
        east_west, north_south: hops from tile to tile.
        chip: those of them that lead from chip to chip.
    """

    cores: Ints
    local: Ints
    east_west: Ints
    north_south: Ints
    chip: Ints

    @property
    def total(self) -> int:
        """Hops of one spike of every source."""
        return int(self.east_west.sum() + self.north_south.sum())


def routes(program: Program, into: Incoming, split: Split, places: Places, multicast: bool) -> tuple[Hops, ...]:
    """The hops of every projection.

    Args:
        program: has the projections.
        into: their synapses.
        split: which line reaches which core.
        places: where cores lie. Generators are at tile (0, 0) of chip 0, where the host's spikes enter.
        multicast: a spike goes once over the links that its ways share (first along its row, then along columns);
            otherwise it is sent once for each destination core. What several projections of a population share
            counts with the first.
    """
    if not split.listed:
        return _counted(program, into, split, places)
    found: list[Hops] = []
    trees: dict[int, _Tree] = {}
    chosen = np.flatnonzero(split.sent)
    chosen = chosen[np.argsort(into.projection[split.line[chosen]], kind="stable")]
    cut = np.searchsorted(into.projection[split.line[chosen]], np.arange(len(program.projections) + 1))
    for index, part in enumerate(program.projections):
        entry = chosen[cut[index] : cut[index + 1]]
        size = program.populations[part.source].size
        source = split.line[entry] - into.first[index]
        own = _core_of(program, into, split, part.source)
        if not multicast:
            found.append(_Ways(places, own, source.astype(np.int64), split.core[entry].astype(np.int64)).unicast(size))
        else:
            if part.source not in trees:
                trees[part.source] = _Tree(own, places)
            found.append(trees[part.source].grow(source, split.core[entry]))
    return tuple(found)


def _counted(program: Program, into: Incoming, split: Split, places: Places) -> tuple[Hops, ...]:
    """The hops of every projection, a spike sent for each destination core, where these are not listed."""
    lines, total = len(into.source), int(into.start[-1])
    found = tuple(np.zeros(lines, dtype=np.int64) for _ in range(5))
    coordinates = (places.column, places.row, places.chip_column, places.chip_row)
    placed = split.core_of >= 0
    begins = tuple(np.where(placed, of_core[split.core_of], 0) for of_core in coordinates)
    room = np.empty(total, dtype=np.int32), np.full(total, -1, dtype=np.int32)
    travel(split.queue, *split.pieces, into.ends, into.line, into.source, begins, coordinates, *room, found)
    ways = []
    for index, part in enumerate(program.projections):
        a, b = into.first[index], into.first[index + 1]
        none = np.zeros(program.populations[part.source].size, dtype=np.int64)
        ways.append(Hops(*(each[a:b] if b > a else none for each in found)))
    return tuple(ways)


def _core_of(program: Program, into: Incoming, split: Split, population: int) -> Ints:
    return split.core_of[into.start[population] : into.start[population + 1]]


def begins(own: Ints, coordinate: Ints) -> Ints:
    """Where each source neuron is: on its core, or with the host."""
    if not len(coordinate):
        return np.zeros(len(own), dtype=np.int64)
    return np.where(own >= 0, coordinate[own], 0)


class _Ways:
    """From source neurons to destination cores."""

    def __init__(self, places: Places, core_of: Ints, source: Ints, core: Ints) -> None:
        self.places, self.source, self.core = places, source, core
        self.own = core_of
        self.east, self.south = self.step(places.column), self.step(places.row)
        self.local = (self.east == 0) & (self.south == 0)

    def step(self, coordinate: Ints) -> Ints:
        """How far each destination is from its source, with its sign."""
        return np.asarray(coordinate[self.core] - begins(self.own, coordinate)[self.source])

    def count(self, what: Ints | None, size: int) -> Ints:
        """Sums per source neuron."""
        return np.bincount(self.source, weights=what, minlength=size).astype(np.int64)

    def unicast(self, size: int) -> Hops:
        """Every destination core by itself."""
        over = np.abs(self.step(self.places.chip_column)) + np.abs(self.step(self.places.chip_row))
        east, south = (self.count(np.abs(step), size) for step in (self.east, self.south))
        return Hops(self.count(None, size), self.count(self.local, size), east, south, self.count(over, size))


class _Tree:
    """The links that each neuron of a population uses: how far east and west, and in each column south and north."""

    def __init__(self, own: Ints, places: Places) -> None:
        self.column, self.row = begins(own, places.column), begins(own, places.row)
        self.places = places.column, places.row
        self.mesh = places.mesh
        columns = int(places.column.max(initial=0)) + 1
        self.along = np.zeros((2, own.size), dtype=np.int64)
        self.across = np.zeros((2, own.size, columns), dtype=np.int64)

    def grow(self, source: NDArray[np.int32], core: NDArray[np.int32]) -> Hops:
        """Add destinations; of the links only what is new."""
        before = self.links()
        cores, local = np.zeros((2, self.column.size), dtype=np.int64)
        spread(source, core, (self.column, self.row), self.places, cores, local, self.along, self.across)
        after = self.links()
        return Hops(cores, local, *(new - old for new, old in zip(after, before, strict=True)))

    def links(self) -> tuple[Ints, Ints, Ints]:
        """All links of each neuron."""
        column, row = self.column, self.row[:, None]
        over = np.zeros_like(column)
        for side, sign in enumerate((1, -1)):
            over += np.abs((column + sign * self.along[side]) // self.mesh.columns - column // self.mesh.columns)
            over += np.abs((row + sign * self.across[side]) // self.mesh.rows - row // self.mesh.rows).sum(axis=1)
        return self.along.sum(axis=0), self.across.sum(axis=(0, 2)), over
