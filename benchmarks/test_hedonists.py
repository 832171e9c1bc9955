"""Synapses that release by chance: of two patterns the rewarded one is answered; exclusive or is tried."""

import numpy as np

import neuro
from neuro_models import hedonists

SEEDS = range(11, 21)
"""1 to 4 chose the weights and the rate of learning."""


def answers(seed, reward):
    """Mean rates of the output for A and B in the last 200 of 1000 trials, Hz."""
    labels = np.random.default_rng(seed).permutation(np.arange(1000) % 2)
    sim = neuro.compile(hedonists.network(), seed=seed)
    rates = hedonists.present(sim, hedonists.PATTERNS[labels], reward * np.where(labels == 0, 1.0, -1.0))
    return [rates[800:][labels[800:] == pattern].mean() for pattern in (0, 1)]


def test_the_rewarded_pattern_is_answered(figure):
    for reward, aim in ((1.0, "10"), (0.0, "about 3")):
        a, b = np.array([answers(seed, reward) for seed in SEEDS]).T
        told = "A rewarded, B punished" if reward else "no reward"
        figure(f"{told}: seeds with rate(A) > 2 rate(B)", float((a > 2.0 * b).sum()), "of 10", aim)
        for name, rates in (("A", a), ("B", b)):
            figure(f"{told}: rate({name}), least", float(rates.min()), "Hz")
            figure(f"{told}: rate({name}), largest", float(rates.max()), "Hz")
