"""Every function that users call, with what no one should give it: one error in words, or what is said below."""

import math
import os

import numpy as np
import pytest

import neuro
from neuro.core.checks import argument
from refused import refused

HUGE, HALF = 10**400, np.ma.array([1.0, 2.0], mask=[False, True])
ODD = [
    *("10", True, None, b"1", HUGE, math.nan, math.inf, -1, [1.0], np.array(["a"])),
    *(int, neuro.uniform, print, 1j, {}),
]
"""Values that are no time, name, weight, path or backend."""


@pytest.fixture(scope="module")
def net():
    net = neuro.Network("n", resolution=1.0)
    net.population("g", 2, neuro.spike_generator())
    net.population("a", 2, neuro.iaf_psc_delta())
    net.connect("g", "a", neuro.one_to_one(), name="w")
    net.signal("reward", to="a")
    return net


@pytest.fixture(scope="module")
def sim(net):
    return neuro.compile(net, backend="reference")


def test_in_words(sim, net, tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    net.save("n.yaml")
    os.mkfifo("p")
    two = neuro.Network("n")
    two.population("payloads", 2, neuro.graded_spike_train())
    two.population("plain", 2, neuro.spike_generator())
    payloads = neuro.compile(two, "reference")
    payloads.inject("payloads", [1.0, 1.0], [0, 1], [2**31 - 1, -(2**31) + 1])
    messages.calls(globals() | {"sim": sim, "net": net, "payloads": payloads})
    assert sim.time == 0.0
    sim.forget(math.inf)
    sim.forget(-1)
    sim.set("a", V_m=np.ma.array([1.0, 2.0], mask=False))
    assert sim.get("a", "V_m").tolist() == [1.0, 2.0]


def test_the_largest_whole_numbers_are_accepted():
    assert argument("n", 2**31 - 1, kind="integer", at_least=0) == 2**31 - 1
    assert argument("n", -(2**31) + 1, kind="integer") == -(2**31) + 1
    assert argument("n", 2**63 - 1, kind="integer", at_least=0, at_most=2**63 - 1) == 2**63 - 1


@pytest.mark.parametrize("value", ODD, ids=repr)
def test_no_name(sim, value):
    """What is the name of nothing is told like an unknown name, also where it cannot be looked up."""
    for call in (sim.set, sim.weights, sim.trace):
        assert refused(call, value).startswith("unknown ")
    assert refused(sim.get, value, "V_m").startswith("unknown population or projection '")
    assert refused(sim.get, "a", value).startswith("population 'a': unknown parameter or state '")
    assert refused(sim.get, "w", value).startswith("projection 'w': unknown state of synapses '")
    assert refused(sim.signal, value, 1.0).startswith("unknown signal '")
    assert refused(sim.inject, value, [1.0], [0]).startswith("unknown population '")
    assert refused(sim.set_weights, value, 1.0).startswith("unknown projection '")


@pytest.mark.parametrize("value", [v for v in ODD if v is not True], ids=lambda value: type(value).__name__)
def test_no_flag(sim, value):
    for what, call in {"reset: weights": sim.reset, "raw": lambda raw: sim.get("a", "V_m", raw=raw)}.items():
        assert refused(call, value).startswith(f"{what} ")


@pytest.mark.parametrize("value", [v for v in ODD if v not in (-1, math.inf)], ids=lambda value: type(value).__name__)
def test_no_number(sim, value):
    refused(sim.set, "a", V_th=value)
    if value != [1.0]:
        refused(sim.set_weights, "w", value)
