"""Replays of recorded calls of SpiNNaker's programs for plastic synapses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.spinnaker_rule import ONE, rule_of
from neuro.program.program import Ints
from neuro_chip.deferred import Deferred

SLOT = 65535
_NOT_NUMBERS = ("dt", "rule", "weight_dependence", "neuromodulation", "backprop_delay")


def replay(case: Mapping[str, Any], events: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the state after every event of a case.

    Args:
        case: parameters, rows and shifts of a core.
        events: kind (0: packet of a row, 1: spike of a post neuron), row or neuron, tick and lateness, (events, 4).

    Returns:
        weights, eligibility, pre, post, marks and counters by event, and `ring`: the amounts that each event has added
        to slots.
    """
    params, rows, n, slots = case["params"], case["rows"], int(case["n_post"]), 1 << int(case["delay_bits"])
    numbers = {name: value for name, value in params.items() if name not in _NOT_NUMBERS}
    rule = rule_of(
        *(params["rule"], params["weight_dependence"], numbers),
        dt=params["dt"],
        neuromodulation=params.get("neuromodulation"),
    )
    plastic = [row if row["kind"] == "stdp" else {"post": []} for row in rows]
    ends = np.concatenate(([0], np.cumsum([len(row["post"]) for row in plastic]))).astype(np.int64)
    post, delay, kind, w0 = (
        np.array([value for row in plastic for value in row.get(name, ())]) for name in ("post", "delay", "type", "w0")
    )
    stored, shifts = (delay % slots).astype(np.int64), np.array(case["shifts"], dtype=np.int64)[kind]
    mantissas = np.rint(np.abs(w0) * 2.0 ** (15 - shifts)).astype(np.int64)
    acting = stored if params.get("backprop_delay", True) else np.zeros_like(stored)
    part = Deferred(rule, ends, post.astype(np.int32), n, mantissas, acting, stored > 0, shifts)
    bits = max(1, (n - 1).bit_length())
    below = (kind << bits | post).astype(np.int64)
    skipped = saturated = 0
    ring: list[tuple[int, int, int]] = []
    states: dict[str, list[Any]] = {name: [] for name in _STATES}
    for number, (is_spike, unit, t, lateness) in enumerate(events.tolist()):
        if is_spike:
            part.spike(np.array([unit]), t)
        elif rows[unit]["kind"] == "stdp":
            unit_events, emitted = slice(ends[unit], ends[unit + 1]), t - lateness
            part.packets(np.array([unit]), emitted)
            arrives = stored[unit_events] > lateness
            place = ((emitted + stored[unit_events]) % slots << bits + 1 | below[unit_events])[arrives]
            added: dict[int, int] = {}
            for slot, word in zip(place.tolist(), part.weights[unit_events][arrives].tolist(), strict=True):
                saturated += added.get(slot, 0) + word > SLOT
                added[slot] = min(added.get(slot, 0) + word, SLOT)
            skipped += int(np.count_nonzero(~arrives))
            ring += [(number, slot, value) for slot, value in sorted(added.items()) if value]
        else:
            amounts = np.rint(np.abs(rows[unit]["concentration"]) * ONE).astype(np.int64)
            part.dopamine(np.array(rows[unit]["post"]), amounts if rows[unit]["kind"] == "reward" else -amounts, t)
        for name, state in _STATES.items():
            states[name].append(state(part))
        states["counters"][-1] = [skipped, saturated]
    return {name: np.array(values) for name, values in states.items()} | {"ring": np.array(ring).reshape(-1, 3)}


def _newest(part: Deferred) -> Ints:
    """Return the number of entries of each history, and the time and the traces of the newest entry."""
    history = part.history
    neurons, newest = np.arange(history.counts.size), history.counts - 1
    return np.column_stack((history.counts, history.times[neurons, newest], history.traces[neurons, newest]))


_STATES: dict[str, Callable[[Deferred], Any]] = {
    "weights": lambda part: part.weights.copy(),
    "eligibility": lambda part: part.tags & SLOT,
    "pre": lambda part: part.rows.copy(),
    "post": _newest,
    "marks": lambda part: part.history.marks.copy(),
    "counters": lambda part: None,
}
