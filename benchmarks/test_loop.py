"""Steps per second of a closed loop with rates, dopamine, spikes and weights every 50 ms."""

import pytest
from measure import ClosedLoop, PlainLoop
from networks import loop

AIMS = {0.1: "at least 6,000", 1.0: "at least 20,000"}
STEPS = 2000


@pytest.mark.parametrize("way", [ClosedLoop, PlainLoop])
@pytest.mark.parametrize("resolution", AIMS)
def test_loop(benchmark, figure, resolution, way):
    driven = way(loop(resolution))
    driven.steps(20)
    benchmark.pedantic(driven.steps, args=(STEPS,), rounds=5)
    rate = STEPS / benchmark.stats.stats.min
    benchmark.extra_info["steps_per_s"] = rate
    aim = AIMS[resolution] if way is ClosedLoop else ""
    figure(f"closed loop at {resolution:g} ms, {way.__name__}", rate, "steps/s", aim)
