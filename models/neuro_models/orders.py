"""Two orders of the same spikes, which two neurons learn to tell apart by the delays of their inputs.

All weights are one and every input spikes once, so only when they arrive can tell. Source of the rule: Mosca, MSc
thesis, 2020, eq. 131; the task and its sizes are measured choices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import neuro

__all__ = ["batch", "network"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

INPUTS = 9
_APART, _JITTER = 2.0, 0.5  # ms, from spike to spike
_FIRST = 2.0  # ms, of the first one
_THRESHOLD = 3.5  # of inputs: the fourth makes a neuron fire
_DURATION = 60.0


def network(rule: neuro.r_stddp | None = None) -> neuro.Network:
    """The inputs, all to both neurons with drawn delays, `learnt`; the first neuron to fire decides."""
    net = neuro.Network("orders", resolution=0.1)
    net.population("inputs", INPUTS, neuro.spike_generator())
    cells = neuro.iaf_psc_delta(tau_m=np.inf, E_L=0.0, V_reset=0.0, V_th=_THRESHOLD)
    net.population("cells", (2, 1), cells)
    late = neuro.uniform(low=4.0, high=8.0)
    net.connect("inputs", "cells", neuro.all_to_all(), rule or neuro.r_stddp(), weight=1.0, delay=late, name="learnt")
    net.group("choice", neuro.winner_take_all(of="cells", first_to_fire=True))
    net.trials(input="inputs", duration=_DURATION, labels={"of": "cells"})
    return net


def batch(seed: int, trials: int, orders: int = 0) -> tuple[Floats, Ints, Ints, Ints]:
    """Trials of either order, as `Simulation.trials` takes them.

    Args:
        seed: of the draws.
        trials: how many.
        orders: which two orders.

    Returns:
        times in ms, inputs, where each trial begins, and labels.
    """
    ranks = np.array([np.random.default_rng((orders, k)).permutation(INPUTS) for k in range(2)])
    rng = np.random.default_rng((orders, seed, 7))
    labels = rng.integers(2, size=trials)
    times = _FIRST + _APART * ranks[labels] + rng.normal(0.0, _JITTER, (trials, INPUTS))
    inputs = np.tile(np.arange(INPUTS), trials)
    steps: Floats = np.maximum(np.rint(times * 10.0), 0.0) / 10.0
    return steps.ravel(), inputs, INPUTS * np.arange(trials + 1), labels
