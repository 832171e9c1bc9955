"""Delays that learn, in ms: where they are, and how they are read and written.

Delays that spike pairs change are a row of the synapses' states. Those of rules for trials are `EventArrays.late`;
spikes read the table of delays in steps, as static ones do, so each change writes that table, too.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from neuro.model.synapses.base import DELAY, steps_of
from neuro.program.program import Floats
from neuro_event.building.arrays import EventArrays
from neuro_event.loop import tables as t


def add_delays(a: EventArrays) -> None:
    """Lay out the delays that rules for trials change."""
    for q, p in enumerate(a.program.projections):
        if p.synapse.delays and p.synapse.learns == "trials":
            a.late[q] = a.net["delays"][_steps(a, q)] * a.program.resolution


def write(a: EventArrays, q: int, delays: Floats) -> None:
    """Replace the delays of a projection, given in the order of the program's weights."""
    order = a.synapses[q].order
    inner = delays if order is None else delays[order]
    if q in a.late:
        a.late[q] = inner.copy()
        _round(a, q)
    else:
        first = a.plastic["table"][a.plastic_of[q], t.FIRST_SYNAPSE]
        a.plastic["y"][DELAY, first : first + delays.size] = inner


def snapshot(a: EventArrays) -> dict[str, NDArray[Any]]:
    """The delays that rules for trials have changed."""
    return {f"late.{q}": delays.copy() for q, delays in a.late.items()}


def restore(a: EventArrays, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Take over what a snapshot has."""
    for q in a.late:
        a.late[q] = arrays[f"late.{q}"].copy()
        _round(a, q)


def _steps(a: EventArrays, q: int) -> slice:
    """Where the steps of a projection are in the table of delays."""
    first = int(a.net["projections"][q, t.DELAY])
    return slice(first, first + a.program.projections[q].size)


def _round(a: EventArrays, q: int) -> None:
    h = a.program.resolution
    fewest, most = a.program.projections[q].delay_range(h)
    a.net["delays"][_steps(a, q)] = [steps_of(delay, h, fewest, most) for delay in a.late[q].tolist()]
