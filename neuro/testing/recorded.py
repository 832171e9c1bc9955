"""Cases of probes: several states, means, rates, and synapses."""

from __future__ import annotations

from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_exp, parrot_neuron, poisson_generator
from neuro.model.rules import all_to_all, fixed_outdegree, one_to_one
from neuro.model.synapses import Synapse, static, stdp, stdp_dopa
from neuro.testing.case import Found, Start, case, network, observe


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
