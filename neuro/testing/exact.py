"""Cases whose values are exact in floats and in integers: every backend must equal the reference, spike for spike.

Weights, thresholds and currents are whole numbers of mV, potentials do not leak, and a source emits one spike in a
step at most, so no arithmetic rounds. If a case needs a decay, values halve in each step. A case with decays compares
only spikes and counts, and its thresholds differ from all potentials. Cases of trials are in `neuro.testing.trials`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    dc_generator,
    iaf_psc_delta,
    iaf_psc_exp,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import lateral_reset, winner_take_all
from neuro.model.rules import Rule, all_to_all, fixed_indegree, grid, one_to_one, pairs
from neuro.model.synapses import stdp
from neuro.testing.case import Found, Start, after, case, integers_too, law, network, observe

INF = float("inf")


def cell(**parameters: Any) -> iaf_psc_delta:
    """Return a neuron without leak that sums whole numbers from 0 mV to a threshold of 6 mV."""
    return iaf_psc_delta(**({"tau_m": INF, "C_m": 1.0, "E_L": 0.0, "V_reset": 0.0, "V_th": 6.0} | parameters))


def times(n: int, share: float = 0.15, seed: int = 3, until: int = 120) -> list[list[float]]:
    """Return random spike times of n neurons in ms, at most one for each neuron and step of 1 ms."""
    is_spike = np.random.default_rng(seed).random((n, until)) < share
    return [(np.flatnonzero(row) + 1.0).tolist() for row in is_spike]


def driven(n: int = 8, share: float = 0.15, **parameters: Any) -> Network:
    """Return a network of sources with listed spikes, and cells without connections."""
    net = network(1.0)
    net.population("source", n, spike_generator(spike_times=times(n, share)))
    net.population("cells", n, cell(**parameters))
    return net


def whole(low: int, high: int, shape: int | tuple[int, ...], seed: int = 4) -> np.ndarray:
    """Return random whole numbers from low to high."""
    return np.random.default_rng(seed).integers(low, high + 1, shape).astype(np.float64)


@integers_too
@case
def exact_one_to_one(start: Start) -> Found:
    """one_to_one: a whole weight of either sign and a delay for each synapse."""
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
    """Random connections and listed pairs, some of them twice, with a weight and a delay for each synapse."""
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
    """Depthwise kernels of whole weights with borders of unequal width, and pooling of each map."""
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
    """Every delay from 1 to 60 steps: a spike acts exactly after its delay."""
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
    """Chains of parrots with delays, and the targets of the chains. Parrots ignore weights."""
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
    """A generator's spike has the weight of its step; a neuron's spike has the weight that is set after its step."""
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
    for source, per_synapse in (("source", 8.0 + 8.0), ("parrots", 0.0 + 8.0)):
        for way, (rule, delay) in ways.items():
            net.population(f"{source}_{way}", 6, cell(V_th=1000.0))
            net.connect(source, f"{source}_{way}", rule, weight=8.0, delay=delay)
            arriving = {"one": [1] * 6, "listed": [0, 2, 0, 0, 1, 0], "some": [1, 0, 0, 1, 0, 0]}.get(way, [6] * 6)
            expected[f"{source}_{way}"] = per_synapse * np.array(arriving)
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
    """The network that `network()` returns after a run, compiled again."""
    net = driven(8)
    net.connect("source", "cells", all_to_all(), weight=whole(-1, 3, (8, 8)), delay=4.0, name="own")
    sim = start(net)
    sim.run(20.0)
    sim.set_weights("own", whole(-1, 2, 64, seed=9))
    net_of_run = sim.network()
    del sim  # some backends run one simulation at a time
    copy = start(net_of_run)
    copy.run(100.0)
    return observe(copy)


HALVED = float(1.0 / np.log(2.0))
"""Time constant in ms of a decay to one half in 1 ms."""


def spikes_and_counts(outcome: Found) -> Found:
    """Return the spikes and counts of an outcome, which do not depend on rounding."""
    return {name: values for name, values in outcome.items() if values.dtype.kind != "f"}


@integers_too
@case
def exact_delays_of_currents(start: Start) -> Found:
    """Every delay from 1 to 60 steps onto iaf_psc_exp, whose currents act one step after their arrival."""
    net = network(1.0)
    net.population("source", 60, spike_generator(spike_times=[[5.0, 80.0]] * 60))
    net.population("cells", 60, iaf_psc_exp(t_ref=3.0))
    net.connect("source", "cells", one_to_one(), weight=9000.0, delay=np.arange(1.0, 61.0))
    return spikes_and_counts(after(start, net, 200.0))


@integers_too
@case
def exact_refractory_periods(start: Start) -> Found:
    """A constant drive with refractory periods from 0 to 12 steps."""
    net = network(1.0)
    net.population("cells", 13, cell(t_ref=np.arange(13.0), I_e=2.0))
    net.population("tick", 1, spike_generator(spike_times=[np.arange(1.0, 100.0).tolist()]))
    net.population("others", 13, cell(t_ref=np.arange(13.0), V_th=3.0))
    net.connect("tick", "others", all_to_all(), weight=1.0)
    return after(start, net, 120.0)


@integers_too
@case
def exact_thresholds(start: Start) -> Found:
    """A threshold for each neuron, equal to a reachable V_m: a neuron fires at V_m = V_th, but not 1 mV below."""
    net = driven(8, V_th=np.arange(-65.0, -57.0), E_L=-70.0, V_reset=-70.0)
    net.connect("source", "cells", one_to_one(), weight=2.0)
    net.connect("source", "cells", all_to_all(), weight=np.tile([0.0, 1.0], (8, 4)), name="more")
    net.connect("source", "cells", one_to_one(), weight=-1.0, delay=2.0, name="less")
    return after(start, net, 150.0)


@integers_too
@case
def exact_currents(start: Start) -> Found:
    """Currents of whole mV per step, which are switched and set while they flow, and a constant current."""
    net = network(1.0)
    net.population("source", 2, dc_generator(amplitude=np.array([2.0, 5.0]), start=3.0, stop=60.0))
    net.population("cells", 3, cell(V_th=40.0, I_e=np.array([0.0, 1.0, 3.0])))
    net.connect("source", "cells", all_to_all(), weight=np.array([[1.0, 2.0, 0.0], [1.0, -1.0, 3.0]]), delay=4.0)
    sim = start(net)
    sim.run(30.0)
    sim.set("source", amplitude=np.array([4.0, 1.0]))
    sim.run(50.0)
    return observe(sim)


@integers_too
@case
def exact_noise(start: Start) -> Found:
    """A poisson_generator of a low rate between start and stop: the same random numbers on all backends."""
    net = network(1.0)
    net.population("noise", 6, poisson_generator(rate=np.linspace(0.0, 15.0, 6), start=10.0, stop=350.0))
    net.population("cells", 3, cell(V_th=3.0))
    net.connect("noise", "cells", all_to_all(), weight=1.0, delay=5.0)
    net.probe("spikes", "noise")
    return after(start, net, 400.0)


@integers_too
@case
def exact_best_of_each_step(start: Start) -> Found:
    """winner_take_all without first_to_fire, with ties: the losers of a step are reset."""
    net = driven(8, 0.3, V_th=5.0, t_ref=1.0)
    net.connect("source", "cells", all_to_all(), weight=1.0)
    net.connect("source", "cells", one_to_one(), weight=whole(0, 2, 8), name="own")
    net.group("choice", winner_take_all(of="cells", first_to_fire=False))
    return after(start, net, 150.0)


@integers_too
@case
def exact_lateral_reset(start: Start) -> Found:
    """lateral_reset along each axis, with ties: a spike resets its rivals and keeps them at rest."""
    outcome: Found = {}
    for axis in range(3):
        net = network(1.0)
        net.population("source", 8, spike_generator(spike_times=times(8, 0.1)))
        net.population("cells", (2, 3, 4), cell(V_th=6.0, t_ref=3.0))
        net.connect("source", "cells", all_to_all(), weight=whole(-1, 2, (8, 24)))
        net.group("one", lateral_reset(of="cells", axis=axis))
        outcome |= {f"axis {axis}: {name}": values for name, values in after(start, net, 150.0).items()}
    return outcome


@integers_too
@case
def exact_changes(start: Start) -> Found:
    """Changes of states, parameters and weights, injected spikes, and a reset."""
    net = driven(8)
    net.connect("source", "cells", all_to_all(), weight=np.tile([2.0, -1.0], (8, 4)), name="shared")
    net.connect("source", "cells", all_to_all(), weight=whole(-1, 3, (8, 8)), delay=4.0, name="own")
    net.connect("source", "cells", one_to_one(), weight=2.0, delay=9.0, name="single")
    outcome: Found = {}
    sim = start(net)
    for turn in range(2):
        sim.set("cells", V_m=np.arange(-3.0, 5.0))
        sim.run(30.0)
        sim.set("cells", V_th=np.arange(4.0, 12.0), t_ref=1.0)
        sim.set_weights("shared", np.tile([0.0, 1.0, 2.0, -1.0], 16))
        sim.run(1.0)
        sim.inject("source", [33.0, 38.0, 50.0], [0, 3, 3])
        sim.run(15.0)
        sim.set_weights("own", whole(-1, 2, 64, seed=9))
        sim.set_weights("single", 1.0)
        sim.run(60.0)
        outcome |= {f"turn {turn}: {name}": values for name, values in observe(sim).items()}
        sim.reset(weights=turn == 0)
    return outcome | {f"after a reset: {name}": values for name, values in observe(sim).items()}


@integers_too
@case
def exact_halving(start: Start) -> Found:
    """Potentials and currents that halve in each step; only spikes and counts are compared."""
    net = driven(8, 0.3, tau_m=HALVED, V_th=5.3)
    exponential: dict[str, Any] = {"tau_m": HALVED, "tau_syn_ex": HALVED, "tau_syn_in": HALVED}
    net.population("currents", 8, iaf_psc_exp(**exponential, C_m=1000.0, E_L=0.0, V_reset=0.0, V_th=5.3))
    weight = whole(-1, 3, (8, 8))
    net.connect("source", "cells", all_to_all(), weight=weight, delay=2.0)
    net.connect("source", "currents", all_to_all(), weight=1000.0 * weight, delay=5.0)
    net.connect("currents", "cells", one_to_one(), weight=4.0, delay=1.0)
    return spikes_and_counts(after(start, net, 150.0))


@integers_too
@case
def counts_of_learning(start: Start) -> Found:
    """learning_updates of stdp in dense and listed synapses, whose weights are too small to affect a spike."""
    net = driven(6, 0.03, tau_m=HALVED, V_th=5.5)
    net.population("others", 6, cell(tau_m=HALVED, V_th=5.5))
    net.connect("source", "cells", one_to_one(), weight=6.0, delay=3.0)
    net.connect("cells", "others", one_to_one(), weight=6.0, delay=2.0)
    rule = stdp(lambda_=0.1, Wmax=0.05)
    net.connect("source", "cells", all_to_all(), rule, weight=0.03, delay=2.0, name="dense")
    few = pairs(pre=[0, 1, 2, 5], post=[0, 1, 2, 3])
    net.connect("cells", "others", few, rule, weight=0.03, delay=4.0, name="few")
    return spikes_and_counts(after(start, net, 150.0))
