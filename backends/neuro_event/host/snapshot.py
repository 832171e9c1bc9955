"""The arrays of the kernels as a state that is saved, and back."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats, Program
from neuro_event.building import generators, layout, projections
from neuro_event.building.arrays import EventArrays
from neuro_event.loop import tables as t

_LAID_OUT = {"edges", "most", "rows", "runs", "targets", "delays", "order"}
_GIVEN = _LAID_OUT | {"map_of", "initial", "resets", "keys", "group_keys", "local", "stages"}
VIEWS = {"x", "bits", "awake_groups", "due_groups", "due_slots", "spot_words", "traces"}
"""Arrays that show others in another way."""
_EMPTY = {
    "empty_input",
    "scratch",
    "words",
    "found",
    "found_arrived",
    "fired",
    "draws",
    "won",
    "queue",
    "tally",
    "none",
    "spots",
    "stop",
    "reached",
}
_LISTS = {"incoming", "in_synapse", "in_source"}
_NOTES = {"note_this", "note_at", "note_steps", "note_synapses", "note_y"}
_DRIVES = {
    "lines",
    "line_ends",
    "line_columns",
    "line_lates",
    "line_weights",
    "shares",
    "emitted",
    "emitted_rows",
    "emitted_from",
}
_REBUILT = _DRIVES | {
    "guides",
    "cumulative",
    "incoming",
    "joined",
    "joined_runs",
    "joined_steps",
    "joined_weights",
    "joined_singles",
    "joined_bases",
    "joined_reach",
    "at_emission",
    "list_steps",
    "list_ids",
    "list_counts",
    "cursor",
}
_MOVES = {
    "move_table",
    "move_rule",
    "move_left",
    "move_adds",
    "move_x_min",
    "move_sign",
    "move_signal",
    "move_spikes",
    "move_seen",
    "move_concerned",
}
_CHANGING = [t.LAG, t.RING, t.RING_MASK, t.RING_SIZE, t.WEIGHT, t.WEIGHT_STRIDE, t.SIGN, t.DENSE_COUNTS]
"""Columns of projections that a run may change; the others follow from the program."""
_FIXED = _GIVEN | VIEWS | _EMPTY | _REBUILT
"""Arrays that a snapshot leaves out: they follow from the program, or hold nothing between two runs."""


def snapshot(a: EventArrays) -> dict[str, NDArray[Any]]:
    """Copies of all arrays that hold something between two runs."""
    net = {f"net.{k}": v.copy() for k, v in a.net.items() if k not in _FIXED}
    net["net.state"] = a.net["state"][:, : layout.total(a.program)].copy()  # each row ends in room for nothing
    net["net.due"] = _own_marks(a, a.net["due"])
    net["net.pops"] = a.net["pops"][:, : t.NUMBER].copy()  # what follows are addresses of this process
    net["net.projections"] = a.net["projections"][:, : t.CHANNEL_HEIGHT].copy()  # the rest follows from the program
    plastic = {
        f"plastic.{k}": v.copy() for k, v in a.plastic.items() if k not in VIEWS | _NOTES | _LISTS | _MOVES | {"rule"}
    }
    plastic["plastic.table"] = a.plastic["table"][:, : t.RULE_NUMBER].copy()
    return {**net, **plastic}


def _own_marks(a: EventArrays, due: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The marks of arrivals, flat: of each block those of the thread that it belongs to."""
    owner = np.zeros(a.net["awake"].size, dtype=np.int64)
    for edges in a.net["edges"]:
        for thread, (first, end) in enumerate(pairwise(edges.tolist())):
            owner[first:end] = thread
    slots = due.reshape(due.shape[0], -1, owner.size)
    return slots[owner, :, np.arange(owner.size)].T.ravel()


def is_eager(arrays: Mapping[str, NDArray[Any]]) -> bool:
    """Whether synapses learn eagerly in a snapshot where they can."""
    return len(arrays["plastic.heard"]) > 0


def joined(arrays: Mapping[str, NDArray[Any]]) -> frozenset[int]:
    """The projections in joined rows; there are none in a state of before there were any."""
    return frozenset(arrays["engine.joined"].tolist()) if "engine.joined" in arrays else frozenset()


def restore(a: EventArrays, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Put the arrays of a snapshot in place of those of step 0."""
    weights = arrays["net.weights"]
    if not np.array_equal(weights, a.net["weights"]):
        projections.own_weights(a)
    for name, value in arrays.items():
        part, _, rest = name.partition(".")
        if name == "net.pops":
            a.net["pops"][:, : t.NUMBER] = value
        elif name == "net.projections":
            a.net["projections"][:, _CHANGING] = value[:, _CHANGING]
        elif name == "net.due":
            a.net["due"] = np.tile(value, (a.net["due"].shape[0], 1))
        elif name == "net.state":
            a.net["state"][:, : value.shape[1]] = value
        elif part == "net" and a.net[rest].shape == value.shape:
            a.net[rest][...] = value  # where it lies is well chosen, see `memory`
        elif part == "net":
            a.net[rest] = value.astype(a.net[rest].dtype)  # a copy; counts of older states have 32 bits
        elif name == "plastic.table":
            a.plastic["table"][:, : t.RULE_NUMBER] = value
        elif part == "plastic":
            a.plastic[rest] = value.copy()
    rings = [q for q in range(len(a.program.projections)) if a.net["projections"][q, t.LAG] == 0]
    a.net["at_emission"] = np.array([q for q in rings if q not in a.plastic_of], dtype=np.int64)
    for q in a.joined.intersection(rings):
        projections.lay_out(a, q)
    projections.set_buffer(a, a.net["buf"])
    projections.list_incoming(a)
    generators.tabulate(a)


class ChangedValues:
    """Values as they were given, which a reset sets again, and what the program says otherwise by now.

    Args:
        program: what runs.

    Attributes:
        given: parameters that were set, by population and word, in the order of ids.
        rows: rows of parameters by population, in the order of the kernels.
        rules: the numbers of each projection's synapse model.
        kept: weights onto relays, which no kernel reads.
    """

    def __init__(self, program: Program) -> None:
        self.given: dict[tuple[int, str], Floats] = {}
        self.rows: dict[int, Floats] = {}
        self.rules = {q: p.synapse.vector() for q, p in enumerate(program.projections)}
        self.kept: dict[int, Floats] = {}

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        arrays = {f"given.{k}.{word}": values.copy() for (k, word), values in self.given.items()}
        for part, held in (("rule", self.rules), ("changed", self.rows), ("kept", self.kept)):
            arrays |= {f"{part}.{index}": values.copy() for index, values in held.items()}
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what a snapshot has."""
        held = {"rule": self.rules, "changed": self.rows, "kept": self.kept}
        for name, value in arrays.items():
            part, _, rest = name.partition(".")
            if part in held:
                held[part][int(rest)] = value.copy()
            elif part == "given":
                k, _, word = rest.partition(".")
                self.given[int(k), word] = value.copy()
