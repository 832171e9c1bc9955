"""Object recognition: time of a trial, of training from stored C1 spikes, and of the front end of a recording.

A trial runs a shared-kernel layer, with and without learning, or a feed-forward network.
"""

import numpy as np
import pytest
from kept import NMNIST
from networks import digits, feed_forward

import neuro
from neuro.events import recordings
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import learn as taught

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
def test_trials(benchmark, least_cpu, figure, batch, learn, backend):
    times, ids, offsets, labels = batch
    sim = neuro.compile(digits(), seed=1, backend=backend)
    sim.trials(times, ids, offsets, labels, learn=learn)
    cost = least_cpu(lambda: sim.trials(times, ids, offsets, labels, learn=learn), 5) / TRIALS * 1e6
    benchmark.extra_info["us_per_trial"] = cost
    figure(f"a trial of {SPIKES} spikes, {'learning' if learn else 'deciding'}, {backend}", cost, "us")


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["event", "loihi"])
@pytest.mark.parametrize("model", [neuro.iaf_psc_exp, neuro.iaf_psc_delta])
def test_feed_forward(least_cpu, figure, model, backend):
    n, spikes, rng = 20, 4200, np.random.default_rng(1)
    ids, times = rng.integers(0, 2312, n * spikes), rng.integers(0, 310, n * spikes).astype(float)
    order = np.lexsort((ids, times, np.repeat(np.arange(n), spikes)))
    sim = neuro.compile(feed_forward(model), seed=1, backend=backend)
    took = least_cpu(lambda: sim.trials(times[order], ids[order], np.arange(n + 1) * spikes), rounds=5, warmup_rounds=1)
    figure(f"a recording of 2312-128-10, {model.__name__}, {backend}", took / n * 1e3, "ms", "at most 1")


@pytest.fixture(scope="module")
def data():
    if not NMNIST.is_file():
        pytest.skip("../shared is not here")
    return recordings(NMNIST)[::3][:300]


@pytest.mark.parametrize(("per_class", "aim"), [(2, "at most 4"), (8, "at most 12")])
def test_training(benchmark, least_cpu, figure, data, tmp_path_factory, per_class, aim):
    method = Remus().preset("adapted").changed({"per_class": per_class}).fitting((34, 34))
    shown = observe(method, data, cache=tmp_path_factory.getbasetemp())
    taught(method, shown.take(range(2)), "two")
    took = least_cpu(lambda: taught(method, shown, "all"), 2)
    benchmark.extra_info["cpu_s"] = took
    figure(f"300 recordings x 8 epochs, {per_class} grids a class", took, "s of one core", aim)


def test_front_end(benchmark, figure, data):
    front, events = Remus().fitting((34, 34)), [item.load() for item in data[:50]]
    front.observe(events[0])
    benchmark.pedantic(lambda: [front.observe(e) for e in events], rounds=3)
    figure("front end of a recording", benchmark.stats.stats.min / len(events) * 1e3, "ms", "at most 10")
