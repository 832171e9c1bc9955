"""How figures of `benchmarks/scale_laws.py` are taken: points of a network, and the file of what was measured."""

import json

import pytest

from benchmark_scripts import BENCHMARKS, script


@pytest.fixture
def laws():
    return script("scale_laws")


def test_a_point_counts_what_it_ran(laws):
    told = laws.point("brunel", 1250, 1.0)
    assert (told["neurons"], told["synapses"]) == (1250, 1250 * 1000)
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
