"""What STDP costs beside delivering the spike: nanoseconds a synaptic event (pre or post spike at a synapse)."""

from measure import WARM_UP_MS, seconds
from networks import learning

import neuro

MS = 1000.0


def test_learning(benchmark, figure):
    plain = neuro.compile(learning(plastic=False), seed=1)
    plastic = neuro.compile(learning(plastic=True), seed=1)
    for sim in (plain, plastic):
        sim.run(WARM_UP_MS)
    before = plastic.counts().learning_updates
    delivering = min(seconds(plain.run, MS) for _ in range(5))
    benchmark.pedantic(plastic.run, args=(MS,), rounds=5)
    events = (plastic.counts().learning_updates - before) / 5
    cost = (benchmark.stats.stats.min - delivering) / events * 1e9
    benchmark.extra_info["ns_per_event"] = cost
    figure("learning by STDP", cost, "ns/event", "at most 40")
