"""A network finds out which of two patterns it is to answer: each spike of its output is rewarded, or punished.

Synapses release by chance, and those that released before a reward do so more often. The twin has the same inputs and
no reward. Source: Seung, Neuron 40:1063, 2003. The network is `neuro_models.hedonists`. Writes hedonists.png.
"""

import argparse

import numpy as np
from matplotlib.figure import Figure

import neuro
from neuro_models import hedonists

SMOOTH = 20  # trials of a pattern


def smoothed(rates):
    """Running means of the rates of trials."""
    return np.convolve(rates, np.full(SMOOTH, 1.0 / SMOOTH), mode="valid")


def draw(found, twin, labels, weights, q):
    """The output's rates over trials, and what its synapses have learnt."""
    figure = Figure(figsize=(10, 3.5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    for pattern, (name, colour) in enumerate((("A, rewarded", "C0"), ("B, punished", "C3"))):
        trials = np.flatnonzero(labels == pattern)[SMOOTH - 1 :]
        left.plot(trials, smoothed(found[labels == pattern]), colour, label=name)
        left.plot(trials, smoothed(twin[labels == pattern]), colour, linewidth=0.8, linestyle="--", label="no reward")
    left.set(xlabel="trial", ylabel="rate of the output (Hz)", ylim=(0.0, None))
    left.legend(frameon=False, ncols=2)
    right.semilogx(weights, 1.0 / (1.0 + np.exp(-q)), ".")
    right.set(xlabel="weight onto the output (pA)", ylabel="probability of release", ylim=(0.0, 1.0))
    return figure


def main():
    """Train a network and show its twin the same."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--trials", type=int, default=1000)
    options.add_argument("--seed", type=int, default=1)
    asked = options.parse_args()
    labels = np.random.default_rng(asked.seed).permutation(np.arange(asked.trials) % 2)
    sim, other = (neuro.compile(hedonists.network(), seed=asked.seed) for _ in range(2))
    found = hedonists.present(sim, hedonists.PATTERNS[labels], np.where(labels == 0, 1.0, -1.0))
    twin = hedonists.present(other, hedonists.PATTERNS[labels], np.zeros(asked.trials))
    late = np.arange(asked.trials) >= asked.trials * 4 // 5
    for name, rates in (("with reward", found), ("without", twin)):
        a, b = (rates[late & (labels == pattern)].mean() for pattern in (0, 1))
        print(f"{name}, last fifth: A {a:.1f} Hz, B {b:.1f} Hz")
    picture = draw(found, twin, labels, sim.weights("onto_output")[2], sim.get("onto_output", "q"))
    picture.savefig("hedonists.png", dpi=150)


if __name__ == "__main__":
    main()
