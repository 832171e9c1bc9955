"""The two networks that chip emulators are timed with, in registers: 1000 -> 1000 dense, and 10,240 with fan-in 100."""

from __future__ import annotations

import numpy as np

import neuro


def feedforward(n: int = 1000) -> neuro.Network:
    """Sources that fire at 5 % a step, all onto all."""
    rng = np.random.default_rng(1)
    net = neuro.Network("feedforward", resolution=1.0)
    net.population("sources", n, neuro.spike_generator())
    net.population("cells", n, neuro.loihi_lif(du=600, dv=300, vth=30000))
    weights = 2.0 * rng.integers(-40, 60, (n, n))
    net.connect("sources", "cells", neuro.all_to_all(), neuro.loihi_static(), weight=weights, delay=1.0)
    return net


def sources(n: int, steps: int, first: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Times and neurons of the input of `feedforward`."""
    times, ids = np.nonzero(np.random.default_rng(2).random((steps, n)) < 0.05)
    return times + float(first), ids


def recurrent(n: int = 10_240, fan_in: int = 100) -> neuro.Network:
    """Ten cores of neurons with a bias, each hearing 100 others, four of five excitatory."""
    rng = np.random.default_rng(3)
    net = neuro.Network("recurrent", resolution=1.0)
    bias = rng.integers(900, 2700, n).astype(float)
    net.population("cells", n, neuro.loihi_lif(du=1500, dv=160, vth=500, bias_mant=bias))
    pre = rng.integers(0, n, n * fan_in)
    excite, inhibit = 2 * rng.integers(1, 10, n * fan_in), -2 * rng.integers(4, 40, n * fan_in)
    weights = np.where(rng.random(n * fan_in) < 0.8, excite, inhibit).astype(float)
    rule = neuro.pairs(pre, np.repeat(np.arange(n), fan_in))
    net.connect("cells", "cells", rule, neuro.loihi_static(), weight=weights, delay=1.0)
    return net
