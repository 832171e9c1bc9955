"""Run the network for a second and print its firing. Next: python -m pytest."""

from pathlib import Path

import numpy as np

import neuro

NETWORK = Path(__file__).with_name("network.yaml")


def firing(seed=1, **parameters):
    """Return the rate of the excitatory neurons (Hz), and the coefficient of variation of their intervals.

    The coefficient measures irregularity: 0 for a clock, and 1 for a Poisson process.
    """
    sim = neuro.compile(neuro.load(NETWORK, params=parameters), seed=seed)
    sim.run(1000.0)  # ms
    times, ids = sim.spikes("exc")
    settled = times > 200.0  # the network has settled
    times, ids = times[settled], ids[settled]
    intervals = [np.diff(times[ids == i]) for i in np.unique(ids)]
    variation = [t.std() / t.mean() for t in intervals if t.size > 4]
    return times.size / 400 / 0.8, float(np.mean(variation))


if __name__ == "__main__":
    rate, irregularity = firing()
    print(f"{rate:.1f} Hz, coefficient of variation {irregularity:.2f}")
