"""Probes of projections: which synapses they record, and what is refused, told by its text."""

import numpy as np
import pytest

import neuro
from neuro import ModelError
from refused import refused


def network():
    net = neuro.Network("probed")
    net.population("in", 2, neuro.spike_generator(spike_times=[[1.0], [2.0]]))
    net.population("cells", 3, neuro.iaf_psc_exp())
    net.population("current", 1, neuro.dc_generator())
    net.connect("in", "cells", neuro.all_to_all(), neuro.stdp(), name="learning")
    net.connect("in", "cells", neuro.pairs(pre=[0, 1], post=[0, 2]), weight=[3.0, 4.0], name="listed")
    net.connect("current", "cells", neuro.all_to_all(), name="bias")
    return net


def probed(of="learning", **words):
    """A probe, of which some mistakes are told when the network is compiled."""
    net = network()
    net.probe("w", of, **words)
    return neuro.compile(net, "reference")


def test_what_is_refused(messages):
    messages.calls(globals())


def test_synapses_are_chosen_by_their_ends(tmp_path):
    def asked(of):
        source, cells = of.populations["in"], of.populations["cells"]
        return [{"pre": source[1]}, {"post": cells[1:]}, {"pre": [0], "post": (0, 2)}, {"pre": source, "post": 2}]

    net = network()
    words = asked(net)
    for k, ends in enumerate(words):
        net.probe(f"w{k}", "learning", "weight", every=1.0, **ends)
    net.probe("sent", "learning", "weight", at="pre_spikes", post=2)
    net.save(tmp_path / "net.yaml")
    for each in (net, neuro.load(tmp_path / "net.yaml")):
        sim = neuro.compile(each, "event")
        sim.run(4.0)
        for k, ends in enumerate(asked(each)):
            pre, post, _ = sim.weights("learning", **ends)
            found = sim.traces[f"w{k}"]
            assert (found.pre.tolist(), found.post.tolist()) == (pre.tolist(), post.tolist())
            assert np.array_equal(found.values[-1], sim.weights("learning", **ends)[2])
        _, sent = sim.trace("sent")
        assert (sent["pre"].tolist(), sent["post"].tolist()) == ([0, 1], [2, 2])
    learnt = neuro.compile(sim.network(), "event")
    learnt.run(4.0)
    assert learnt.trace("w2")[1].shape == (4, 2)
    assert "learning to cells[1:]" in str(net)


def test_ends_of_neurons_and_of_a_grid(messages):
    net = network()
    with pytest.raises(ModelError, match="probe 'v': pre is for projections: 'cells' is a population"):
        net.probe("v", "cells", "V_m", pre=[0])
    net.population("sheet", (4, 4), neuro.iaf_psc_exp())
    net.population("maps", (2, "auto", "auto"), neuro.iaf_psc_exp())
    net.connect("sheet", "maps", neuro.grid(kernel=(3, 3)), name="grid")
    net.probe("k", "grid", "weight", pre=[0])
    messages({"told": refused(neuro.compile, net, "reference").partition(": probe 'k': ")[2]})


def test_a_backend_that_does_not_note_pre_spikes():
    net = network()
    net.probe("w", "learning", "weight", at="pre_spikes")
    from neuro.program.backend import unnoted

    (problem,) = unnoted(neuro.compile(net, "reference").program)
    assert (problem.what, problem.why) == (
        "probe 'w': weight at pre spikes",
        "learning weights can be read between steps only",
    )
    assert problem.way_out == "record it at intervals, with 'every', or run it on backend 'event'"
