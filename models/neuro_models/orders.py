"""Orders of the same spikes, which neurons learn to tell apart by the delays of their inputs.

All weights are one and every input spikes once, so only when they arrive can tell. `batch` has two drawn orders, `bars`
a spiking grid of 3 x 3 pixels whose bar comes first. A rule of weights learns the same, from drawn weights with equal
delays. Source of the rule: Mosca, MSc thesis, 2020, eq. 131; the tasks and their sizes are measured choices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro
import neuro.extend

__all__ = ["BARS", "bars", "batch", "network"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

INPUTS = 9
_APART, _JITTER = 2.0, 0.5  # ms, from spike to spike
_FIRST = 2.0  # ms, of the first one
_LATE = 6.0  # ms, of the pixels beside a bar, after its own
_DURATION = 60.0
BARS = np.array([[3, 4, 5], [2, 4, 6], [1, 4, 7], [0, 4, 8]])
"""(4, 3), pixels of the bars through the middle of the grid, row by row: horizontal, rising, vertical, falling."""


def network(rule: neuro.extend.Synapse | None = None, labels: int = 2, threshold: float = 3.5) -> neuro.Network:
    """Inputs, all to a neuron for each label by the projection `learnt`; the first neuron to fire decides.

    Args:
        rule: `r_stddp`, whose delays are drawn and whose weights are 1; or a rule of weights for trials, whose delays
            are equal and whose weights are drawn round 0.5.
        labels: how many: 2 of `batch`, 4 of `bars`.
        threshold: of the neurons, in inputs of weight 1: above 3.5 the fourth makes a neuron fire.
    """
    rule = rule or neuro.r_stddp()
    net = neuro.Network("orders", resolution=0.1)
    net.population("inputs", INPUTS, neuro.spike_generator())
    cells = neuro.iaf_psc_delta(tau_m=np.inf, E_L=0.0, V_reset=0.0, V_th=threshold)
    net.population("cells", (labels, 1), cells)
    words: dict[str, Any] = {"weight": 1.0, "delay": neuro.uniform(low=4.0, high=8.0)}
    if not rule.delays:
        words = {"weight": neuro.uniform(low=0.4, high=0.6), "delay": 4.0}
    net.connect("inputs", "cells", neuro.all_to_all(), rule, **words, name="learnt")
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
    return _trials(_FIRST + _APART * ranks[labels], labels, rng)


def bars(seed: int, trials: int) -> tuple[Floats, Ints, Ints, Ints]:
    """Trials of one of the `BARS` each, whose pixels come first and the others later, as `batch` gives them.

    The grid stands for the demonstrator of the thesis (line 3175), whose sizes the thesis does not print.

    Args:
        seed: of the draws.
        trials: how many.
    """
    rng = np.random.default_rng((seed, 11))
    labels = rng.integers(len(BARS), size=trials)
    times = np.full((trials, INPUTS), _FIRST + _LATE)
    np.put_along_axis(times, BARS[labels], _FIRST, axis=1)
    return _trials(times, labels, rng)


def _trials(times: Floats, labels: Ints, rng: np.random.Generator) -> tuple[Floats, Ints, Ints, Ints]:
    """Trials with jitter, of the times of their inputs."""
    trials = len(labels)
    jittered = times + rng.normal(0.0, _JITTER, times.shape)
    steps: Floats = np.maximum(np.rint(jittered * 10.0), 0.0) / 10.0
    return steps.ravel(), np.tile(np.arange(INPUTS), trials), INPUTS * np.arange(trials + 1), labels
