"""Single synapses, by pairs of neurons or by their ends, and what chooses none."""

import numpy as np
import pytest

import neuro
from neuro import Network
from refused import without_place

FLOATS = ("reference", "event")


def network():
    net = Network("n", resolution=1.0)
    net.population("source", 6, neuro.spike_generator())
    net.population("cells", (2, 3), neuro.iaf_psc_delta())
    net.connect("source", "cells", neuro.all_to_all(), weight=np.arange(36.0), delay=np.arange(1.0, 37.0), name="all")
    listed = neuro.pairs(pre=[0, 1, 2, 2, 3], post=[2, 3, 4, 4, 5])
    net.connect("source", "cells", listed, weight=[4.0, 5.0, 6.0, 8.0, 7.0], delay=2.0, name="some")
    net.connect("source", "cells", neuro.pairs(pre=[0, 1], post=[0, 1]), neuro.stdp(Wmax=9.0), name="learns")
    return net


@pytest.mark.parametrize("backend", FLOATS)
def test_pairs_are_read_and_set_in_their_order(backend):
    sim = neuro.compile(network(), backend)
    pairs = [(5, 0), (0, 3), (2, 2)]
    assert sim.get("all", "weight", of=pairs).tolist() == [30.0, 3.0, 14.0]
    pre, post, weight, delay = sim.weights("all", of=np.array(pairs), delays=True)
    assert (pre.tolist(), post.tolist()) == ([5, 0, 2], [0, 3, 2])
    assert (weight.tolist(), delay.tolist()) == ([30.0, 3.0, 14.0], [31.0, 4.0, 15.0])
    sim.set("all", weight=[1.0, 2.0, -1.0], of=pairs)
    expected = np.arange(36.0)
    expected[[30, 3, 14]] = [1.0, 2.0, -1.0]
    assert np.array_equal(sim.get("all", "weight"), expected)
    sim.set("all", weight=0.5, of=(1, 1))
    assert sim.get("all", "weight", of=(1, 1)).tolist() == [0.5]


@pytest.mark.parametrize("backend", FLOATS)
def test_a_pair_has_all_its_synapses(backend):
    sim = neuro.compile(network(), backend)
    assert sim.get("some", "weight", of=[(3, 5), (2, 4)]).tolist() == [7.0, 6.0, 8.0]
    sim.set("some", weight=[1.0, 2.0, 3.0], of=[(3, 5), (2, 4)])
    assert sim.get("some", "weight").tolist() == [4.0, 5.0, 2.0, 3.0, 1.0]


def test_numbers_of_a_rule_of_pairs():
    sim = neuro.compile(network(), "reference")
    sim.set("learns", {"lambda": 0.5}, of=[(1, 1)])
    assert sim.get("learns", "lambda").tolist() == [0.01, 0.5]


def test_ids_choose_neurons_at_either_end():
    net = network()
    sim = neuro.compile(net, "reference")
    source, cells = net.populations["source"], net.populations["cells"]
    for ids, view in ((2, source[2]), ([4, 0], source[[4, 0]]), (range(1, 3), source[1:3]), (np.int64(5), source[5])):
        assert np.array_equal(sim.get("all", "weight", pre=ids), sim.get("all", "weight", pre=view))
    assert np.array_equal(sim.get("all", "weight", post=4), sim.get("all", "weight", post=cells[1, 1]))
    sim.set("all", weight=-1.0, pre=2, post=[0, 5])
    assert sim.get("all", "weight", pre=2).tolist() == [-1.0, 13.0, 14.0, 15.0, 16.0, -1.0]


def test_values_by_name_may_stand_in_a_mapping():
    sim = neuro.compile(network(), "reference")
    sim.set("cells", {"V_m": 3.0, "I_e": 1.0}, V_th=16.0)
    assert [sim.get("cells", word)[0] for word in ("V_m", "I_e", "V_th")] == [3.0, 1.0, 16.0]


def test_a_weight_may_have_its_unit():
    net = network()
    net.population("neurons", 2, neuro.iaf_psc_exp())
    net.connect("source", "neurons", neuro.all_to_all(), name="currents")
    sim = neuro.compile(net, "reference")
    sim.set("all", weight="2.5 mV", pre=0)
    assert sim.get("all", "weight", pre=0).tolist() == [2.5] * 6
    sim.set("currents", weight="0.02 nA")
    assert sim.get("currents", "weight").tolist() == [20.0] * 12
    assert without_place(sim.set, "currents", weight="2 mV") == "weights of 'currents' = 2 mV: expected a current in pA"


def test_what_chooses_nothing_is_refused(messages):
    net = network()
    sim = neuro.compile(net, "reference")
    before = sim.get("some", "weight")
    messages.calls({"s": sim, "n": net})
    assert np.array_equal(sim.get("some", "weight"), before)


def test_reading_of_no_synapse_gives_none():
    net = network()
    sim = neuro.compile(net, "reference")
    assert [row.size for row in sim.weights("some", pre=5)] == [0, 0, 0]


def connected(rule, weight=1.0):
    net = neuro.Network("words")
    net.population("source", 1, neuro.spike_generator())
    net.population("cell", 1, neuro.iaf_psc_exp())
    net.connect("source", "cell", neuro.one_to_one(), rule, weight=weight, delay=1.0, name="x")
    return neuro.compile(net, "reference")


def test_what_cannot_be_set_is_told_by_what_it_is(messages):
    messages.calls(globals())
