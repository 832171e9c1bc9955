"""The description of a chip: limits, mesh of cores, and costs in energy and time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

LIMITS = {
    "chips": "chips of the largest machine",
    "cores_per_chip": "cores that run neurons",
    "neurons_per_core": "neurons of one core",
    "populations_per_core": "populations that may share one core",
    "synapse_bytes_per_core": "bytes for synapses of one core",
    "synapse_bytes_per_chip": "bytes for synapses that the cores of a chip share",
    "memory_bytes_per_core": "bytes of a core's own memory for learning, if synapses are stored elsewhere",
    "axons_in_per_core": "sources whose spikes one core can receive",
    "axons_out_per_core": "destinations to which one core can send",
    "delay_max": "longest delay in steps of the chip",
    "delay_native": "longest delay in steps without a helper, if shorter",
}
"""Names of the limits, each with the quantity that it bounds."""

COSTS = {
    "synaptic_op": ("J", "a spike travels along one synapse"),
    "neuron_update_active": ("J", "update of a neuron that receives or emits a spike"),
    "neuron_update_inactive": ("J", "update of any other neuron"),
    "learning_update": ("J", "a synapse learns from one spike"),
    "signal_update": ("J", "a synapse that a signal teaches is stepped"),
    "weight_write": ("J", "the host writes one weight"),
    "spike_in_tile": ("J", "a spike reaches a core of its tile"),
    "hop_east_west": ("J", "a spike moves one tile along a row"),
    "hop_north_south": ("J", "a spike moves one tile along a column"),
    "packet": ("J", "a spike passes the router of one chip"),
    "mac": ("J", "a dense multiply-accumulate; no other cost is counted then"),
    "static_per_chip": ("W", "a chip that is on"),
    "barrier_1_tile_time": ("s", "the end of a step on one tile"),
    "barrier_32_tiles_time": ("s", "the end of a step on 32 tiles"),
    "barrier_768_chips_time": ("s", "the end of a step on 768 chips"),
    "synaptic_op_time": ("s", "a spike travels along one synapse"),
    "neuron_update_active_time": ("s", "update of a neuron that receives or emits a spike"),
    "neuron_update_inactive_time": ("s", "update of any other neuron"),
    "learning_update_time": ("s", "a synapse learns from one spike"),
    "spike_in_tile_time": ("s", "a spike reaches a core of its tile"),
    "hop_east_west_time": ("s", "a spike moves one tile along a row"),
    "hop_north_south_time": ("s", "a spike moves one tile along a column"),
}
"""Names of the costs, each with its unit and the event that incurs it."""


CONDITIONS = {
    "chips": ("", "chips that are on"),
    "tiles": ("", "tiles with a core in use"),
    "resolution": ("ms", "length of a step of the network"),
    "rate": ("Hz", "spikes of a neuron, the mean of all"),
}
"""Properties of a run, with units. A figure may be known for a range of a property only."""

Range = tuple[float, float]
"""The smallest and the largest value."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A published number, with its range.

    Attributes:
        value: the number in the unit of its field (J, W, s, bytes or a count).
        source: paper, page or table.
        conditions: technology, voltage, and whether the number was measured or simulated.
        low, high: range of other sources and measurements, None if unknown.
        spread: source of that range.
        holds: ranges of `CONDITIONS`, by name, for which the figure is known.
        beyond: wider range of the figure outside of `holds`; None for the same range.
        guess: reason why the figure is extrapolated for every run, "" if it is not.
    """

    value: float
    source: str
    conditions: str = ""
    low: float | None = None
    high: float | None = None
    spread: str = ""
    holds: Mapping[str, Range] = field(default_factory=dict)
    beyond: Range | None = None
    guess: str = ""

    def range(self, extrapolated: bool = False) -> Range:
        """Return the smallest and the largest possible value. For a run outside `holds`, set `extrapolated`."""
        low = self.value if self.low is None else self.low
        high = self.value if self.high is None else self.high
        if extrapolated and self.beyond is not None:
            return min(low, self.beyond[0]), max(high, self.beyond[1])
        return low, high


@dataclass(frozen=True, slots=True)
class Mesh:
    """The layout of a chip: tiles in rows and columns, each with some cores. Spikes hop from tile to tile.

    Attributes:
        columns, rows: number of columns and rows of tiles of one chip.
        cores_per_tile: number of cores that share a router.
    """

    columns: int
    rows: int
    cores_per_tile: int


@dataclass(frozen=True, slots=True)
class Chip:
    """A target: a chip, or a processor that computes the network by dense multiply-accumulates.

    Attributes:
        name: name in `neuro.compile(net, backend=name)` and `sim.energy(name)`.
        title: name for readers.
        arithmetic: name of its integer arithmetic (`neuro.chips.known`), "" if only costs or limits are known.
        limits: limits by name, see `docs/reference/chips.md`. A missing limit is no limit.
        mesh: layout of the cores; None if cores have no positions.
        step_s: shortest time of one step in s; None if the work of a step decides.
        costs: joules, watts and seconds by name; empty if none is published.
        path: file of the table, "" for a chip that code defines.
    """

    name: str
    title: str
    arithmetic: str
    limits: Mapping[str, Figure] = field(default_factory=dict)
    mesh: Mesh | None = None
    step_s: Figure | None = None
    costs: Mapping[str, Figure] = field(default_factory=dict)
    path: str = ""

    def limit(self, name: str) -> int | None:
        """Return a limit as a whole number, or None if the chip has no such limit."""
        return int(self.limits[name].value) if name in self.limits else None


def mesh_of(chip: Chip, cores: int) -> Mesh:
    """Return the mesh of a chip. Without a known mesh all cores share one tile."""
    return chip.mesh or Mesh(1, 1, chip.limit("cores_per_chip") or max(cores, 1))


def capacity(chip: Chip, cores: int) -> int:
    """Return the number of cores of one chip that can be used."""
    mesh = mesh_of(chip, cores)
    tiles = mesh.columns * mesh.rows * mesh.cores_per_tile
    return min(chip.limit("cores_per_chip") or tiles, tiles)
