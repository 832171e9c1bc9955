"""Probes of projections: what is refused, told by its text."""

import pytest

import neuro
from neuro import ModelError


def network():
    net = neuro.Network("probed")
    net.population("in", 2, neuro.spike_generator(spike_times=[[1.0], [2.0]]))
    net.population("cells", 3, neuro.iaf_psc_exp())
    net.population("current", 1, neuro.dc_generator())
    net.connect("in", "cells", neuro.all_to_all(), neuro.stdp(), name="learning")
    net.connect("current", "cells", neuro.all_to_all(), name="bias")
    return net


@pytest.mark.parametrize(
    ("of", "words", "expected"),
    [
        (
            "learning",
            {},
            "the synapses of 'learning', stdp, have no state 'spikes'\n  hint: a probe of its source records them",
        ),
        (
            "learning",
            {"record": "weigth"},
            "the synapses of 'learning', stdp, have no state 'weigth'\n  hint: did you mean 'weight'?",
        ),
        (
            "learning",
            {"record": "weight", "at": "pre_spikes", "every": 1.0},
            "every = 1 ms and at = pre_spikes: expected one of both",
        ),
        (
            "learning",
            {"record": "weight", "at": "pre_spikes", "mean": True},
            "mean is for records every so many ms, not at pre spikes\n  hint: leave 'mean' out",
        ),
        (
            "learning",
            {"record": "K_plus", "at": "pre_spikes"},
            "at = pre_spikes: 'K_plus' is of a neuron, not of a synapse\n  hint: every: 1.0 records it",
        ),
        (
            "learning",
            {"record": "weight", "synapses": [0, 6]},
            "synapses: found 6: expected at most 5, as 'learning' has them",
        ),
        ("learning", {"record": "weight", "synapses": [1, 1]}, "synapses: expected at least one, and each once"),
        ("bias", {"record": "weight", "at": "pre_spikes"}, "at = pre_spikes: 'bias' carries a current, and no spikes"),
    ],
)
def test_what_is_refused_of_a_projection(of, words, expected):
    net = network()
    net.probe("w", of, **words)
    with pytest.raises(ModelError) as error:
        neuro.compile(net, "reference")
    assert str(error.value).partition(": probe 'w': ")[2] == expected


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ({"record": []}, "record = []: expected one or several names, each once"),
        ({"record": ["weight", "weight"]}, "record = [weight, weight]: expected one or several names, each once"),
        ({"at": "post_spikes"}, "at = 'post_spikes': expected one of pre_spikes"),
        ({"mean": 1}, "mean = 1: expected true or false"),
        ({"synapses": [-1]}, "synapses[0] = -1: expected whole numbers >= 0"),
    ],
)
def test_what_is_refused_at_once(words, expected):
    with pytest.raises(ModelError) as error:
        network().probe("w", "learning", **words)
    assert str(error.value).partition("probe 'w': ")[2].partition("\n")[0] == expected


def test_a_backend_that_does_not_note_pre_spikes():
    net = network()
    net.probe("w", "learning", "weight", at="pre_spikes")
    from neuro.program.backend import unnoted

    (problem,) = unnoted(neuro.compile(net, "reference").program)
    assert (problem.what, problem.why) == (
        "probe 'w': weight at pre spikes",
        "weights that learn are shown between steps only",
    )
    assert problem.way_out == "record it every so many ms, or run it on backend 'event'"
