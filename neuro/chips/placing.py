"""Placement: cores, tiles and chips for a program's neurons, and the hops of spikes between cores.

Assumptions:

- Generators run on the host and use no core. Spikes of the host enter the machine at tile (0, 0) of chip 0.
- A core gets neurons of a population as long as its limits allow. A population that fits completely shares the core of
  the previous population, if several populations may share a core (`populations_per_core`; not on SpiNNaker).
- Synapses are stored at the target's core, see `neuro.chips.incoming`.
- An input axon of a core is a source neuron, generators included, whose spikes reach the core by any number of
  projections. An output axon is a pair of a neuron and a core that it reaches, its own core included. The broadcast of
  a dopamine population and the currents of a dc_generator use no axons.
- A spike to several cores is sent once to each, unless routers copy it, as on SpiNNaker.
- Chips form a square, and tiles continue from one chip to the next.

Order "connected" keeps neurons at one position of a grid together, because they share sources. The next population is
always the one with most synapses to the previous populations. Cores are ordered in the same way, by their spikes, and
fill adjacent tiles. Tiles and cores are exchanged as long as an exchange saves hops. Order "declared" follows the
declaration, tile by tile and row by row. If "declared" needs fewer chips or hops, "connected" uses that placement, too.
Programs of more than 2,000 cores are laid out once, without exchanges.

Neurons, programs and delays that do not fit are refused. The delay register of a synapse follows from the step in which
the spike acts (`neuro.chips.inputs`) and from the encoding of the chip's family. For a chip without an emulated
arithmetic, the arithmetic of Loihi 1 applies.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.fitting import LARGEST, Cut, chain, cut, exceeded
from neuro.chips.incoming import Incoming, projections_by_source
from neuro.chips.known import placed_as
from neuro.chips.mesh import Hops, MeshPlaces, between_cores, draw_close, lay_out, routes
from neuro.chips.splitting import Split
from neuro.core.tables import aligned
from neuro.program.backend import Problem
from neuro.program.program import Ints, Program

_SHOWN = 40
_RUNS = 4
_RUN = ("population", "first", "last")


@dataclass(frozen=True, slots=True)
class Core:
    """A core in use.

    Attributes:
        chip: number of its chip.
        column, row: position of its tile, counted over all chips from the corner of the host.
        slot: number inside the tile.
        parts: runs (population, first, last) of the neurons first <= i < last on the core.
        neurons: number of neurons.
        synapse_bytes: bytes of the synapses onto these neurons.
        own_bytes: bytes of the core's own memory for learning; 0 if the family counts none.
        axons_in: number of source neurons whose spikes reach the core.
        axons_out: number of destination cores of its neurons, summed over the neurons.
        load: used share of each limit of the core, by name of the limit.
    """

    chip: int
    column: int
    row: int
    slot: int
    parts: tuple[tuple[int, int, int], ...]
    neurons: int
    synapse_bytes: int
    own_bytes: int
    axons_in: int
    axons_out: int
    load: dict[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """The placement of a program's neurons on a chip; `str()` returns a report.

    Attributes:
        network: name of the program.
        target: name of the chip.
        order: "connected" or "declared", the choice of the user.
        multicast: whether a spike to several cores shares links.
        cores: the cores in use, sorted by chip, row, column and slot.
        chips_used, tiles_used: number of chips and tiles with a core in use.
        core_of: for each population the index in `cores` of every neuron; -1 for generators, which run on the host.
        populations, projections: names of the populations and projections.
        ways: hops of each projection.
        problems: parts that do not fit but are placed nevertheless.
        notes: memory and time of learning as text, if known.
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
    notes: tuple[str, ...] = ()

    def hops(self, projection: int) -> Hops:
        """Return the moves of one spike of each source neuron of a projection, given by its index."""
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
        """Return the indices of the cores with neurons of a population."""
        return [i for i, core in enumerate(self.cores) if any(part[0] == population for part in core.parts)]

    def mean_hops(self, projection: int) -> dict[str, float]:
        """Return the mean moves of a spike of a projection over all sources, by the names of `Hops`."""
        ways = self.ways[projection]
        return {name: float(getattr(ways, name).mean()) if ways.cores.size else 0.0 for name in _WAYS}

    def as_dict(self) -> dict[str, Any]:
        """Return everything except the per-neuron arrays as plain values for JSON."""
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
            "cores": [
                asdict(core)
                | {"parts": [dict(zip(_RUN, (self.populations[p], *ends), strict=True)) for p, *ends in core.parts]}
                for core in self.cores
            ],
            "populations": {name: self.cores_of(i) for i, name in enumerate(self.populations)},
            "hops_per_spike": {name: self.mean_hops(i) for i, name in enumerate(self.projections)},
            "notes": list(self.notes),
            "problems": [asdict(p) | {"origin": str(p.origin) if p.origin else None} for p in self.problems],
        }

    def __str__(self) -> str:
        used = (_several(len(self.cores), "core"), _several(self.tiles_used, "tile"), _several(self.chips_used, "chip"))
        head = f"'{self.network}' on {self.target}: {used[0]} on {used[1]} of {used[2]}, order: {self.order}"
        packets = "multicast" if self.multicast else "one packet per destination core"
        memory = f"memory of synapses: {self.synapse_bytes:,} bytes"
        hops = f"hops when every source spikes once: {self.total_hops:,} ({packets})"
        return "\n".join(
            [head, memory, *self.notes, hops, "", *self._core_rows(), "", *self._projection_rows(), *self._refusals()]
        )

    def _core_rows(self) -> list[str]:
        table: list[tuple[str, ...]] = [
            ("chip", "tile", "core", "neurons", "bytes", "axons in", "axons out", "fullest", "holds")
        ]
        for core in self.cores[:_SHOWN]:
            name, share = max(core.load.items(), key=lambda item: item[1], default=("", 0.0))
            runs = [f"{self.populations[p]}[{first}:{last}]" for p, first, last in core.parts]
            runs[_RUNS:] = [f"{len(runs) - _RUNS} more runs"] if len(runs) > _RUNS else []
            counts = (core.neurons, core.synapse_bytes, core.axons_in, core.axons_out)
            load_text = f"{share:.0%} {name}" if name else "-"
            position = (str(core.chip), f"{core.column},{core.row}", str(core.slot))
            table.append((*position, *(f"{count:,}" for count in counts), load_text, ", ".join(runs)))
        rows = aligned(table, ">" * 7)
        unlisted_cores = self.cores[_SHOWN:]
        return rows if not unlisted_cores else [*rows, f"... and {_several(len(unlisted_cores), 'more core')}"]

    def _projection_rows(self) -> list[str]:
        table: list[tuple[str, ...]] = [
            ("to cores", "same tile", "east-west", "north-south", "chip to chip", "per spike of")
        ]
        for index, name in enumerate(self.projections):
            table.append((*(f"{value:.4g}" for value in self.mean_hops(index).values()), name))
        return aligned(table, ">" * 5)

    def _refusals(self) -> list[str]:
        if not self.problems:
            return []
        lines = [f"  {p.what}: {p.why}" + (f"\n    hint: {p.way_out}" if p.way_out else "") for p in self.problems]
        return ["", "does not fit:", *lines]


_WAYS = ("cores", "local", "east_west", "north_south", "chip")


def _several(count: int, noun: str) -> str:
    return f"{count:,} {noun}" + "s" * (count != 1)


_LIMITS = (
    "neurons_per_core",
    "synapse_bytes_per_core",
    "memory_bytes_per_core",
    "axons_in_per_core",
    "axons_out_per_core",
)


def place(program: Program, chip: Chip, *, order: str = "connected", neurons_per_core: int | None = None) -> Placement:
    """Place the neurons of a program on cores.

    Args:
        program: a program with float models or the chip's own models. Weights and states have no effect.
        chip: a chip with limits. Without a mesh all cores share one tile.
        order: "connected" or "declared".
        neurons_per_core: largest number of neurons on a core, below the chip's limit.

    Returns:
        The placement, which is always the same for the same arguments. Its `problems` list the parts that do not fit.
        Delays on a chip with an emulated arithmetic are checked by `neuro.chips.quantising` instead.

    Raises:
        ModelError: an argument is not allowed.
    """
    return place_cores(program, chip, cut(program, chip, order=order, neurons_per_core=neurons_per_core))


def place_cores(program: Program, chip: Chip, filled: Cut) -> Placement:
    """Place cores that are already filled."""
    multicast, into = placed_as(chip).multicast, filled.into
    drafts: list[tuple[Split, MeshPlaces]] = []
    if filled.connected is not None:
        drafts.append(_close(chip, into, filled.connected))
    if filled.declared is not None:
        drafts.append((filled.declared, lay_out(chip, filled.declared.memory, snake=False)))
    numbered: list[tuple[int, int, Split, MeshPlaces, tuple[Hops, ...]]] = []
    for cores, places in drafts:
        # Cores are numbered by their positions.
        by_place = np.lexsort((places.slot, places.column, places.row, places.chip))
        cores, places = cores.reordered(by_place), places.reordered(by_place)
        hops = routes(program, into, cores.core_of, places, multicast)
        numbered.append((len(np.unique(places.chip)), sum(part.total for part in hops), cores, places, hops))
    chips, _, cores, places, hops = min(numbered, key=lambda draft: draft[:2])
    return Placement(
        network=program.name,
        target=chip.name,
        order=filled.order,
        multicast=multicast,
        cores=tuple(_core(chip, cores, places, i) for i in range(len(cores.cores))),
        chips_used=chips,
        tiles_used=len(np.unique(np.stack((places.column, places.row)), axis=1).T),
        core_of=tuple(cores.core_of[a:b] for a, b in zip(into.start[:-1], into.start[1:], strict=True)),
        populations=tuple(part.name for part in program.populations),
        projections=tuple(part.name for part in program.projections),
        ways=hops,
        problems=exceeded(program, chip, into, cores, chips),
        notes=tuple(placed_as(chip).learning_notes(program, chip, cores.cores)),
    )


def _close(chip: Chip, into: Incoming, cut: Split) -> tuple[Split, MeshPlaces]:
    """Order cores and lay them out, with cores that exchange many spikes close to each other."""
    if len(cut.cores) > LARGEST:
        return cut, lay_out(chip, cut.memory, snake=True)
    # Spikes between each pair of cores, and from the host to each core, if all sources spike once.
    n = len(cut.cores)
    traffic, pull = np.zeros((n, n)), np.zeros(n)
    for index, arguments in projections_by_source(into, cut.core_of, n):
        source = into.begins_at[index]
        between_cores(*arguments, cut.core_of[into.start[source] : into.start[source + 1]], traffic, pull)
    np.fill_diagonal(traffic, 0.0)
    traffic = traffic + traffic.T
    order = chain(traffic, pull)
    cut, traffic, pull = cut.reordered(order), traffic[np.ix_(order, order)], pull[order]
    places = lay_out(chip, cut.memory, snake=True)
    return cut, draw_close(chip, places, cut.memory, traffic, pull)


def _core(chip: Chip, cut: Split, places: MeshPlaces, i: int) -> Core:
    """Return the description of a core, with its load."""
    loads = [int(counts[i]) for counts in (cut.neurons, cut.memory, cut.own, cut.axons_in, cut.axons_out)]
    return Core(
        chip=int(places.chip[i]),
        column=int(places.column[i]),
        row=int(places.row[i]),
        slot=int(places.slot[i]),
        parts=cut.cores[i],
        neurons=loads[0],
        synapse_bytes=loads[1],
        own_bytes=loads[2],
        axons_in=loads[3],
        axons_out=loads[4],
        load={name: n / limit for name, n in zip(_LIMITS, loads, strict=True) if (limit := chip.limit(name))},
    )
