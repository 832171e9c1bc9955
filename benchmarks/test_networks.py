"""Seconds a biological second of the large networks, on one core and on two."""

import pytest
from measure import WARM_UP_MS
from networks import NETWORKS

import neuro

AIMS = {"brunel": "at most 0.9", "cuba": "at most 0.05", "stdp": "at most 1/8 of NEST's"}
MEMORY_AIMS = {"brunel": "at most 8"}
THREADS_AIMS = {"brunel": "at least 1.5"}
MS = {"brunel": 500.0, "cuba": 1000.0, "stdp": 500.0}
ONE_THREAD = {}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("case", NETWORKS)
def test_network(benchmark, figure, case, threads):
    sim = neuro.compile(NETWORKS[case](), seed=12345, threads=threads)
    sim.run(WARM_UP_MS)
    benchmark.pedantic(sim.run, args=(MS[case],), rounds=3)
    rate = benchmark.stats.stats.min / MS[case] * 1e3
    benchmark.extra_info["sim_s_per_bio_s"] = rate
    if threads == 1:
        ONE_THREAD[case] = rate
        synapses = sum(p.size for p in sim.program.projections)
        figure(f"{case}", rate, "s/bio s", AIMS[case])
        used = sim.memory()["synapses"] / synapses
        figure(f"{case}: memory of synapses", used, "bytes a synapse", MEMORY_AIMS.get(case, ""))
    else:
        figure(f"{case} on two threads", rate, "s/bio s")
        if case in ONE_THREAD:
            faster = ONE_THREAD[case] / rate
            figure(f"{case}: two threads against one", faster, "times faster", THREADS_AIMS.get(case, ""))
