"""The result of placing: cores, what they hold and how full they are, and the hops along which traffic is priced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from neuro.chips.placing.incoming import Incoming
from neuro.chips.placing.mesh import MeshPlaces
from neuro.chips.placing.reach import reached, spread, travel
from neuro.chips.placing.split import Split
from neuro.program.backend import Problem
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


_SHOWN = 40
_RUNS = 4


@dataclass(frozen=True, slots=True)
class Core:
    """A core in use.

    Attributes:
        chip: the number of its chip.
        column, row: of its tile, counted over all chips from the corner where the host is.
        slot: its number inside the tile.
        parts: (population, first, last): it holds the neurons first <= i < last, in one or several runs.
        neurons: how many it holds.
        synapse_bytes: of the synapses onto them.
        axons_in: source neurons whose spikes reach it.
        axons_out: destination cores of its neurons, summed over the neurons.
        load: used share of each limit of the core by the limit's name.
    """

    chip: int
    column: int
    row: int
    slot: int
    parts: tuple[tuple[int, int, int], ...]
    neurons: int
    synapse_bytes: int
    axons_in: int
    axons_out: int
    load: dict[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the neurons of a program lie on a chip; `str()` of it is a report.

    Attributes:
        network: name of the program.
        target: name of the chip.
        order: as asked: "connected" or "declared".
        multicast: whether a spike to several cores shares links.
        cores: by chip, row, column and slot.
        chips_used, tiles_used: how many have a core in use.
        core_of: for each population the index in `cores` of every neuron; -1 for generators, which are the host's.
        populations, projections: their names.
        ways: hops of each projection.
        problems: what does not fit; the rest is placed all the same.
    """

    network: str
    target: str
    order: str
    multicast: bool
    cores: tuple[Core, ...]
    chips_used: int
    tiles_used: int
    core_of: tuple[Ints, ...]
    populations: tuple[str, ...]
    projections: tuple[str, ...]
    ways: tuple[Hops, ...]
    problems: tuple[Problem, ...]

    def hops(self, projection: int) -> Hops:
        """What one spike of each source neuron of a projection (by index) moves."""
        return self.ways[projection]

    @property
    def total_hops(self) -> int:
        """Hops if every source neuron of every projection spikes once."""
        return sum(ways.total for ways in self.ways)

    @property
    def synapse_bytes(self) -> int:
        """Bytes of all synapses."""
        return sum(core.synapse_bytes for core in self.cores)

    def cores_of(self, population: int) -> list[int]:
        """Indices of the cores that hold neurons of a population."""
        return [i for i, core in enumerate(self.cores) if any(part[0] == population for part in core.parts)]

    def mean_hops(self, projection: int) -> dict[str, float]:
        """Moves of one spike of a projection, by name of `Hops`, averaged over its sources."""
        ways = self.ways[projection]
        return {name: float(getattr(ways, name).mean()) if ways.cores.size else 0.0 for name in _WAYS}

    def as_dict(self) -> dict[str, Any]:
        """All of it but the per-neuron arrays as plain values, for JSON."""
        return {
            "network": self.network,
            "target": self.target,
            "order": self.order,
            "multicast": self.multicast,
            "chips_used": self.chips_used,
            "tiles_used": self.tiles_used,
            "cores_used": len(self.cores),
            "synapse_bytes": self.synapse_bytes,
            "total_hops": self.total_hops,
            "cores": [asdict(core) | {"parts": self._parts(core)} for core in self.cores],
            "populations": {name: self.cores_of(i) for i, name in enumerate(self.populations)},
            "hops_per_spike": {name: self.mean_hops(i) for i, name in enumerate(self.projections)},
            "problems": [asdict(p) | {"origin": str(p.origin) if p.origin else None} for p in self.problems],
        }

    def _parts(self, core: Core) -> list[dict[str, Any]]:
        return [{"population": self.populations[p], "first": first, "last": last} for p, first, last in core.parts]

    def __str__(self) -> str:
        used = (_several(len(self.cores), "core"), _several(self.tiles_used, "tile"), _several(self.chips_used, "chip"))
        head = f"'{self.network}' on {self.target}: {used[0]} on {used[1]} of {used[2]}, order: {self.order}"
        way = "multicast" if self.multicast else "one packet for each destination core"
        memory = f"synapses take {self.synapse_bytes:,} bytes"
        hops = f"{self.total_hops:,} hops if all sources spike once, {way}"
        return "\n".join([head, memory, hops, "", *self._core_rows(), "", *self._projection_rows(), *self._refusals()])

    def _core_rows(self) -> list[str]:
        table: list[tuple[str, ...]] = [
            ("chip", "tile", "core", "neurons", "bytes", "axons in", "axons out", "fullest", "holds")
        ]
        for core in self.cores[:_SHOWN]:
            name, share = max(core.load.items(), key=lambda item: item[1], default=("", 0.0))
            held = [f"{self.populations[p]}[{first}:{last}]" for p, first, last in core.parts]
            held[_RUNS:] = [f"{len(held) - _RUNS} more runs"] if len(held) > _RUNS else []
            counts = (core.neurons, core.synapse_bytes, core.axons_in, core.axons_out)
            full = f"{share:.0%} {name}" if name else "-"
            place = (str(core.chip), f"{core.column},{core.row}", str(core.slot))
            table.append((*place, *(f"{count:,}" for count in counts), full, ", ".join(held)))
        rows = aligned(table, right=7)
        rest = self.cores[_SHOWN:]
        return rows if not rest else [*rows, f"... and {_several(len(rest), 'more core')}"]

    def _projection_rows(self) -> list[str]:
        table: list[tuple[str, ...]] = [
            ("to cores", "same tile", "east-west", "north-south", "chip to chip", "a spike of")
        ]
        for index, name in enumerate(self.projections):
            table.append((*(f"{value:.4g}" for value in self.mean_hops(index).values()), name))
        return aligned(table, right=5)

    def _refusals(self) -> list[str]:
        if not self.problems:
            return []
        lines = [f"  {p.what}: {p.why}" + (f"\n    hint: {p.way_out}" if p.way_out else "") for p in self.problems]
        return ["", "does not fit:", *lines]


_WAYS = ("cores", "local", "east_west", "north_south", "chip")


def _several(count: int, what: str) -> str:
    return f"{count:,} {what}" + "s" * (count != 1)


def aligned(rows: Sequence[tuple[str, ...]], right: int) -> list[str]:
    """Columns of equal width, the first `right` of them set to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = enumerate(zip(row, widths, strict=True))
        lines.append("  ".join(cell.rjust(w) if i < right else cell.ljust(w) for i, (cell, w) in cells))
    return [line.rstrip() for line in lines]
