"""Rules of spike pairs as equations."""

import numpy as np
import pytest

import neuro
from beside import beside, evaluated

STDP, TRIPLET = beside(__file__, "STDP", "TRIPLET")


def network(rule):
    net = neuro.Network("learning")
    net.population("source", 6, neuro.poisson_generator(rate=120.0))
    net.population("cells", 4, neuro.iaf_psc_exp(I_e=500.0))
    net.connect("source", "cells", neuro.all_to_all(), rule, weight=60.0, delay=1.5, name="learnt")
    return net


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize(
    ("built_in", "words", "numbers"), evaluated(__file__, "TWINS", globals()), ids=["stdp", "stdp_triplet"]
)
def test_a_rule_written_as_equations_gives_its_twins_weights(built_in, words, numbers, backend):
    found = []
    for rule in (built_in(**numbers), neuro.equations("own", **words)(**numbers)):
        sim = neuro.compile(network(rule), backend, seed=1)
        sim.run(300.0)
        found.append((sim.weights("learnt")[2], sim.spikes("cells")[0]))
    assert np.array_equal(found[0][1], found[1][1])
    assert found[0][1].size > 20
    assert found[0][0].std() > 1.0
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-12


def test_a_saved_network_has_its_rules(tmp_path):
    net = network(neuro.equations("own_stdp", **STDP)(alpha=1.5))
    net.save(tmp_path / "net.yaml")
    assert neuro.load(tmp_path / "net.yaml") == net


def rule(**words):
    neuro.equations("m", **{**STDP, **words})


def test_mistakes(messages):
    messages.calls(globals())
