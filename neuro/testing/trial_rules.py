"""Networks in which a rule for trials is tried, on a shared kernel, on all pairs and on drawn synapses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_delta, spike_generator
from neuro.model.parts import winner_take_all
from neuro.model.rules import all_to_all, fixed_indegree, grid
from neuro.model.synapses import Synapse
from neuro.run.simulation import Simulation
from neuro.testing.case import Found, differences, observe
from neuro.testing.trials import batch, told

_TRIALS = 12
_WIRES = {
    "shared_kernel": (grid(kernel=(4, 4)), 10.0),
    "pairs": (all_to_all(), 20.0),
    "drawn": (fixed_indegree(n=30), 9.0),
}
"""How the sheet is connected, and about how many spikes should decide."""


def networks(rule: Synapse) -> Iterator[Network]:
    """One of each kind, and one whose trials go on after the decision; in some trials nobody decides."""
    low, high = _usual_weights(rule)
    for name, (wires, spikes) in _WIRES.items():
        if rule.delays and name == "shared_kernel":
            continue
        for stop in ("at_decision", "full") if name == "pairs" else ("at_decision",):
            net = Network(f"{name}_{stop}", resolution=0.5)
            net.population("sheet", (2, 6, 6), spike_generator())
            threshold = spikes * 0.5 * (low + high)
            model = iaf_psc_delta(tau_m=30.0, E_L=0.0, V_reset=0.0, V_th=threshold)
            net.population("maps", (6, "auto", "auto") if name == "shared_kernel" else (6, 2), model)
            delay = 2.0 if name == "shared_kernel" else uniform(low=max(0.5, getattr(rule, "d_min", 0.0)), high=6.0)
            net.connect("sheet", "maps", wires, rule, weight=uniform(low=low, high=high), delay=delay, name="learnt")
            net.group("choice", winner_take_all(of="maps"))
            labels, dropout = {"of": "maps", "maps_per_label": 2}, {"of": "maps", "p": 0.2}
            net.trials(input="sheet", duration=18.0, stop=stop, labels=labels, dropout=dropout)
            yield net


def _usual_weights(rule: Synapse) -> tuple[float, float]:
    """The middle of the positive weights that a rule allows."""
    bounds = rule.parameters()
    low, high = max(0.0, float(bounds.get("Wmin", 0.0))), float(bounds.get("Wmax", 1.0))
    if not np.isfinite(high):
        high = low + 1.0
    return low + 0.2 * (high - low), low + 0.8 * (high - low)


def found(sim: Simulation) -> Found:
    """What a batch teaches, and the same batch in two from the same beginning."""
    times, ids, offsets, labels = batch(_TRIALS)
    whole = told(sim.trials(times, ids, offsets, labels, learn=True)) | observe(sim)
    sim.reset(weights=True)
    cut, at = _TRIALS // 3, int(offsets[_TRIALS // 3])
    sim.trials(times[:at], ids[:at], offsets[: cut + 1], labels[:cut], learn=True)
    sim.trials(times[at:], ids[at:], offsets[cut:] - at, labels[cut:], learn=True)
    cuts = differences({name: whole[name] for name in observe(sim)}, observe(sim), exact=True)
    assert not cuts, f"{sim.program.name}: a batch that is cut differs\n  " + "\n  ".join(cuts)
    return whole | told(sim.trials(times, ids, offsets), "test")
