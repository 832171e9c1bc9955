"""Cases of probes: several states, means, rates, and synapses."""

from __future__ import annotations

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_exp, parrot_neuron, poisson_generator, spike_generator
from neuro.model.rules import all_to_all, fixed_indegree, fixed_outdegree, one_to_one, pairs, pairwise_bernoulli
from neuro.model.synapses import Synapse, static, stdp, stdp_dopa
from neuro.testing.case import Found, Start, after, case, integers_too, network, observe
from neuro.testing.exact import cell, times, whole


def _plastic(synapse: Synapse) -> Network:
    """Parrots onto neurons by a synapse model; several spikes may set out in one step."""
    net = network()
    net.population("noise", 6, poisson_generator(rate=200.0))
    net.population("parrots", 6, parrot_neuron())
    net.population("cells", 5, iaf_psc_exp(I_e=350.0))
    net.connect("noise", "parrots", one_to_one(), delay=0.3)
    net.connect("parrots", "cells", fixed_outdegree(n=3), synapse, weight=60.0, delay=0.7, name="learning")
    net.connect("noise", "cells", all_to_all(), weight=40.0, delay=0.4, name="fixed")
    return net


def _in_parts(start: Start, net: Network) -> Found:
    """Run in parts that end between and at the steps of the probes."""
    sim = start(net)
    for ms in (0.1, 12.4, 7.5, 20.0):
        sim.run(ms)
    return observe(sim)


@case
def several_states_means_and_rates(start: Start) -> Found:
    """Two states in one probe, the mean of one, and a rate in bins."""
    net = _plastic(static())
    net.probe("states", "cells", ["V_m", "I_syn_ex"], every=0.5)
    net.probe("mean", "cells", "V_m", every=0.2, mean=True)
    net.probe("rate", "cells", "rate", every=5.0)
    net.probe("drive", "noise", "rate", every=2.0)
    return _in_parts(start, net)


@case
def sleeping_neurons_are_recorded(start: Start) -> Found:
    """States of neurons that hardly hear anything, in every step and every so many."""
    net = network()
    net.population("noise", 2, poisson_generator(rate=30.0))
    net.population("cells", 150, iaf_psc_exp())
    net.connect("noise", "cells", fixed_outdegree(n=2), weight=500.0, delay=0.5)
    net.probe("V_m", "cells", "V_m")
    net.probe("currents", "cells", "I_syn_ex", every=1.7)
    return _in_parts(start, net)


@case
def weights_are_recorded(start: Start) -> Found:
    """Weights that learn, every so many ms: all, some, and their mean."""
    net = _plastic(stdp(Wmax=120.0))
    net.probe("all", "learning", "weight", every=2.5)
    net.probe("some", "learning", ["weight", "K_plus"], every=0.5, synapses=[7, 0, 3])
    net.probe("mean", "learning", "weight", every=1.0, mean=True)
    return _in_parts(start, net)


@case
def weights_at_pre_spikes(start: Start) -> Found:
    """Weights with which spikes are sent, of synapses that learn from spike pairs."""
    net = _plastic(stdp(Wmax=120.0))
    net.probe("all", "learning", "weight", at="pre_spikes")
    net.probe("some", "learning", "weight", at="pre_spikes", synapses=[11, 2])
    return _in_parts(start, net)


@case
def fixed_weights_at_pre_spikes(start: Start) -> Found:
    """Weights that do not learn, changed between two runs."""
    net = _plastic(static())
    net.probe("all", "fixed", "weight", at="pre_spikes")
    sim = start(net)
    sim.run(10.0)
    sim.set_weights("fixed", 35.0)
    sim.run(10.0)
    return observe(sim)


@case
def states_at_pre_spikes(start: Start) -> Found:
    """The weight and the eligibility that pre spikes leave under dopamine."""
    net = _plastic(stdp_dopa(signal="reward", Wmax=120.0))
    net.signal("reward", to="cells")
    net.probe("sent", "learning", ["weight", "c"], at="pre_spikes")
    sim = start(net)
    sim.run(10.0)
    sim.signal("reward", 0.02)
    sim.run(20.0)
    return observe(sim)


def seen(net: Network) -> Network:
    """Cells in two shapes that receive noise, with probes of some of them."""
    net.population("noise", 12, poisson_generator(rate=1500.0))
    row = net.population("row", 12, iaf_psc_exp(I_e=300.0), initial={"V_m": uniform(low=-70.0, high=-56.0)})
    sheet = net.population("sheet", (3, 4), iaf_psc_exp(I_e=250.0))
    net.connect("noise", "row", one_to_one(), weight=200.0, delay=0.5)
    net.probe("some", row[[7, 2, 3]], "V_m", every=0.5)
    net.probe("line", sheet[1], "V_m")
    net.probe("spikes", row[::5])
    return net


@case
def views_are_connected(start: Start) -> Found:
    """Every rule from views to views, forwards and backwards, overlapping, with arrays of the views' shapes."""
    net = seen(network())
    row, sheet = net.populations["row"], net.populations["sheet"]
    delay, weight = uniform(low=0.2, high=2.0), normal(mean=100.0, std=150.0)
    net.connect(row[:6], row[3:9], all_to_all(autapses=False), weight=weight, delay=delay, name="all")
    net.connect(row[::-1], sheet, one_to_one(), weight=np.linspace(-50.0, 300.0, 12), name="turned")
    net.connect(row, sheet[1:, ::2], fixed_indegree(n=3), weight=weight, delay=delay, name="into")
    net.connect(row[::2], row[5:], fixed_outdegree(n=3, autapses=False), weight=-100.0, name="out")
    net.connect(sheet[:, 1:], row[[9, 0, 4]], pairwise_bernoulli(p=0.4), weight=weight, delay=delay, name="chance")
    net.connect(row[6:], sheet[2], pairs(pre=[5, 0, 0], post=[1, 3, 0]), weight=[100.0, 200.0, 300.0], name="listed")
    net.connect(row[2:10], row[4:12], all_to_all(autapses=False), stdp(Wmax=200.0), weight=60.0, name="learns")
    return after(start, net)


@case
def views_are_set_and_read(start: Start) -> Found:
    """States and parameters of some neurons that are set, spikes that are injected, and what is read of a view."""
    net = seen(network())
    row, sheet = net.populations["row"], net.populations["sheet"]
    listed = net.population("listed", 5, spike_generator())
    net.connect(listed[1:4], sheet[0, :3], one_to_one(), weight=900.0)
    sim = start(net)
    sim.run(10.0)
    sim.inject(listed[1:3], [11.0, 12.0])
    sim.inject(listed[3], [11.5], [3])
    sim.set(row[8:], V_th=np.array([-54.0, -53.0, -52.0, -51.0]), I_e=350.0)
    sim.set(sheet[1:, 0], V_m=[-58.0, -60.0])
    sim.run(30.0)
    times, ids = sim.spikes(row[:6], since=12.0, until=30.0)
    return observe(sim) | {
        "spikes of the view": np.rint(times * 10).astype(np.int64),
        "neurons of the view": ids,
        "V_m of the view": sim.get(sheet[:, 1], "V_m"),
        "V_th": sim.get("row", "V_th"),
    }


@case
def single_weights_change(start: Start) -> Found:
    """Weights of static synapses that are chosen by their ends change, and no others."""
    net = seen(network())
    row = net.populations["row"]
    some = net.connect(row[:5], row[4:], fixed_indegree(n=2), weight=normal(mean=50.0, std=20.0), delay=1.5)
    sim = start(net)
    sim.run(10.0)
    sim.set(some, weight=400.0, pre=row[1], post=row[6:])
    sim.set(some, weight=-70.0, post=row[5])
    sim.run(20.0)
    return observe(sim) | dict(zip(("pre", "post", "weight", "delay"), sim.weights(some, delays=True), strict=True))


@case
def single_plastic_weights_change(start: Start) -> Found:
    """Weights that learn and are set by their ends; the others keep what they are about to learn, too."""
    net = seen(network())
    row = net.populations["row"]
    some = net.connect(row, row, all_to_all(autapses=False), stdp(Wmax=200.0, lambda_=0.1), weight=60.0, delay=1.5)
    sim = start(net)
    sim.run(20.0)
    sim.set(some, weight=150.0, pre=row[::3], post=row[2:7])
    found = sim.get(some, "weight", post=row[3])
    sim.run(20.0)
    return observe(sim) | {"just set": found}


@integers_too
@case
def exact_views(start: Start) -> Found:
    """Views of whole weights and delays, and a weight of some that changes."""
    net = network(1.0)
    source = net.population("source", (2, 4), spike_generator(spike_times=times(8)))
    cells = net.population("cells", 8, cell(V_th=9.0))
    own = net.connect(source[0], cells[2:6], all_to_all(), weight=whole(-1, 4, (4, 4)), delay=2.0, name="own")
    net.connect(source[:, ::3], cells[::2], one_to_one(), weight=3.0, delay=whole(1, 5, 4), name="each")
    net.connect(cells[:5], cells[3:], all_to_all(autapses=False), weight=-1.0, delay=1.0, name="back")
    net.probe("spikes", cells[1:4])
    sim = start(net)
    sim.run(70.0)
    sim.set(own, weight=2.0, pre=source[0, 1:3], post=cells[4])
    sim.run(70.0)
    return observe(sim) | {"seen": sim.trace("spikes")[1]}
