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

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.incoming import Incoming, incoming, memory_limit, spiking
from neuro.chips.inputs import longest_lag, register
from neuro.chips.known import placed_as
from neuro.chips.mesh import (
    LARGEST,
    Hops,
    MeshPlaces,
    between_cores,
    capacity,
    chain,
    draw_close,
    lay_out,
    reached,
    routes,
)
from neuro.chips.splitting import Split, fewest_cores, neurons_of, split
from neuro.core.errors import ModelError, unknown
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
            "cores": [
                asdict(core)
                | {"parts": [dict(zip(_RUN, (self.populations[p], *ends), strict=True)) for p, *ends in core.parts]}
                for core in self.cores
            ],
            "populations": {name: self.cores_of(i) for i, name in enumerate(self.populations)},
            "hops_per_spike": {name: self.mean_hops(i) for i, name in enumerate(self.projections)},
            "problems": [asdict(p) | {"origin": str(p.origin) if p.origin else None} for p in self.problems],
        }

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


ORDERS = ("connected", "declared")
_LIMITS = ("neurons_per_core", "synapse_bytes_per_core", "axons_in_per_core", "axons_out_per_core")


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
    if order not in ORDERS:
        raise unknown("order", order, ORDERS)
    if neurons_per_core is not None:
        if type(neurons_per_core) is not int or neurons_per_core < 1:
            raise ModelError(f"neurons_per_core = {neurons_per_core!r}: expected a whole number >= 1")
        limit = chip.limit("neurons_per_core")
        if limit is not None and neurons_per_core > limit:
            raise ModelError(
                f"neurons_per_core = {neurons_per_core}: expected at most {limit}, the limit of {chip.name}"
            )
    multicast = placed_as(chip).multicast
    into = incoming(program, placed_as(chip).keeps_kernels)
    declared = neurons_of(program)
    drafts: list[tuple[Split, MeshPlaces]] = []
    is_large = order == "connected" and fewest_cores(program, chip, into) > LARGEST
    if not is_large:
        plain = split(program, chip, into, declared, neurons_per_core)
        drafts.append((plain, lay_out(chip, plain.memory, snake=False)))
    if order == "connected":
        tied = _tied(program, into, declared)
        if is_large or tied != declared or any(part.grid is not None for part in program.projections):
            plain = split(program, chip, into, tied, neurons_per_core, by_place=True)
        drafts.insert(0, _close(chip, into, plain))
    numbered: list[tuple[int, int, Split, MeshPlaces, tuple[Hops, ...]]] = []
    for cut, places in drafts:
        # Cores are numbered by their places.
        by_place = np.lexsort((places.slot, places.column, places.row, places.chip))
        cut, places = cut.taken(by_place), places.taken(by_place)
        ways = routes(program, into, cut.core_of, places, multicast)
        numbered.append((len(np.unique(places.chip)), sum(part.total for part in ways), cut, places, ways))
    chips, _, cut, places, ways = min(numbered, key=lambda draft: draft[:2])
    return Placement(
        network=program.name,
        target=chip.name,
        order=order,
        multicast=multicast,
        cores=tuple(_core(chip, cut, places, i) for i in range(len(cut.cores))),
        chips_used=chips,
        tiles_used=len(np.unique(np.stack((places.column, places.row)), axis=1).T),
        core_of=tuple(cut.core_of[a:b] for a, b in zip(into.start[:-1], into.start[1:], strict=True)),
        populations=tuple(part.name for part in program.populations),
        projections=tuple(part.name for part in program.projections),
        ways=ways,
        problems=exceeded(program, chip, into, cut, chips),
    )


def _tied(program: Program, into: Incoming, populations: list[int]) -> list[int]:
    """Populations in an order that follows their synapses."""
    n = len(program.populations)
    synapses, pull = np.zeros((n, n)), np.zeros(n)
    for part, count in zip(program.projections, into.synapses, strict=True):
        if part.source in populations:
            synapses[[part.source, part.target], [part.target, part.source]] += count
        else:
            pull[part.target] += count
    np.fill_diagonal(synapses, 0.0)
    order = chain(synapses[np.ix_(populations, populations)], pull[populations])
    return [populations[i] for i in order]


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
    used = [int(counts[i]) for counts in (cut.neurons, cut.memory, cut.axons_in, cut.axons_out)]
    return Core(
        chip=int(places.chip[i]),
        column=int(places.column[i]),
        row=int(places.row[i]),
        slot=int(places.slot[i]),
        parts=cut.cores[i],
        neurons=used[0],
        synapse_bytes=used[1],
        axons_in=used[2],
        axons_out=used[3],
        load={name: n / most for name, n in zip(_LIMITS, used, strict=True) if (most := chip.limit(name))},
    )


def exceeded(program: Program, chip: Chip, into: Incoming, split: Split, chips: int) -> tuple[Problem, ...]:
    """All that does not fit, at once; delays only where the arithmetic is not emulated, as quantising tells them else.

    Args:
        program: has the names and places in the description.
        chip: has the limits; `chips` among them is the size of the largest machine.
        into: all synapses.
        split: the cores; a neuron that fits on none has one of its own.
        chips: how many are needed.
    """
    return (
        *_too_much(program, chip, split, "memory", split.memory, memory_limit(chip), into),
        *_too_much(program, chip, split, "in", split.axons_in, chip.limit("axons_in_per_core"), into),
        *_too_much(program, chip, split, "out", split.axons_out, chip.limit("axons_out_per_core"), into),
        *_too_large(program, chip, split, chips),
        *(() if chip.arithmetic else too_late(program, chip)),
    )


def too_late(program: Program, chip: Chip) -> Iterator[Problem]:
    """Projections with a delay that the chip's register does not hold, in the words of `neuro.chips.quantise`."""
    most, h = chip.limit("delay_max"), program.resolution
    if most is None:
        return
    of_one = placed_as(chip).register_of_one
    for index in spiking(program):
        part = program.projections[index]
        steps = part.delay_range(h)[1] if part.size else 0
        need = int(register(longest_lag(program, index), of_one).max(initial=0))
        if need > most:
            yield Problem(
                True,
                f"projection '{part.name}': a delay of {steps * h:g} ms",
                f"{need} steps in the delay register, which holds at most {most} on {chip.name}",
                f"use at most {(most - need + steps) * h:g} ms, a coarser resolution, or a chain of parrots",
                part.origin,
            )


def _too_much(
    program: Program, chip: Chip, split: Split, kind: str, need: Ints, limit: int | None, into: Incoming
) -> Iterator[Problem]:
    """Neurons that are beyond a limit although they are alone on their core, reported once for a population."""
    if limit is None:
        return
    alone: dict[int, list[tuple[int, int]]] = {}
    for core in np.flatnonzero(need > limit):
        population, neuron, _ = split.cores[core][0]
        alone.setdefault(population, []).append((neuron, int(need[core])))
    for population, found in sorted(alone.items()):
        neuron, count = min(found)
        part = program.populations[population]
        more = f" and {len(found) - 1:,} more" if len(found) > 1 else ""
        synapses = int(np.diff(into.ends)[into.start[population] + neuron])
        if kind == "memory":
            whose = "core" if chip.limit("synapse_bytes_per_core") is not None else "chip"
            why = f"its {synapses:,} synapses take {count:,} bytes, a {whose} of {chip.name} has {limit:,} for synapses"
            way_out = f"about {synapses * limit // count:,} synapses onto one neuron would fit"
        elif kind == "in":
            why = f"the spikes of {count:,} neurons reach it, a core of {chip.name} has {limit:,} input axons"
            way_out = f"at most {limit:,} sources of one neuron would fit: let neurons between gather them"
        else:
            why = f"its spikes go to {count:,} cores, a core of {chip.name} has {limit:,} output axons"
            way_out = f"targets on at most {limit:,} cores would fit: let neurons between pass its spikes on"
        yield Problem(True, f"population '{part.name}': neuron {neuron}{more}", why, way_out, part.origin)


def _too_large(program: Program, chip: Chip, split: Split, chips: int) -> Iterator[Problem]:
    """More chips than the largest machine has, reported for the population that takes most cores."""
    most = chip.limit("chips")
    if most is None or chips <= most:
        return
    held = np.bincount([index for parts in split.cores for index in {population for population, _, _ in parts}])
    largest, cores = int(np.argmax(held)), len(split.cores)
    part, own = program.populations[largest], int(held.max())
    surplus = cores - most * capacity(chip, cores)
    alone = np.sort([split.neurons[i] for i, parts in enumerate(split.cores) if {p for p, _, _ in parts} == {largest}])
    fit = part.size - int(alone[:surplus].sum())
    machine = f"{most:,} chip{'s' if most > 1 else ''} of {capacity(chip, cores):,} cores"
    yield Problem(
        True,
        f"population '{part.name}': {own:,} of {cores:,} cores",
        f"the network needs {chips:,} chips, the largest machine of {chip.name} has {machine}",
        f"about {fit:,} of its {part.size:,} neurons would fit, or more with fewer synapses"
        if 0 < surplus <= len(alone) and surplus < own
        else "the network must be smaller: fewer neurons, or fewer synapses onto each",
        part.origin,
    )
