"""Place: from a program and a chip to cores, tiles and chips, and the hops that spikes make between them.

What is taken to be so:

- Generators are the host's: they take no core, and their spikes enter the machine at tile (0, 0) of chip 0.
- A core takes neurons of a population as long as its limits allow. A population that fits whole shares the core of
  the one before it, where the chip lets several populations share a core (`populations_per_core`:
  SpiNNaker does not).
- Synapses lie at the target's core, see `neuro.chips.incoming`.
- An input axon of a core is a source neuron whose spikes reach it, generators' too, however many projections it has;
  an output axon is a pair of a neuron and a core that it reaches, its own core included. A dopamine population's
  broadcast and currents of a dc_generator take none.
- A spike to several cores is sent once for each, except where routers copy it, as SpiNNaker's do.
- Chips lie side by side on a square, and their tiles go on from one chip to the next.

Order "connected" takes neurons that lie at one place of a grid together, since they share their sources, and takes
populations and cores in an order in which each comes after those to which it is tied most. It lays the cores along
tiles that touch, and exchanges tiles and cores while that saves hops. Order "declared" takes all as it is declared,
tile by tile and row by row. Where this happens to be shorter, "connected" takes it, too, unless it needs more than
2,000 cores at any rate: those are laid out once, as they come.

What fits on no core, on no machine or into no delay register is refused. What the delay register of a spike holds
follows from when the spike acts (`neuro.chips.inputs`) and from how the family counts. A chip without an
arithmetic here is taken to count as Loihi 1.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.fitting import LARGEST, Cut, chain, cut, exceeded
from neuro.chips.incoming import Incoming, reached
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
        chip: the number of its chip.
        column, row: of its tile, counted over all chips from the corner where the host is.
        slot: its number inside the tile.
        parts: (population, first, last): it holds the neurons first <= i < last, in one or several runs.
        neurons: how many it holds.
        synapse_bytes: of the synapses onto them.
        own_bytes: of the core's own memory that learning takes, 0 where that is not known.
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
    own_bytes: int
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
        notes: what learning takes of the cores, in words, as far as that is known.
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
        way = "multicast" if self.multicast else "one packet for each destination core"
        memory = f"synapses take {self.synapse_bytes:,} bytes"
        hops = f"{self.total_hops:,} hops if all sources spike once, {way}"
        return "\n".join(
            [head, memory, *self.notes, hops, "", *self._core_rows(), "", *self._projection_rows(), *self._refusals()]
        )

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
        rows = aligned(table, ">" * 7)
        rest = self.cores[_SHOWN:]
        return rows if not rest else [*rows, f"... and {_several(len(rest), 'more core')}"]

    def _projection_rows(self) -> list[str]:
        table: list[tuple[str, ...]] = [
            ("to cores", "same tile", "east-west", "north-south", "chip to chip", "a spike of")
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


def _several(count: int, what: str) -> str:
    return f"{count:,} {what}" + "s" * (count != 1)


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
        program: of float or of a chip's own models; its values do not matter.
        chip: with limits, and a mesh if its cores do not all share one tile.
        order: "connected" or "declared".
        neurons_per_core: put fewer neurons on a core than the chip allows.

    Returns:
        the same placement for the same arguments; what does not fit is in its `problems`, but the delays of a chip
        whose arithmetic is emulated, which `neuro.chips.quantising` tells.

    Raises:
        ModelError: an argument cannot be.
    """
    return placed(program, chip, cut(program, chip, order=order, neurons_per_core=neurons_per_core))


def placed(program: Program, chip: Chip, found: Cut) -> Placement:
    """Place cores that have been filled."""
    multicast, into = placed_as(chip).multicast, found.into
    drafts: list[tuple[Split, MeshPlaces]] = []
    if found.tied is not None:
        drafts.append(_close(chip, into, found.tied))
    if found.declared is not None:
        drafts.append((found.declared, lay_out(chip, found.declared.memory, snake=False)))
    numbered: list[tuple[int, int, Split, MeshPlaces, tuple[Hops, ...]]] = []
    for cores, places in drafts:
        # Cores are numbered by their places.
        by_place = np.lexsort((places.slot, places.column, places.row, places.chip))
        cores, places = cores.taken(by_place), places.taken(by_place)
        ways = routes(program, into, cores.core_of, places, multicast)
        numbered.append((len(np.unique(places.chip)), sum(part.total for part in ways), cores, places, ways))
    chips, _, cores, places, ways = min(numbered, key=lambda draft: draft[:2])
    return Placement(
        network=program.name,
        target=chip.name,
        order=found.order,
        multicast=multicast,
        cores=tuple(_core(chip, cores, places, i) for i in range(len(cores.cores))),
        chips_used=chips,
        tiles_used=len(np.unique(np.stack((places.column, places.row)), axis=1).T),
        core_of=tuple(cores.core_of[a:b] for a, b in zip(into.start[:-1], into.start[1:], strict=True)),
        populations=tuple(part.name for part in program.populations),
        projections=tuple(part.name for part in program.projections),
        ways=ways,
        problems=exceeded(program, chip, into, cores, chips),
        notes=tuple(placed_as(chip).told_of_learning(program, chip, cores.cores)),
    )


def _close(chip: Chip, into: Incoming, cut: Split) -> tuple[Split, MeshPlaces]:
    """Lay cores out so that those which exchange many spikes are close."""
    if len(cut.cores) > LARGEST:
        return cut, lay_out(chip, cut.memory, snake=True)
    # Spikes between each two cores, and from the host to each, if all sources spike once.
    n = len(cut.cores)
    traffic, pull = np.zeros((n, n)), np.zeros(n)
    for index, ways in reached(into, cut.core_of, n):
        source = into.begins_at[index]
        between_cores(*ways, cut.core_of[into.start[source] : into.start[source + 1]], traffic, pull)
    np.fill_diagonal(traffic, 0.0)
    traffic = traffic + traffic.T
    order = chain(traffic, pull)
    cut, traffic, pull = cut.taken(order), traffic[np.ix_(order, order)], pull[order]
    places = lay_out(chip, cut.memory, snake=True)
    return cut, draw_close(chip, places, cut.memory, traffic, pull)


def _core(chip: Chip, cut: Split, places: MeshPlaces, i: int) -> Core:
    """One core with its load."""
    used = [int(counts[i]) for counts in (cut.neurons, cut.memory, cut.own, cut.axons_in, cut.axons_out)]
    return Core(
        chip=int(places.chip[i]),
        column=int(places.column[i]),
        row=int(places.row[i]),
        slot=int(places.slot[i]),
        parts=cut.cores[i],
        neurons=used[0],
        synapse_bytes=used[1],
        own_bytes=used[2],
        axons_in=used[3],
        axons_out=used[4],
        load={name: n / most for name, n in zip(_LIMITS, used, strict=True) if (most := chip.limit(name))},
    )
