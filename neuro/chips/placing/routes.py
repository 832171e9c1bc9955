"""The ways of spikes between cores: hops of each source neuron, along which traffic is priced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro.chips.placing.incoming import Incoming
from neuro.chips.placing.mesh import MeshPlaces
from neuro.chips.placing.reach import reached, spread, travel
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


def routes(program: Program, into: Incoming, split: Split, places: MeshPlaces, multicast: bool) -> tuple[Hops, ...]:
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
    found = [
        Hops(*np.zeros((5, program.populations[part.source].size), dtype=np.int64)) for part in program.projections
    ]
    trees: dict[int, _Tree] = {}
    coordinates = (places.column, places.row, places.chip_column, places.chip_row)
    for index, ways in reached(into, split.core_of, len(split.cores)):
        source = program.projections[index].source
        own = split.core_of[into.start[source] : into.start[source + 1]]
        if multicast:
            if source not in trees:
                trees[source] = _Tree(own, places)
            found[index] = trees[source].grow(ways)
        else:
            hops = found[index]
            start = tuple(begins(own, coordinate) for coordinate in coordinates)
            moves = (hops.cores, hops.local, hops.east_west, hops.north_south, hops.chip)
            travel(*ways, start, coordinates, moves)
    return tuple(found)


def begins(own: Ints, coordinate: Ints) -> Ints:
    """Where each source neuron is: on its core, or with the host."""
    if not len(coordinate):
        return np.zeros(len(own), dtype=np.int64)
    return np.where(own >= 0, coordinate[own], 0)


class _Tree:
    """The links that each neuron of a population uses: how far east and west, and in each column south and north."""

    def __init__(self, own: Ints, places: MeshPlaces) -> None:
        self.column, self.row = begins(own, places.column), begins(own, places.row)
        self.places = places.column, places.row
        self.mesh = places.mesh
        columns = int(places.column.max(initial=0)) + 1
        self.along = np.zeros((2, own.size), dtype=np.int64)
        self.across = np.zeros((2, own.size, columns), dtype=np.int64)

    def grow(self, ways: tuple[Any, ...]) -> Hops:
        """Add destinations; of the links only what is new."""
        before = self.links()
        cores, local = np.zeros((2, self.column.size), dtype=np.int64)
        spread(*ways, (self.column, self.row), self.places, cores, local, self.along, self.across)
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
