"""Microseconds a trial of a shared-kernel layer, learning and not."""

import numpy as np
import pytest
from networks import digits

import neuro

TRIALS, SPIKES = 300, 400


@pytest.fixture(scope="module")
def batch():
    rng = np.random.default_rng(1)
    ids = np.concatenate([rng.choice(4 * 17 * 17, SPIKES, replace=False) for _ in range(TRIALS)])
    times = rng.integers(0, 64, TRIALS * SPIKES).astype(float)
    offsets = np.arange(TRIALS + 1) * SPIKES
    return times, ids, offsets, rng.integers(0, 10, TRIALS)


@pytest.mark.parametrize("learn", [False, True], ids=["deciding", "learning"])
def test_trials(benchmark, figure, batch, learn):
    times, ids, offsets, labels = batch
    sim = neuro.compile(digits(), seed=1)
    sim.trials(times, ids, offsets, labels, learn=learn)
    benchmark.pedantic(sim.trials, args=(times, ids, offsets, labels), kwargs={"learn": learn}, rounds=5)
    cost = benchmark.stats.stats.min / TRIALS * 1e6
    benchmark.extra_info["us_per_trial"] = cost
    figure(f"a trial of {SPIKES} spikes, {'learning' if learn else 'deciding'}", cost, "us")
