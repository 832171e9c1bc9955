"""The trial loop: what it teaches and when, by hand, and what it says when misused."""

from typing import Any

import numpy as np
import pytest

import neuro
from neuro import Network, all_to_all, iaf_psc_delta, r_stdp, spike_generator, winner_take_all
from neuro.run.simulation import Simulation
from refusals import refused

RATES = {"Ar_plus": 0.1, "Ar_minus": -0.05, "Ap_plus": 0.02, "Ap_minus": -0.04}


def pair(rule: r_stdp, weights: Any = ((0.9, 0.2), (0.9, 0.2)), backend: str = "reference", **words: Any) -> Simulation:
    """Two inputs onto two maps of one neuron each, which stand for two labels; threshold 0.8."""
    net = Network("pair", resolution=1.0)
    net.population("input", 2, spike_generator())
    net.population("maps", (2, 1), iaf_psc_delta(tau_m=float("inf"), E_L=0.0, V_reset=0.0, V_th=0.8))
    net.connect("input", "maps", all_to_all(), rule, weight=np.array(weights), delay=1.0, name="w")
    net.group("choice", winner_take_all(of="maps"))
    told = {"input": "input", "duration": 10.0, "labels": {"of": "maps"}} | words
    net.trials(**told)
    return neuro.compile(net, backend)


def weights(sim: Simulation) -> np.ndarray:
    return sim.weights("w")[2].reshape(2, 2)


def bent(w: float, rate: float) -> float:
    return w + rate * w * (1.0 - w)


def test_a_right_decision_is_rewarded():
    sim = pair(r_stdp(**RATES))
    r = sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=[0], learn=True)
    assert (r.winner.tolist(), r.label.tolist(), r.step.tolist(), r.ticks.tolist()) == ([0], [0], [1], [2])
    assert r.potential.tolist() == [[0.9, 0.2]]
    assert weights(sim).ravel() == pytest.approx([bent(0.9, 0.1), 0.2, bent(0.9, -0.05), 0.2], abs=1e-15)
    assert r.counts.learning_updates == 2


def test_a_wrong_decision_is_punished_and_the_right_maps_grow():
    sim = pair(r_stdp(**RATES, epsilon=0.01))
    sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=[1], learn=True)
    assert weights(sim).ravel() == pytest.approx([bent(0.9, -0.04), 0.21, bent(0.9, 0.02), 0.21], abs=1e-15)


def test_rescue_rewards_the_best_of_the_right_label():
    sim = pair(r_stdp(**RATES, rescue=True))
    r = sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=[1], learn=True)
    expected = [bent(0.9, -0.04), bent(0.2, 0.1), bent(0.9, 0.02), bent(0.2, -0.05)]
    assert weights(sim).ravel() == pytest.approx(expected, abs=1e-15)
    assert r.counts.learning_updates == 4


def test_silence_lets_the_right_maps_grow():
    sim = pair(r_stdp(**RATES, epsilon=0.01), [[0.3, 0.3], [0.3, 0.3]])
    r = sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=[1], learn=True)
    assert (r.winner.tolist(), r.label.tolist(), r.step.tolist(), r.ticks.tolist()) == ([-1], [-1], [-1], [10])
    assert r.potential.tolist() == [[0.6, 0.6]]
    assert weights(sim).ravel() == pytest.approx([0.3, 0.31, 0.3, 0.31], abs=1e-15)


def test_silence_with_rescue_counts_all_arrivals_as_before():
    sim = pair(r_stdp(**RATES, rescue=True), [[0.3, 0.3], [0.3, 0.3]])
    sim.trials([0.0, 9.0], [0, 1], [0, 2], labels=[1], learn=True)
    assert weights(sim).ravel() == pytest.approx([0.3, bent(0.3, 0.1), 0.3, bent(0.3, -0.05)], abs=1e-15)


@pytest.mark.parametrize(
    ("words", "batch"),
    [
        ({}, {"times": [0.0, 5.0], "ids": [0, 1], "offsets": [0, 2], "labels": [1]}),
        (
            {"reward": {"correct": 0, "wrong": 0}},
            {"times": [0.0, 0.0], "ids": [0, 0], "offsets": [0, 1, 2], "labels": [0, 1], "learn": True},
        ),
    ],
    ids=["testing", "rewards of 0"],
)
def test_what_teaches_nothing(words, batch):
    sim = pair(r_stdp(**RATES, epsilon=0.0), **words)
    before = weights(sim).copy()
    sim.trials(**batch)
    assert np.array_equal(weights(sim), before)


def test_dropout_is_a_draw_for_each_sample():
    sim = pair(r_stdp(), [[1.0, 1.0], [1.0, 1.0]], dropout={"of": "maps", "p": 0.5})
    n = 240
    batch = (np.zeros(n), np.zeros(n, dtype=int), np.arange(n + 1), np.zeros(n, dtype=int))
    r = sim.trials(*batch, learn=True, samples=np.arange(n) // 3)
    of_sample = (r.winner < 0).reshape(-1, 3)
    assert (of_sample.all(axis=1) == of_sample.any(axis=1)).all()
    assert 0.1 < of_sample[:, 0].mean() < 0.4
    tested = sim.trials(*batch[:3])
    assert (tested.winner >= 0).all()


def test_dropout_decays():
    sim = pair(r_stdp(), dropout={"of": "maps", "p": 0.9, "decay": 0.1})
    n = 200
    batch = (np.zeros(n), np.zeros(n, dtype=int), np.arange(n + 1), np.zeros(n, dtype=int))
    silent = [(sim.trials(*batch, learn=True, epoch=epoch).winner < 0).mean() for epoch in (0, 3)]
    assert silent[0] > 0.7
    assert silent[1] < 0.05


ONE = ([1.0], [1], [0, 1])
MISUSE: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
    (([0.5], [0], [0, 1]), {}, "times = 0.5 ms: expected a multiple of the resolution, 1 ms"),
    (([10.0], [0], [0, 1]), {}, "times[0] = 10 ms: expected 0 <= t < 10 ms, the duration"),
    (([1.0], [2], [0, 1]), {}, "ids[0] = 2: expected a neuron from 0 to 1"),
    (([1.0], [0.5], [0, 1]), {}, "ids: found float64: expected whole numbers"),
    (([1.0, 2.0], [1], [0, 2]), {}, "2 times and 1 ids: expected as many of each"),
    (([1.0], [1], [0, 2]), {}, "offsets from 0 to 2: expected ascending numbers from 0 to 1, the number of times"),
    (ONE, {"learn": True}, "learn=True without labels: expected one label for each"),
    (([1.0], [1], [0, 1, 1]), {"labels": [0]}, "labels of shape [1]: expected 2 whole numbers, one a trial"),
    (ONE, {"labels": [2]}, "labels[0] = 2: expected a label from 0 to 1"),
    (ONE, {"labels": [1], "learn": True, "samples": [1, 2]}, "samples of shape [2]: expected 1 whole numbers, one a "),
    (ONE, {"labels": [1], "learn": True, "epoch": -1}, "epoch = -1: expected a whole number >= 0"),
    (([1.0, 1.0, 2.0], [1, 1, 1], [0, 1, 3]), {"labels": [1, 1], "learn": True},
     "input 1 spikes twice in trial 1: expected at most once while learning"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "words", "message"), MISUSE)
def test_misuse(arguments, words, message):
    assert refused(lambda: pair(r_stdp()).trials(*arguments, **words)).startswith(f"trials: {message}")


def test_an_empty_batch_and_an_unsorted_one():
    r = pair(r_stdp()).trials([], [], [0], labels=np.zeros(0, dtype=int), learn=True)
    assert (len(r), r.potential.shape, r.counts.steps) == (0, (0, 2), 0)
    x = pair(r_stdp()).trials([5.0, 0.0, 1.0], [1, 0, 0], [0, 2, 3])
    y = pair(r_stdp()).trials([0.0, 5.0, 1.0], [0, 1, 0], [0, 2, 3])
    assert np.array_equal(x.winner, y.winner)
    assert np.array_equal(x.step, y.step)
