"""The network whose synapses release by chance learns what is rewarded."""

import numpy as np

import neuro
from neuro_models import hedonists


def shown(seed: int, trials: int, learn: bool) -> tuple[float, float]:
    """Mean rates of the output for A and B in the last 100 trials, Hz; A is rewarded, B punished."""
    labels = np.random.default_rng(seed).permutation(np.arange(trials) % 2)
    sim = neuro.compile(hedonists.network(), seed=seed)
    rates = hedonists.present(sim, hedonists.PATTERNS[labels], learn * np.where(labels == 0, 1.0, -1.0))
    late = np.arange(trials) >= trials - 100
    return rates[late & (labels == 0)].mean(), rates[late & (labels == 1)].mean()


def test_the_rewarded_pattern_is_answered():
    a, b = shown(2, 300, learn=True)
    assert a > 2.0 * b
    a, b = shown(2, 60, learn=False)
    assert a < b


def test_nothing_is_learnt_without_reward():
    sim = neuro.compile(hedonists.network(), seed=1)
    rates = hedonists.present(sim, hedonists.PATTERNS, [0.0, 0.0])
    assert rates.shape == (2,)
    assert np.all(sim.get("onto_hidden", "q") == 0.0)
    assert np.ptp(sim.get("onto_hidden", "c")) > 0.0
