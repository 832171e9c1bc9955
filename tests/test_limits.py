"""Values that are finite but beyond what a simulator can hold."""

import neuro
from refused import refused


def pair(**words):
    net = neuro.Network("pair", resolution=0.1)
    a, b = net.population("a", 2, neuro.parrot_neuron()), net.population("b", 2, neuro.iaf_psc_delta())
    net.connect(a, b, neuro.pairs([0, 1], [0, 1]), weight=1.0, name="ab", **words)
    return net


def alone(model):
    net = neuro.Network("one")
    net.population("a", 1, model)
    return net


def test_values_beyond_what_a_simulator_can_hold(messages):
    messages.calls(globals())


def test_weights_of_a_dopamine_rule_stay_within_its_bounds(messages):
    net = neuro.Network("bounds")
    a, b = net.population("a", 1, neuro.parrot_neuron()), net.population("b", 2, neuro.iaf_psc_exp())
    net.connect(a, b, neuro.all_to_all(), neuro.stdp_dopa(Wmax=100.0, b=0.1), weight=5.0, name="ab")
    sim = neuro.compile(net, "reference")
    messages({"told": refused(sim.set_weights, "ab", [5.0, 500.0])})
