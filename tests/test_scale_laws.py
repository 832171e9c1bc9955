"""How figures of `benchmarks/scale_laws.py` are taken: bytes of an event, and points of a network."""

import json

import numpy as np
import pytest

import neuro
from benchmark_scripts import BENCHMARKS, script


@pytest.fixture
def laws():
    return script("scale_laws")


def wired(delay, weight):
    net = neuro.Network("wired", resolution=0.1)
    net.population("a", 2, neuro.iaf_psc_exp())
    net.population("b", 40, neuro.iaf_psc_exp())
    pre, post = np.repeat([0, 1], [33, 17]), np.r_[np.arange(33), np.arange(17)]
    net.connect("a", "b", neuro.pairs(pre, post), weight=weight, delay=delay)
    return neuro.compile(net, seed=1).program


def test_bytes_of_an_event(laws):
    """Of sources with 33 and 17 synapses: 1 + 32 / 16 and 1 + 16 / 16 lines of targets; weights take twice the room."""
    one = wired(1.0, 2.0)
    assert laws.bytes_of_event(one) == pytest.approx((3 + 2) * 64 / 50)
    own = wired(1.0, np.linspace(1.0, 2.0, 50))
    assert laws.bytes_of_event(own) == pytest.approx((3 + 2 + 5 + 3) * 64 / 50)
    # the first source sends at two times, 32 synapses and one; the second at one
    delay = np.full(50, 1.0)
    delay[20] = 0.5
    apart = wired(delay, 2.0)
    assert laws.bytes_of_event(apart) == pytest.approx((1 + 31 / 16 + 1 + 2) * 64 / 50)


def test_a_point_counts_what_it_ran(laws):
    told = laws.point("brunel", 1250, 1.0)
    assert (told["neurons"], told["synapses"]) == (1250, 1250 * 1000)
    assert told["bytes_per_event"] == pytest.approx(64 * (1 + 799 / 16 + 1 + 199 / 16) / 1000, rel=0.05)
    assert 4.0 <= told["bytes_per_synapse"] < 5.0
    assert told["cpu_s_per_bio_s"] == pytest.approx(told["ns_per_event"] * told["events_per_bio_s"] * 1e-9)
    assert told["ns_per_event_alone"] < told["ns_per_event"]


def test_what_was_measured_is_whole(laws):
    told = json.loads((BENCHMARKS / "measured" / "scale_laws.json").read_text())
    points = {(p["case"], p["size"], p["indegree"]) for p in told["points"]}
    assert set(laws.QUICK) <= points <= set(laws.POINTS)
    lines = laws.series(told["points"])
    assert {name: (each[0]["neurons"], each[-1]["neurons"]) for name, each in lines.items()} == {
        "microcircuit, all inputs": (7717, 77_169),
        "microcircuit, fewer inputs": (7717, 77_169),
        "Brunel, 1000 inputs": (10_000, 100_000),
    }
    assert told["memory"]["random_lines_gb_per_s"] < told["memory"]["read_gb_per_s"]
