"""Where cores lie: tiles in rows and columns, chips beside each other, and an order that keeps partners close."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro.chips.description import Chip, Mesh, capacity, mesh_of
from neuro.chips.fitting import LARGEST
from neuro.chips.incoming import Incoming, cores_of_source, is_new, reached
from neuro.kernels.jit import kernel
from neuro.program.program import Floats, Ints, Program

_EFFORT = 10_000_000
"""Exchanges x pairs that are looked at: keeps placing of 1 M synapses below half a second."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshPlaces:
    """Places of cores. Chips lie on a square as small as holds them; tiles are counted over all chips.

    Attributes:
        mesh: of one chip.
        chip: the chip of each core.
        slot: the core's number inside its tile.
        column, row: of its tile, counted from the first chip's corner (0, 0), where the host is.
    """

    mesh: Mesh
    chip: Ints
    slot: Ints
    column: Ints
    row: Ints

    @property
    def chip_column(self) -> Ints:
        """The column of each core's chip on the square."""
        return self.column // self.mesh.columns

    @property
    def chip_row(self) -> Ints:
        """The row of each core's chip on the square."""
        return self.row // self.mesh.rows

    def taken(self, order: Ints) -> MeshPlaces:
        """Core i at the place of core order[i]."""
        return MeshPlaces(self.mesh, self.chip[order], self.slot[order], self.column[order], self.row[order])


def lay_out(chip: Chip, memory: Ints, snake: bool) -> MeshPlaces:
    """Fill chip after chip and tile after tile with cores as they come.

    Args:
        chip: has the mesh, and perhaps a memory that the cores of a chip share.
        memory: bytes of each core.
        snake: whether the tiles of a chip are taken column by column, down and up in turn, and chips row by row, to
            and fro, so that one is beside the next; otherwise both are taken row by row.
    """
    mesh = mesh_of(chip, len(memory))
    most, shared = capacity(chip, len(memory)), chip.limit("synapse_bytes_per_chip")
    number, within = np.zeros((2, len(memory)), dtype=np.int64)
    at, held, filled = 0, 0, 0
    for i, need in enumerate(memory):  # a chip ends when its cores or its memory are used up
        if held == most or (held and shared is not None and filled + int(need) > shared):
            at, held, filled = at + 1, 0, 0
        number[i], within[i] = at, held
        held, filled = held + 1, filled + int(need)
    side = math.isqrt(max(int(number.max(initial=0)), 0)) + (0 if len(memory) == 0 else 1)
    tile, slot = np.divmod(within, mesh.cores_per_tile)
    chip_row, chip_column = np.divmod(number, max(side, 1))
    if snake:
        chip_column = np.where(chip_row % 2, side - 1 - chip_column, chip_column)
        column, row = np.divmod(tile, mesh.rows)
        row = np.where(column % 2, mesh.rows - 1 - row, row)
        column = np.where(chip_row % 2, mesh.columns - 1 - column, column)
    else:
        row, column = np.divmod(tile, mesh.columns)
    return MeshPlaces(mesh, number, slot, chip_column * mesh.columns + column, chip_row * mesh.rows + row)


def exchange(traffic: Floats, pull: Floats, column: Ints, row: Ints) -> Ints:
    """Exchange the places of two, again and again, as long as it saves hops; the best pair first.

    Args:
        traffic: spikes between each two, symmetric with 0 on the diagonal, shape (n, n).
        pull: spikes from the host, which is at (0, 0), to each.
        column: of each one's tile.
        row: likewise.

    Returns:
        whose place each takes. All numbers are whole, so that the result is the same on every machine.
    """
    n = len(pull)
    at = np.arange(n)
    if n > LARGEST:
        return at
    way: Floats = np.abs(column[:, None] - column) + np.abs(row[:, None] - row).astype(np.float64)
    hops = traffic @ way + np.outer(pull, column + row)
    for _ in range(min(4 * n, _EFFORT // max(n * n, 1))):
        here = np.diagonal(hops)
        gain = here[:, None] + here - hops - hops.T - 2.0 * traffic * way
        i, j = divmod(int(np.argmax(gain)), n)
        if gain[i, j] <= 0.0:
            break
        hops += np.outer(traffic[:, i] - traffic[:, j], way[j] - way[i])
        hops[:, [i, j]] = hops[:, [j, i]]
        way[:, [i, j]] = way[:, [j, i]]
        way[[i, j]] = way[[j, i]]
        at[[i, j]] = at[[j, i]]
    return at


def draw_close(chip: Chip, places: MeshPlaces, memory: Ints, traffic: Floats, pull: Floats) -> MeshPlaces:
    """Exchange whole tiles, used or not, then cores; nothing where a chip could then hold more than it can."""
    shared, most = chip.limit("synapse_bytes_per_chip"), capacity(chip, len(memory))
    mesh = places.mesh
    if most < mesh.columns * mesh.rows * mesh.cores_per_tile:
        return places
    if shared is not None and most * int(memory.max(initial=0)) > shared:
        return places
    n, size = len(places.chip), mesh.columns * mesh.rows
    chips, first, number = np.unique(places.chip, return_index=True, return_inverse=True)
    if size > 1 and len(chips) * size <= LARGEST:
        y, x = np.divmod(np.arange(size), mesh.columns)
        column = (places.chip_column[first, None] * mesh.columns + x).reshape(-1)
        row = (places.chip_row[first, None] * mesh.rows + y).reshape(-1)
        tile = number * size + places.row % mesh.rows * mesh.columns + places.column % mesh.columns
        member = np.zeros((n, len(column)))
        member[np.arange(n), tile] = 1.0
        between = member.T @ traffic @ member
        np.fill_diagonal(between, 0.0)
        tile = exchange(between, pull @ member, column, row)[tile]
        places = MeshPlaces(mesh, chips[tile // size], places.slot, column[tile], row[tile])
    return places.taken(exchange(traffic, pull, places.column, places.row))


# mypy: disable-error-code="no-untyped-def,no-untyped-call"


@kernel
def between_cores(rows, core_of, room, own, traffic, pull):
    """Add one spike of each source: from its core (`own`) to each that it reaches; -1 is the host."""
    count, cores, sent = room
    for i in range(rows[0].size):
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not is_new(i, core, sent):
                continue
            if own[i] < 0:
                pull[core] += 1
            else:
                traffic[own[i], core] += 1


@kernel
def travel(rows, core_of, room, begins, places, found):
    """The moves of one spike of each source that is sent for each core by itself.

    `begins` has the column, the row, the chip's column and the chip's row where each source begins, `places` the same
    of each core. `found` grows by source: cores, those on the tile, columns, rows and chips that a spike moves.
    """
    count, cores, sent = room
    for i in range(rows[0].size):
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not is_new(i, core, sent):
                continue
            east = abs(places[0][core] - begins[0][i])
            south = abs(places[1][core] - begins[1][i])
            found[0][i] += 1
            found[1][i] += east == 0 and south == 0
            found[2][i] += east
            found[3][i] += south
            found[4][i] += abs(places[2][core] - begins[2][i]) + abs(places[3][core] - begins[3][i])


@kernel
def spread(rows, core_of, room, begin, places, reached, local, along, across):
    """Add destinations to the links that sources use: first along their row, then along columns.

    `begin` and `places` are the columns and rows of sources and of cores. Filled are the cores of each source
    (`reached`) and those on its tile (`local`), how far it goes west and east (`along`), and north and south in each
    column (`across`).
    """
    count, cores, sent = room
    for s in range(rows[0].size):
        for k in range(cores_of_source(s, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not is_new(s, core, sent):
                continue
            column = places[0][core]
            east, south = column - begin[0][s], places[1][core] - begin[1][s]
            reached[s] += 1
            local[s] += east == 0 and south == 0
            along[0, s] = max(along[0, s], east)
            along[1, s] = max(along[1, s], -east)
            across[0, s, column] = max(across[0, s, column], south)
            across[1, s, column] = max(across[1, s, column], -south)


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


def routes(program: Program, into: Incoming, core_of: Ints, places: MeshPlaces, multicast: bool) -> tuple[Hops, ...]:
    """The hops of every projection.

    Args:
        program: has the projections.
        into: their synapses.
        core_of: the core of every neuron, -1 for generators.
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
    for index, ways in reached(into, core_of, len(places.chip)):
        source = program.projections[index].source
        own = core_of[into.start[source] : into.start[source + 1]]
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
