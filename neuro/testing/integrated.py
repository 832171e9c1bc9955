"""Random small networks of the neurons that NEST integrates by adaptive steps, and of `mat2_psc_exp`, for hypothesis.

Needs the package hypothesis, which only tests install.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from neuro.model.network import Network
from neuro.model.neurons import (
    Neuron,
    aeif_cond_exp,
    aeif_psc_exp,
    hh_psc_alpha,
    iaf_cond_alpha,
    iaf_cond_exp,
    mat2_psc_exp,
    spike_generator,
)
from neuro.model.rules import all_to_all

DRIVES: dict[type[Neuron], tuple[float, float, float]] = {
    iaf_cond_exp: (150.0, 350.0, 12.0),
    iaf_cond_alpha: (150.0, 350.0, 12.0),
    aeif_cond_exp: (300.0, 900.0, 12.0),
    aeif_psc_exp: (300.0, 900.0, 400.0),
    hh_psc_alpha: (300.0, 900.0, 400.0),
    mat2_psc_exp: (100.0, 500.0, 400.0),
}
"""Smallest and largest constant current in pA, and largest weight in nS or pA: from silence to a high rate."""

DURATION = 100.0


@st.composite
def integrated_networks(draw: st.DrawFn, model: type[Neuron]) -> Network:
    """Listed spikes onto up to 4 neurons of a model, which inhibit or excite one another; V_m is probed."""
    lowest, highest, strongest = DRIVES[model]
    net = Network("integrated", resolution=draw(st.sampled_from([0.05, 0.1, 0.2])))
    times = [sorted(draw(st.sets(st.integers(1, 450), max_size=40))) for _ in range(3)]
    net.population("source", 3, spike_generator(spike_times=[[0.2 * t for t in row] for row in times]))
    n = draw(st.integers(1, 4))
    current = np.array([draw(st.floats(lowest, highest)) for _ in range(n)])
    net.population("cells", n, model(**(draw(_words(model)) | {"I_e": current})))
    for source, size in (("source", 3), ("cells", n)):
        weight = np.array([[draw(st.floats(-strongest, strongest)) for _ in range(n)] for _ in range(size)])
        net.connect(source, "cells", all_to_all(), weight=weight, delay=draw(st.integers(1, 20)) * 0.2)
    net.probe("V_m", "cells", "V_m")
    return net


@st.composite
def _words(draw: st.DrawFn, model: type[Neuron]) -> dict[str, Any]:
    words = {"tau_syn_ex": draw(st.floats(0.2, 4.5)), "tau_syn_in": draw(st.floats(0.5, 4.5))}  # NEST: not mat2's tau_m
    words["t_ref"] = draw(st.integers(1 if model is mat2_psc_exp else 0, 15)) * 0.2
    if model in (aeif_cond_exp, aeif_psc_exp):
        words |= {"a": draw(st.floats(0.0, 10.0)), "b": draw(st.floats(0.0, 100.0))}
        words["Delta_T"] = draw(st.sampled_from([0.0, 1.0, 2.0]))
    return words
