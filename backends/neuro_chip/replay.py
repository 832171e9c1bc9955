"""Replay of events that SpiNNaker's programs for plastic synapses processed, for a comparison with their states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.spinnaker_rule import ONE, rule_of
from neuro.program.program import Ints
from neuro_chip.deferred import Deferred

SLOT = 65535
"""Largest content of a slot of the ring, which has 16 bits."""
_NOT_NUMBERS = ("dt", "rule", "weight_dependence", "neuromodulation", "backprop_delay")


def replay(case: Mapping[str, Any], events: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the state after every event of a case.

    Args:
        case: a recorded core: parameters of the rule, rows of synapses, and the shifts of the receptors.
        events: (events, 4): kind (0: packet of a row, 1: spike of a post neuron), row or neuron, tick, and lateness
            of a packet in ticks.

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
    post, delay, receptor, w0 = (
        np.array([value for row in plastic for value in row.get(name, ())]) for name in ("post", "delay", "type", "w0")
    )
    delays, shifts = (delay % slots).astype(np.int64), np.array(case["shifts"], dtype=np.int64)[receptor]
    mantissas = np.rint(np.abs(w0) * 2.0 ** (15 - shifts)).astype(np.int64)
    post_delays = delays if params.get("backprop_delay", True) else np.zeros_like(delays)
    part = Deferred(rule, ends, post.astype(np.int32), n, mantissas, post_delays, delays > 0, shifts)
    bits = max(1, (n - 1).bit_length())
    low_bits = (receptor << bits | post).astype(np.int64)  # a slot's index has the time above these bits
    skipped = saturated = 0
    ring: list[tuple[int, int, int]] = []
    states: dict[str, list[Any]] = {name: [] for name in _STATES}
    for number, (is_spike, unit, t, lateness) in enumerate(events.tolist()):
        if is_spike:
            part.spike(np.array([unit]), t)
        elif rows[unit]["kind"] == "stdp":
            synapses, emitted = slice(ends[unit], ends[unit + 1]), t - lateness
            part.packets(np.array([unit]), emitted)
            arrives = delays[synapses] > lateness
            indices = ((emitted + delays[synapses]) % slots << bits + 1 | low_bits[synapses])[arrives]
            added: dict[int, int] = {}
            for slot, word in zip(indices.tolist(), part.weights[synapses][arrives].tolist(), strict=True):
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
