"""Exclusive or by hedonistic synapses: `python benchmarks/xor.py [--seeds 5]` prints the output's rates by pattern.

The task is Seung's (Neuron 40:1063, 2003), as Florian repeated it (Neural Comput. 19:1468, 2007): 30 inputs a bit, 0 or
40 Hz, 60 hidden neurons, half of the inputs inhibitory, 500 ms a pattern, +1 for each spike of the output where one bit
is set, -1 otherwise.
"""

import argparse

import numpy as np

import neuro
from neuro_models import hedonists

BITS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])


def learnt(seed, epochs, eta, weight):
    """Mean rates of the output for each pattern in the first and the last tenth, Hz, shape (2, 4)."""
    rng = np.random.default_rng(seed)
    shown = np.concatenate([rng.permutation(4) for _ in range(epochs)])
    sim = neuro.compile(hedonists.network(eta=eta, weight=weight), seed=seed)
    pre, _, drawn = sim.weights("onto_hidden")
    sim.set_weights("onto_hidden", np.where(pre % 2 == 0, drawn, -drawn))
    rewards = np.where(BITS.sum(axis=1) == 1, 1.0, -1.0)
    rates = hedonists.present(sim, (BITS @ hedonists.PATTERNS)[shown], rewards[shown], duration=500.0)
    tenth = 4 * max(1, epochs // 10)
    ends = (slice(tenth), slice(-tenth, None))
    return np.array([[rates[end][shown[end] == pattern].mean() for pattern in range(4)] for end in ends])


def main():
    """Print a line a seed."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--first", type=int, default=1, help="the first seed")
    options.add_argument("--epochs", type=int, default=200, help="of the four patterns")
    options.add_argument("--eta", type=float, default=0.2)
    options.add_argument("--weight", type=float, default=200.0, help="mean, pA")
    asked = options.parse_args()
    for seed in range(asked.first, asked.first + asked.seeds):
        begin, end = learnt(seed, asked.epochs, asked.eta, asked.weight)
        told = " -> ".join(", ".join(f"{rate:.1f}" for rate in rates) for rates in (begin, end))
        apart = min(end[1], end[2]) - end[3]
        print(f"seed {seed}: 00, 01, 10, 11 at {told} Hz; min(01, 10) - 11 = {apart:.1f} Hz", flush=True)


if __name__ == "__main__":
    main()
