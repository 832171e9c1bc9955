"""Orders of the same spikes, which neurons learn to distinguish by the delays of their inputs.

All weights are 1 and every input spikes once, so only the arrival times differ. `batch` has two random orders; `bars` a
spiking grid of 3 x 3 pixels whose bar comes first. A rule for weights learns the same task from random weights with
equal delays. Source of the rule: Mosca, MSc thesis, 2020, eq. 131. The tasks and their sizes are measured choices.
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
_APART, _JITTER = 2.0, 0.5  # ms, interval between spikes and its jitter
_FIRST_SPIKE = 2.0  # ms, time of the first spike
_LATE_DELAY = 6.0  # ms, delay of the pixels beside a bar after those of the bar
_DURATION = 60.0
BARS = np.array([[3, 4, 5], [2, 4, 6], [1, 4, 7], [0, 4, 8]])
"""Pixels of the bars through the middle of the grid, (4, 3), row by row: horizontal, rising, vertical, falling."""


def network(rule: neuro.extend.Synapse | None = None, labels: int = 2, threshold: float = 3.5) -> neuro.Network:
    """Return inputs that project by `learnt` to one neuron per label; the first neuron to fire decides.

    Args:
        rule: `r_stddp`, with random delays and weights 1; or a rule for weights in trials, with equal delays and random
            weights around 0.5.
        labels: number of labels: 2 for `batch`, 4 for `bars`.
        threshold: threshold of the neurons in inputs of weight 1; at 3.5 the fourth input makes a neuron fire.
    """
    rule = rule or neuro.r_stddp()
    net = neuro.Network("orders", resolution=0.1)
    net.population("inputs", INPUTS, neuro.spike_generator())
    cells = neuro.iaf_psc_delta(tau_m=np.inf, E_L=0.0, V_reset=0.0, V_th=threshold)
    net.population("cells", (labels, 1), cells)
    options: dict[str, Any] = {"weight": 1.0, "delay": neuro.uniform(low=4.0, high=8.0)}
    if not rule.delays:
        options = {"weight": neuro.uniform(low=0.4, high=0.6), "delay": 4.0}
    net.connect("inputs", "cells", neuro.all_to_all(), rule, **options, name="learnt")
    net.group("choice", neuro.winner_take_all(of="cells", first_to_fire=True))
    net.trials(input="inputs", duration=_DURATION, labels={"of": "cells"})
    return net


def batch(seed: int, trials: int, orders: int = 0) -> tuple[Floats, Ints, Ints, Ints]:
    """Draw trials of two orders, in the format of `Simulation.trials`.

    Args:
        seed: seed of the draws.
        trials: number of trials.
        orders: index of the pair of orders.

    Returns:
        times in ms, inputs, start index of each trial, and labels.
    """
    ranks = np.array([np.random.default_rng((orders, k)).permutation(INPUTS) for k in range(2)])
    rng = np.random.default_rng((orders, seed, 7))
    labels = rng.integers(2, size=trials)
    return _trials(_FIRST_SPIKE + _APART * ranks[labels], labels, rng)


def bars(seed: int, trials: int) -> tuple[Floats, Ints, Ints, Ints]:
    """Draw trials of one of the `BARS` each, whose pixels spike before the others, in the format of `batch`.

    The grid stands for the demonstrator of the thesis (line 3175), whose sizes the thesis does not give.

    Args:
        seed: seed of the draws.
        trials: number of trials.
    """
    rng = np.random.default_rng((seed, 11))
    labels = rng.integers(len(BARS), size=trials)
    times = np.full((trials, INPUTS), _FIRST_SPIKE + _LATE_DELAY)
    np.put_along_axis(times, BARS[labels], _FIRST_SPIKE, axis=1)
    return _trials(times, labels, rng)


def _trials(times: Floats, labels: Ints, rng: np.random.Generator) -> tuple[Floats, Ints, Ints, Ints]:
    """Return trials from the times of their inputs, with jitter."""
    trials = len(labels)
    jittered = times + rng.normal(0.0, _JITTER, times.shape)
    steps: Floats = np.maximum(np.rint(jittered * 10.0), 0.0) / 10.0
    return steps.ravel(), np.tile(np.arange(INPUTS), trials), INPUTS * np.arange(trials + 1), labels
