"""What is known of a chip: its limits, its mesh and what things cost on it."""

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
    "axons_in_per_core": "sources whose spikes one core can receive",
    "axons_out_per_core": "destinations to which one core can send",
    "delay_max": "longest delay in steps of the chip",
    "delay_native": "longest delay in steps without a helper, where that is shorter",
}
"""Names of limits, and what each bounds."""

COSTS = {
    "synaptic_op": ("J", "a spike travels along one synapse"),
    "neuron_update_active": ("J", "a neuron is stepped in which a spike arrives or which spikes"),
    "neuron_update_inactive": ("J", "any other neuron is stepped"),
    "learning_update": ("J", "a synapse learns from one spike"),
    "weight_write": ("J", "the host writes one weight"),
    "spike_in_tile": ("J", "a spike reaches a core of its tile"),
    "hop_east_west": ("J", "a spike moves one tile along a row"),
    "hop_north_south": ("J", "a spike moves one tile along a column"),
    "packet": ("J", "a spike passes the router of one chip"),
    "mac": ("J", "a dense multiply-accumulate; with it nothing else is counted"),
    "static_per_chip": ("W", "a chip that is on"),
    "barrier_1_tile_time": ("s", "the end of a step on one tile"),
    "barrier_32_tiles_time": ("s", "the end of a step on 32 tiles"),
    "synaptic_op_time": ("s", "a spike travels along one synapse"),
    "neuron_update_active_time": ("s", "a neuron is stepped in which a spike arrives or which spikes"),
    "neuron_update_inactive_time": ("s", "any other neuron is stepped"),
    "learning_update_time": ("s", "a synapse learns from one spike"),
    "spike_in_tile_time": ("s", "a spike reaches a core of its tile"),
    "hop_east_west_time": ("s", "a spike moves one tile along a row"),
    "hop_north_south_time": ("s", "a spike moves one tile along a column"),
}
"""Names of costs: the unit, and what costs it."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A published number.

    Attributes:
        value: in the unit its field says (J, W, s, bytes or a count).
        source: the paper, page or table.
        conditions: technology, voltage, whether it was measured or simulated.
    """

    value: float
    source: str
    conditions: str = ""


@dataclass(frozen=True, slots=True)
class Mesh:
    """How cores lie on a chip: tiles of some cores in rows and columns; spikes hop from tile to tile.

    Attributes:
        columns, rows: tiles of one chip.
        cores_per_tile: cores that share a router.
    """

    columns: int
    rows: int
    cores_per_tile: int


@dataclass(frozen=True, slots=True)
class Chip:
    """One target: a chip, or a processor that does the same work as dense multiply-accumulates.

    Attributes:
        name: as in `neuro.compile(net, backend=name)` and `sim.energy(name)`.
        title: for people.
        arithmetic: name of the integer arithmetic that it has (`neuro.chips.arithmetics`), "" where only costs or
            limits are known.
        limits: by name, see `docs/reference/chips.md`; a limit that is not named does not exist.
        mesh: how cores lie, None where nothing is placed.
        step_s: shortest time of one step in s, None where steps take as long as their work.
        costs: joules, watts and seconds by name; empty where none is published.
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
        """A limit as a whole number, None where the chip has none of that name."""
        return int(self.limits[name].value) if name in self.limits else None
