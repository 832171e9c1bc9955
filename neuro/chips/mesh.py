"""Positions of cores: tiles in rows and columns, and chips in a square. Connected cores are close."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro.chips.description import Chip, Mesh, capacity, mesh_of
from neuro.chips.fitting import LARGEST
from neuro.chips.incoming import Incoming, cores_of_source, is_new, projections_by_source
from neuro.kernels.jit import kernel
from neuro.program.program import Floats, Ints, Program

_EFFORT = 10_000_000
"""Largest number of exchanges x pairs. It keeps the placing of a program with 1 M synapses below half a second."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshPlaces:
    """Positions of cores. Chips form the smallest square that holds them; tiles are counted over all chips.

    Attributes:
        mesh: mesh of one chip.
        chip: chip of each core.
        slot: number of each core inside its tile.
        column, row: position of the tile of each core, counted from the corner (0, 0) of the first chip, where the host
        is.
    """

    mesh: Mesh
    chip: Ints
    slot: Ints
    column: Ints
    row: Ints

    @property
    def chip_column(self) -> Ints:
        """Column of each core's chip in the square."""
        return self.column // self.mesh.columns

    @property
    def chip_row(self) -> Ints:
        """Row of each core's chip in the square."""
        return self.row // self.mesh.rows

    def reordered(self, order: Ints) -> MeshPlaces:
        """Return positions in which core i has the position of core order[i]."""
        return MeshPlaces(self.mesh, self.chip[order], self.slot[order], self.column[order], self.row[order])


def lay_out(chip: Chip, memory: Ints, snake: bool) -> MeshPlaces:
    """Fill chips and tiles one after the other with cores in the given order.

    Args:
        chip: the chip with the mesh, and perhaps a memory that its cores share.
        memory: bytes of each core.
        snake: whether each tile is next to the previous one: tiles of a chip are then filled column by column,
            alternately down and up, and chips row by row, alternately right and left. Otherwise both are filled row by
            row.
    """
    mesh = mesh_of(chip, len(memory))
    cores_per_chip, shared = capacity(chip, len(memory)), chip.limit("synapse_bytes_per_chip")
    chip_of_core, index_on_chip = np.zeros((2, len(memory)), dtype=np.int64)
    chip_number, on_chip, filled = 0, 0, 0
    for i, need in enumerate(memory):  # a chip is full if all cores or all bytes are used
        if on_chip == cores_per_chip or (on_chip and shared is not None and filled + int(need) > shared):
            chip_number, on_chip, filled = chip_number + 1, 0, 0
        chip_of_core[i], index_on_chip[i] = chip_number, on_chip
        on_chip, filled = on_chip + 1, filled + int(need)
    side = math.isqrt(max(int(chip_of_core.max(initial=0)), 0)) + (0 if len(memory) == 0 else 1)
    tile, slot = np.divmod(index_on_chip, mesh.cores_per_tile)
    chip_row, chip_column = np.divmod(chip_of_core, max(side, 1))
    if snake:
        chip_column = np.where(chip_row % 2, side - 1 - chip_column, chip_column)
        column, row = np.divmod(tile, mesh.rows)
        row = np.where(column % 2, mesh.rows - 1 - row, row)
        column = np.where(chip_row % 2, mesh.columns - 1 - column, column)
    else:
        row, column = np.divmod(tile, mesh.columns)
    return MeshPlaces(mesh, chip_of_core, slot, chip_column * mesh.columns + column, chip_row * mesh.rows + row)


def exchange(traffic: Floats, pull: Floats, column: Ints, row: Ints) -> Ints:
    """Exchange the positions of pairs of elements, the best pair first, as long as an exchange saves hops.

    Args:
        traffic: spikes between each pair, symmetric with 0 on the diagonal, shape (n, n).
        pull: spikes from the host, which is at (0, 0), to each element.
        column: column of each element's tile.
        row: row of each element's tile.

    Returns:
        For each element, the element whose position it gets. Whole numbers make the result equal on every machine.
    """
    n = len(pull)
    at = np.arange(n)
    if n > LARGEST:
        return at
    distances: Floats = np.abs(column[:, None] - column) + np.abs(row[:, None] - row).astype(np.float64)
    hops = traffic @ distances + np.outer(pull, column + row)
    for _ in range(min(4 * n, _EFFORT // max(n * n, 1))):
        present = np.diagonal(hops)
        gain = present[:, None] + present - hops - hops.T - 2.0 * traffic * distances
        i, j = divmod(int(np.argmax(gain)), n)
        if gain[i, j] <= 0.0:
            break
        hops += np.outer(traffic[:, i] - traffic[:, j], distances[j] - distances[i])
        hops[:, [i, j]] = hops[:, [j, i]]
        distances[:, [i, j]] = distances[:, [j, i]]
        distances[[i, j]] = distances[[j, i]]
        at[[i, j]] = at[[j, i]]
    return at


def draw_close(chip: Chip, places: MeshPlaces, memory: Ints, traffic: Floats, pull: Floats) -> MeshPlaces:
    """Exchange whole tiles, used or not, then cores. Cores stay if an exchange could exceed a chip's memory."""
    shared, cores_per_chip = chip.limit("synapse_bytes_per_chip"), capacity(chip, len(memory))
    mesh = places.mesh
    if cores_per_chip < mesh.columns * mesh.rows * mesh.cores_per_tile:
        return places
    if shared is not None and cores_per_chip * int(memory.max(initial=0)) > shared:
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
    return places.reordered(exchange(traffic, pull, places.column, places.row))


# mypy: disable-error-code="no-untyped-def,no-untyped-call"


@kernel
def between_cores(rows, core_of, scratch, own_cores, traffic, pull):
    """Add one spike of each source to `traffic`, from `own_cores` to each core reached; core -1 is the host."""
    count, cores, visited = scratch
    for i in range(rows[0].size):
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not is_new(i, core, visited):
                continue
            if own_cores[i] < 0:
                pull[core] += 1
            else:
                traffic[own_cores[i], core] += 1


@kernel
def travel(rows, core_of, scratch, start_of, places, moves):
    """Add the moves of one spike of each source, sent separately to each core.

    Args:
        rows: rows of the projection, from `projections_by_source`.
        core_of: core of each target, from `projections_by_source`.
        scratch: scratch arrays, from `projections_by_source`.
        start_of: column, row, chip's column and chip's row of each source.
        places: the same coordinates of each core.
        moves: output by source. The function adds cores, cores on the source's tile, and the columns, rows and chips
            that spikes move.
    """
    count, cores, visited = scratch
    for i in range(rows[0].size):
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not is_new(i, core, visited):
                continue
            east = abs(places[0][core] - start_of[0][i])
            south = abs(places[1][core] - start_of[1][i])
            moves[0][i] += 1
            moves[1][i] += east == 0 and south == 0
            moves[2][i] += east
            moves[3][i] += south
            moves[4][i] += abs(places[2][core] - start_of[2][i]) + abs(places[3][core] - start_of[3][i])


@kernel
def spread(rows, core_of, scratch, begin, places, cores_reached, local, along, across):
    """Add destinations to the links of sources: first along their row, then along columns.

    Args:
        rows: rows of the projection, from `projections_by_source`.
        core_of: core of each target, from `projections_by_source`.
        scratch: scratch arrays, from `projections_by_source`.
        begin: column and row of each source.
        places: column and row of each core.
        cores_reached: output: adds the number of cores that each source reaches.
        local: output: adds the number of such cores on the source's tile.
        along: output: the largest number of tiles that each source's spikes move east and west.
        across: output: the largest number of tiles that the spikes move south and north in each column.
    """
    count, cores, visited = scratch
    for s in range(rows[0].size):
        for k in range(cores_of_source(s, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not is_new(s, core, visited):
                continue
            column = places[0][core]
            east, south = column - begin[0][s], places[1][core] - begin[1][s]
            cores_reached[s] += 1
            local[s] += east == 0 and south == 0
            along[0, s] = max(along[0, s], east)
            along[1, s] = max(along[1, s], -east)
            across[0, s, column] = max(across[0, s, column], south)
            across[1, s, column] = max(across[1, s, column], -south)


@dataclass(frozen=True, slots=True, eq=False)
class Hops:
    """Moves of one spike of each source neuron of a projection; int64, shape (sources,).

    Attributes:
        cores: number of cores to which the spike is sent for this projection.
        local: number of these cores on the source's tile, including its own core.
        east_west, north_south: hops from tile to tile.
        chip: hops from chip to chip, which `east_west` and `north_south` include.
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
    """Return the hops of every projection.

    Args:
        program: the whole network.
        into: all synapses.
        core_of: core of every neuron, -1 for generators.
        places: positions of the cores. Generators are at tile (0, 0) of chip 0, where the host's spikes enter.
        multicast: whether a spike passes a link only once: first along its row, then along columns. Links that several
            projections of a population share count for the first one. Otherwise one spike is sent to each destination
            core.
    """
    hops_of_each = [
        Hops(*np.zeros((5, program.populations[part.source].size), dtype=np.int64)) for part in program.projections
    ]
    trees: dict[int, _Tree] = {}
    coordinates = (places.column, places.row, places.chip_column, places.chip_row)
    for index, arguments in projections_by_source(into, core_of, len(places.chip)):
        source = program.projections[index].source
        source_cores = core_of[into.start[source] : into.start[source + 1]]
        if multicast:
            if source not in trees:
                trees[source] = _Tree(source_cores, places)
            hops_of_each[index] = trees[source].grow(arguments)
        else:
            hops = hops_of_each[index]
            start = tuple(start_of(source_cores, coordinate) for coordinate in coordinates)
            moves = (hops.cores, hops.local, hops.east_west, hops.north_south, hops.chip)
            travel(*arguments, start, coordinates, moves)
    return tuple(hops_of_each)


def start_of(own_cores: Ints, coordinate: Ints) -> Ints:
    """Return a coordinate of each source neuron: the coordinate of its core, or 0 for the host."""
    if not len(coordinate):
        return np.zeros(len(own_cores), dtype=np.int64)
    return np.where(own_cores >= 0, coordinate[own_cores], 0)


class _Tree:
    """Links of each neuron of a population: tiles east and west, and tiles south and north per column."""

    def __init__(self, own_cores: Ints, places: MeshPlaces) -> None:
        self.column, self.row = start_of(own_cores, places.column), start_of(own_cores, places.row)
        self.places = places.column, places.row
        self.mesh = places.mesh
        columns = int(places.column.max(initial=0)) + 1
        self.along = np.zeros((2, own_cores.size), dtype=np.int64)
        self.across = np.zeros((2, own_cores.size, columns), dtype=np.int64)

    def grow(self, arguments: tuple[Any, ...]) -> Hops:
        """Add the destinations of a projection, and return the additional links."""
        old_links = self.links()
        cores, local = np.zeros((2, self.column.size), dtype=np.int64)
        spread(*arguments, (self.column, self.row), self.places, cores, local, self.along, self.across)
        links_after = self.links()
        return Hops(cores, local, *(new - old for new, old in zip(links_after, old_links, strict=True)))

    def links(self) -> tuple[Ints, Ints, Ints]:
        """Return the number of links along rows, along columns and between chips, for each neuron."""
        column, row = self.column, self.row[:, None]
        chip_links = np.zeros_like(column)
        for side, sign in enumerate((1, -1)):
            chip_links += np.abs((column + sign * self.along[side]) // self.mesh.columns - column // self.mesh.columns)
            chip_links += np.abs((row + sign * self.across[side]) // self.mesh.rows - row // self.mesh.rows).sum(axis=1)
        return self.along.sum(axis=0), self.across.sum(axis=(0, 2)), chip_links
