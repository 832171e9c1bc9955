"""Neurons that learn delays, so that inputs from different times arrive together.

Source: Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32. Measurements decided the
number of inputs, their times and the threshold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import neuro

__all__ = ["BETWEEN", "drawn_onsets", "gathering", "spread"]

Floats = NDArray[np.float64]

BETWEEN = 200.0
"""Time from one presentation to the next, ms."""
_FIRING_SHARE = 0.3  # share of the inputs that makes the neuron fire
_START_DELAY = 31.0  # ms, the delay at the start
_LONGEST = 62.0


def drawn_onsets(seed: int, cells: int, inputs: int = 8, within: int = 30) -> Floats:
    """Draw the input times of each neuron in a presentation, whole ms from 0 to `within`, shape (cells, inputs)."""
    return np.random.default_rng(seed).integers(0, within + 1, (cells, inputs)).astype(np.float64)


def gathering(onsets: Floats, presentations: int, by_step: bool = False) -> neuro.Network:
    """Return neurons with separate inputs, whose synapses `gathered` begin with equal delays.

    Args:
        onsets: times of each neuron's inputs, ms, shape (cells, inputs).
        presentations: number of presentations.
        by_step: `by_step` of `stddp`, with tau = 50 ms; otherwise tau is 20 ms.
    """
    cells, inputs = onsets.shape
    begins = 1.0 + BETWEEN * np.arange(presentations)
    net = neuro.Network("gathering", resolution=1.0)
    net.population("inputs", cells * inputs, neuro.spike_generator(spike_times=onsets.reshape(-1, 1) + begins))
    threshold = _FIRING_SHARE * inputs
    model = neuro.iaf_psc_delta(tau_m=20.0, t_ref=100.0, E_L=0.0, V_reset=0.0, V_th=threshold)
    net.population("cells", cells, model)
    rule = neuro.stddp(A=0.1, tau=50.0 if by_step else 20.0, by_step=by_step, d_min=1.0, d_max=_LONGEST)
    wires = neuro.pairs(pre=np.arange(cells * inputs), post=np.repeat(np.arange(cells), inputs))
    net.connect("inputs", "cells", wires, rule, weight=1.0, delay=_START_DELAY, name="gathered")
    return net


def spread(onsets: Floats, delays: Floats) -> Floats:
    """Return the standard deviation of each neuron's arrivals, shape (cells,), with delays rounded to whole ms."""
    arrivals: Floats = onsets + np.floor(delays.reshape(onsets.shape) + 0.5)
    deviations: Floats = arrivals.std(axis=1)
    return deviations
