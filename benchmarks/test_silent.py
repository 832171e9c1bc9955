"""The cost of a run follows its events: neurons that nothing reaches are nearly free."""

import pytest
from measure import WARM_UP_MS, seconds
from networks import silent

import neuro

MS = 1000.0
AIMS = {
    "beside": ("in the same population", "at most 1.2"),
    "elsewhere": ("in another population", "at most 1.2"),
    "between": ("between the busy ones", ""),
}


def warm(where):
    sim = neuro.compile(silent(where), seed=1)
    sim.run(WARM_UP_MS)
    return sim


@pytest.mark.parametrize("where", AIMS)
def test_silent(benchmark, figure, where):
    alone, crowded = warm("nowhere"), warm(where)
    least = min(seconds(alone.run, MS) for _ in range(5))
    benchmark.pedantic(crowded.run, args=(MS,), rounds=5)
    ratio = benchmark.stats.stats.min / least
    benchmark.extra_info["ratio"] = ratio
    figure(f"100 x silent neurons {AIMS[where][0]}", ratio, "times the time", AIMS[where][1])
