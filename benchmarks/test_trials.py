"""Microseconds a trial: of a shared-kernel layer, learning and not, and of a feed-forward network."""

import time

import numpy as np
import pytest
from networks import digits, feed_forward

import neuro

TRIALS, SPIKES = 300, 400


@pytest.fixture(scope="module")
def batch():
    rng = np.random.default_rng(1)
    ids = np.concatenate([rng.choice(4 * 17 * 17, SPIKES, replace=False) for _ in range(TRIALS)])
    times = rng.integers(0, 64, TRIALS * SPIKES).astype(float)
    offsets = np.arange(TRIALS + 1) * SPIKES
    return times, ids, offsets, rng.integers(0, 10, TRIALS)


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["event", "loihi"])
@pytest.mark.parametrize("learn", [False, True], ids=["deciding", "learning"])
def test_trials(benchmark, figure, batch, learn, backend):
    times, ids, offsets, labels = batch
    sim = neuro.compile(digits(), seed=1, backend=backend)
    sim.trials(times, ids, offsets, labels, learn=learn)
    cpu = []

    def work():
        began = time.process_time()
        sim.trials(times, ids, offsets, labels, learn=learn)
        cpu.append(time.process_time() - began)

    benchmark.pedantic(work, rounds=5)
    cost = min(cpu) / TRIALS * 1e6
    benchmark.extra_info["us_per_trial"] = cost
    figure(f"a trial of {SPIKES} spikes, {'learning' if learn else 'deciding'}, {backend}", cost, "us")


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["event", "loihi"])
@pytest.mark.parametrize("model", [neuro.iaf_psc_exp, neuro.iaf_psc_delta])
def test_feed_forward(benchmark, figure, model, backend):
    n, spikes, rng, cpu = 20, 4200, np.random.default_rng(1), []
    ids, times = rng.integers(0, 2312, n * spikes), rng.integers(0, 310, n * spikes).astype(float)
    order = np.lexsort((ids, times, np.repeat(np.arange(n), spikes)))
    sim = neuro.compile(feed_forward(model), seed=1, backend=backend)

    def work():
        began = time.process_time()
        sim.trials(times[order], ids[order], np.arange(n + 1) * spikes)
        cpu.append(time.process_time() - began)

    benchmark.pedantic(work, rounds=5, warmup_rounds=1)
    figure(f"a recording of 2312-128-10, {model.__name__}, {backend}", min(cpu) / n * 1e3, "ms", "at most 1")
