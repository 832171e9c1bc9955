"""Values that are finite but beyond what a simulator can hold."""

import subprocess
import sys

import numpy as np
import pytest

import neuro


def pair(**words):
    net = neuro.Network("pair", resolution=0.1)
    a, b = net.population("a", 2, neuro.parrot_neuron()), net.population("b", 2, neuro.iaf_psc_delta())
    net.connect(a, b, neuro.pairs([0, 1], [0, 1]), weight=1.0, name="ab", **words)
    return net


@pytest.mark.parametrize(
    ("delay", "message"),
    [
        (1e9, "projection 'ab': delay = 1e+09 ms: expected at most 6553.6 ms, 2^16 steps"),
        (1e300, "projection 'ab': delay = 1e+300 ms: expected at most 1.09951e+11 ms, 2^40 steps"),
        (np.array([1.0, 1e9]), "projection 'ab': delay[1] = 1e+09 ms: expected at most 6553.6 ms, 2^16 steps"),
        (np.array([1.0, 1e300]), "projection 'ab': delay[1] = 1e+300 ms: expected at most 1.09951e+11 ms, 2^40 steps"),
    ],
)
def test_delays(delay, message):
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(pair(delay=delay), "reference")
    assert message in str(error.value)


def test_drawn_delays():
    with pytest.raises(neuro.ModelError, match=r"expected at most 6553\.6 ms, 2\^16 steps"):
        neuro.compile(pair(delay=neuro.uniform(low=1.0, high=1e5)), "reference")


def test_refractory_period():
    net = neuro.Network("one")
    net.population("a", 1, neuro.iaf_psc_exp(t_ref=1e300))
    with pytest.raises(neuro.ModelError, match=r"t_ref = 1e\+300 ms: expected at most"):
        neuro.compile(net, "reference")


VAST = """
import resource, neuro
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
net = neuro.Network("vast")
net.population("a", 1_500_000_000, neuro.iaf_psc_exp())
try:
    neuro.compile(net, "event")
except neuro.ModelError as error:
    print(error)
"""


def test_memory():
    told = subprocess.run([sys.executable, "-c", VAST], capture_output=True, text=True, check=True).stdout
    assert told.startswith("network 'vast' needs more memory than there is: ")


def test_weights_of_a_dopamine_rule_stay_within_its_bounds():
    net = neuro.Network("bounds")
    a, b = net.population("a", 1, neuro.parrot_neuron()), net.population("b", 2, neuro.iaf_psc_exp())
    net.connect(a, b, neuro.all_to_all(), neuro.stdp_dopa(Wmax=100.0, b=0.1), weight=5.0, name="ab")
    sim = neuro.compile(net, "reference")
    with pytest.raises(neuro.ModelError) as error:
        sim.set_weights("ab", [5.0, 500.0])
    assert str(error.value) == "projection 'ab': weight[1] = 500: expected 0 to 100, the bounds of stdp_dopa"
