"""Cases whose values are exact in floats and in integers: every backend must equal the reference, spike for spike.

Weights, thresholds and currents are whole numbers of mV, potentials do not leak, and a source emits one spike in a
step at most, so that no arithmetic has anything to round. Where a decay is needed it is one half, and only spikes and
counts are compared, with thresholds away from ties.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_delta, parrot_neuron, spike_generator
from neuro.model.rules import Rule, all_to_all, fixed_indegree, grid, one_to_one, pairs
from neuro.testing.case import Found, Start, after, case, integers_too, law, network, observe

INF = float("inf")


def cell(**words: Any) -> iaf_psc_delta:
    """A neuron that adds up whole numbers: no leak, from 0 mV to a threshold of 6 mV."""
    return iaf_psc_delta(**({"tau_m": INF, "C_m": 1.0, "E_L": 0.0, "V_reset": 0.0, "V_th": 6.0} | words))


def times(n: int, share: float = 0.15, seed: int = 3, until: int = 120) -> list[list[float]]:
    """Random spike times of n neurons in ms, each at most once in a step of 1 ms."""
    fired = np.random.default_rng(seed).random((n, until)) < share
    return [(np.flatnonzero(row) + 1.0).tolist() for row in fired]


def driven(n: int = 8, share: float = 0.15, **words: Any) -> Network:
    """Listed spikes, and cells that nothing reaches yet."""
    net = network(1.0)
    net.population("source", n, spike_generator(spike_times=times(n, share)))
    net.population("cells", n, cell(**words))
    return net


def whole(low: int, high: int, shape: int | tuple[int, ...], seed: int = 4) -> np.ndarray:
    """Random whole numbers from low to high."""
    return np.random.default_rng(seed).integers(low, high + 1, shape).astype(np.float64)


@integers_too
@case
def exact_one_to_one(start: Start) -> Found:
    """one_to_one: whole weights of both signs, and delays of their own."""
    net = driven()
    net.connect("source", "cells", one_to_one(), weight=whole(1, 5, 8), delay=whole(1, 9, 8))
    net.connect("source", "cells", one_to_one(), weight=whole(-2, 3, 8), delay=3.0, name="both_signs")
    return after(start, net, 150.0)


@integers_too
@case
def exact_dense_rows(start: Start) -> Found:
    """all_to_all: one weight, a weight for each pair, and a delay for each pair."""
    net = driven(6, V_th=17.0)
    net.connect("source", "cells", all_to_all(), weight=1.0, delay=2.0, name="shared")
    net.connect("source", "cells", all_to_all(), weight=whole(-3, 5, (6, 6)), name="own")
    net.connect("source", "cells", all_to_all(), weight=2.0, delay=whole(1, 20, (6, 6)), name="late")
    net.connect("cells", "cells", all_to_all(autapses=False), weight=-1.0, delay=1.0, name="back")
    return after(start, net, 150.0)


@integers_too
@case
def exact_listed_pairs(start: Start) -> Found:
    """Random connections and listed pairs, some twice, with weights and delays of their own."""
    net = driven(9, V_th=9.0)
    rng = np.random.default_rng(1)
    ends = {"pre": rng.integers(0, 9, 40).tolist(), "post": rng.integers(0, 9, 40).tolist()}
    net.connect("source", "cells", pairs(**ends), weight=whole(-2, 4, 40), delay=whole(1, 30, 40), name="listed")
    net.connect("source", "cells", fixed_indegree(n=3), weight=2.0, delay=uniform(low=1.0, high=12.0), name="into")
    return after(start, net, 150.0)


@integers_too
@case
def exact_grid(start: Start) -> Found:
    """A shared kernel of whole weights with channels, padding and a stride, and a second layer."""
    net = network(1.0)
    net.population("sheet", (2, 6, 7), spike_generator(spike_times=times(84, 0.06)))
    net.population("maps", (3, "auto", "auto"), cell(V_th=11.0, t_ref=1.0))
    net.population("top", (2, "auto", "auto"), cell(V_th=5.0, t_ref=0.0))
    kernels = whole(-2, 4, (3, 2, 3, 4))
    net.connect("sheet", "maps", grid(kernel=(3, 4), stride=2, padding=1), weight=kernels, delay=3.0)
    net.connect("maps", "top", grid(kernel=(2, 2), padding=1), weight=2.0, delay=7.0)
    return after(start, net, 150.0)


@integers_too
@case
def exact_depthwise(start: Start) -> Found:
    """Kernels of whole weights that each see one channel, with borders of unequal width, and pooling map by map."""
    net = network(1.0)
    net.population("sheet", (2, 6, 7), spike_generator(spike_times=times(84, 0.06)))
    net.population("maps", (4, "auto", "auto"), cell(V_th=7.0, t_ref=1.0))
    net.population("pooled", (4, "auto", "auto"), cell(V_th=2.0, t_ref=5.0))
    kernels = whole(-1, 4, (4, 1, 3, 4))
    net.connect("sheet", "maps", grid(kernel=(3, 4), padding="same", depthwise=True), weight=kernels, delay=3.0)
    net.connect("maps", "pooled", grid(kernel=(4, 2), stride=4, padding="same", depthwise=True), weight=2.0)
    return after(start, net, 150.0)


@integers_too
@case
def exact_delays(start: Start) -> Found:
    """Every delay from 1 to 60 steps: a spike acts then, and neither earlier nor later."""
    net = network(1.0)
    net.population("source", 60, spike_generator(spike_times=[[5.0, 6.0, 70.0]] * 60))
    net.population("cells", 60, cell(V_th=2.0, t_ref=0.0))
    net.connect("source", "cells", one_to_one(), weight=2.0, delay=np.arange(1.0, 61.0))
    net.connect("cells", "cells", pairs(pre=[0, 20, 59], post=[59, 0, 20]), weight=2.0, delay=[60.0, 59.0, 1.0])
    return after(start, net, 200.0)


@integers_too
@case
def exact_recurrence(start: Start) -> Found:
    """A recurrent network with excitation and inhibition over long delays."""
    net = driven(12, 0.2, V_th=8.0, t_ref=2.0)
    net.population("inhibitory", 4, cell(V_th=5.0, t_ref=1.0))
    net.connect("source", "cells", all_to_all(), weight=1.0, delay=2.0)
    net.connect("cells", "cells", fixed_indegree(n=4), weight=1.0, delay=uniform(low=1.0, high=60.0))
    net.connect("cells", "inhibitory", fixed_indegree(n=5), weight=1.0, delay=3.0)
    net.connect("inhibitory", "cells", all_to_all(), weight=-2.0, delay=uniform(low=1.0, high=5.0))
    return after(start, net, 200.0)


@integers_too
@case
def exact_parrots(start: Start) -> Found:
    """Chains of parrots with delays, whose weights do not matter, and what they reach."""
    net = driven(5)
    net.population("first", 5, parrot_neuron())
    net.population("second", 5, parrot_neuron())
    net.connect("source", "first", one_to_one(), weight=0.25, delay=60.0)
    net.connect("first", "second", one_to_one(), weight=-2.0, delay=np.arange(1.0, 6.0))
    net.connect("second", "cells", all_to_all(), weight=1.0, delay=2.0)
    return after(start, net, 220.0)


@integers_too
@law
def exact_weights_set_at_an_emission(start: Start) -> tuple[Found, Found]:
    """What generators emit in a step keeps the weights of that step; what neurons emit takes those set after it."""
    net = network(1.0)
    net.population("source", 6, spike_generator(spike_times=[[4.0, 5.0]] * 6))
    net.population("parrots", 6, parrot_neuron())
    net.connect("source", "parrots", one_to_one())
    ways: dict[str, tuple[Rule, Any]] = {
        "one": (one_to_one(), 2.0),
        "all": (all_to_all(), 3.0),
        "listed": (pairs(pre=[0, 3, 5], post=[4, 1, 1]), 1.0),
    }
    ways |= {
        "late": (all_to_all(), np.arange(1.0, 37.0).reshape(6, 6)),
        "some": (pairs(pre=[2, 5], post=[0, 3]), [9.0, 2.0]),
    }
    expected = {}
    for source, each in (("source", 8.0 + 8.0), ("parrots", 0.0 + 8.0)):
        for way, (rule, delay) in ways.items():
            net.population(f"{source}_{way}", 6, cell(V_th=1000.0))
            net.connect(source, f"{source}_{way}", rule, weight=8.0, delay=delay)
            arriving = {"one": [1] * 6, "listed": [0, 2, 0, 0, 1, 0], "some": [1, 0, 0, 1, 0, 0]}.get(way, [6] * 6)
            expected[f"{source}_{way}"] = each * np.array(arriving)
    sim = start(net)
    for weights in ((4.0, 0.0), (8.0,)):
        sim.run(5.0 if len(weights) == 2 else 1.0)
        for name in expected:
            for weight in weights:
                sim.set_weights(f"{name.partition('_')[0]}_{name}", weight)
    sim.run(60.0)
    return {name: sim.get(name, "V_m") for name in expected}, expected


@integers_too
@case
def exact_network_again(start: Start) -> Found:
    """`network()` of a run, compiled again."""
    net = driven(8)
    net.connect("source", "cells", all_to_all(), weight=whole(-1, 3, (8, 8)), delay=4.0, name="own")
    sim = start(net)
    sim.run(20.0)
    sim.set_weights("own", whole(-1, 2, 64, seed=9))
    learnt = sim.network()
    del sim  # a backend may run one simulation at a time
    again = start(learnt)
    again.run(100.0)
    return observe(again)
