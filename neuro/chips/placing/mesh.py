"""Where cores lie: tiles in rows and columns, chips beside each other, and an order that keeps partners close."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from neuro.chips.description import Chip, Mesh
from neuro.program.program import Floats, Ints

LARGEST = 2000
"""Most cores (or tiles) that are ordered and exchanged; more are laid out as they come."""

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


def mesh_of(chip: Chip, cores: int) -> Mesh:
    """The mesh of a chip; where none is known its cores share one tile."""
    return chip.mesh or Mesh(1, 1, chip.limit("cores_per_chip") or max(cores, 1))


def capacity(chip: Chip, cores: int) -> int:
    """Cores of one chip that can be used."""
    mesh = mesh_of(chip, cores)
    tiles = mesh.columns * mesh.rows * mesh.cores_per_tile
    return min(chip.limit("cores_per_chip") or tiles, tiles)


def lay_out(chip: Chip, memory: Ints, snake: bool) -> MeshPlaces:
    """Fill chip after chip and tile after tile with cores as they come.

    Args:
        chip: has the mesh, and perhaps a memory that the cores of a chip share.
        memory: bytes of each core.
        snake: whether the tiles of a chip are taken column by column, down and up in turn, and chips row by row, to
            and fro, so that one is beside the next; otherwise both are taken row by row.
    """
    mesh = mesh_of(chip, len(memory))
    number, within = _chips(chip, memory)
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


def _chips(chip: Chip, memory: Ints) -> tuple[Ints, Ints]:
    """The chip of each core and its number there: a chip ends when its cores or its memory are used up."""
    most, shared = capacity(chip, len(memory)), chip.limit("synapse_bytes_per_chip")
    number, within = np.zeros((2, len(memory)), dtype=np.int64)
    at, held, filled = 0, 0, 0
    for i, need in enumerate(memory):
        if held == most or (held and shared is not None and filled + int(need) > shared):
            at, held, filled = at + 1, 0, 0
        number[i], within[i] = at, held
        held, filled = held + 1, filled + int(need)
    return number, within


def chain(traffic: Floats, pull: Floats) -> Ints:
    """An order in which each comes after those to which it is tied most.

    Args:
        traffic: spikes between each two, symmetric, shape (n, n).
        pull: spikes from the host to each.
    """
    n = len(pull)
    if n == 0 or n > LARGEST:
        return np.arange(n)
    left, tied = np.ones(n, dtype=bool), pull.astype(np.float64)
    order = np.zeros(n, dtype=np.int64)
    at = int(np.lexsort((np.arange(n), traffic.sum(axis=1), -pull))[0])
    for i in range(n):
        if i:
            at = int(np.argmax(np.where(left, tied, -1.0)))
        order[i], left[at] = at, False
        tied += traffic[at]
    return order


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
    places = _exchange_tiles(places, traffic, pull)
    return places.taken(exchange(traffic, pull, places.column, places.row))


def _exchange_tiles(places: MeshPlaces, traffic: Floats, pull: Floats) -> MeshPlaces:
    mesh, n = places.mesh, len(places.chip)
    size = mesh.columns * mesh.rows
    chips, first, number = np.unique(places.chip, return_index=True, return_inverse=True)
    if size == 1 or len(chips) * size > LARGEST:
        return places
    y, x = np.divmod(np.arange(size), mesh.columns)
    column = (places.chip_column[first, None] * mesh.columns + x).reshape(-1)
    row = (places.chip_row[first, None] * mesh.rows + y).reshape(-1)
    tile = number * size + places.row % mesh.rows * mesh.columns + places.column % mesh.columns
    member = np.zeros((n, len(column)))
    member[np.arange(n), tile] = 1.0
    between = member.T @ traffic @ member
    np.fill_diagonal(between, 0.0)
    tile = exchange(between, pull @ member, column, row)[tile]
    return MeshPlaces(mesh, chips[tile // size], places.slot, column[tile], row[tile])
