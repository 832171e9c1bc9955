"""Steps per second of a closed loop with rates, dopamine, spikes and weights every 50 ms."""

import pytest
from measure import ClosedLoop
from networks import loop

AIMS = {0.1: "at least 6,000", 1.0: "at least 20,000"}
STEPS = 2000


@pytest.mark.parametrize("resolution", AIMS)
def test_loop(benchmark, figure, resolution):
    driven = ClosedLoop(loop(resolution))
    driven.steps(20)
    benchmark.pedantic(driven.steps, args=(STEPS,), rounds=5)
    rate = STEPS / benchmark.stats.stats.min
    benchmark.extra_info["steps_per_s"] = rate
    figure(f"closed loop at {resolution:g} ms", rate, "steps/s", AIMS[resolution])
