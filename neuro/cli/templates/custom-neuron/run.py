"""See the neuron adapt. Next: python -m pytest."""

from pathlib import Path

import numpy as np

import neuro

NETWORK = Path(__file__).with_name("network.yaml")


def intervals(population):
    """Return the interspike intervals of one neuron, ms."""
    sim = neuro.compile(neuro.load(NETWORK), seed=1)
    sim.run(1000.0)  # ms
    times, _ = sim.spikes(population)
    return np.diff(times)


if __name__ == "__main__":
    for name in ("cells", "plain"):
        between = intervals(name)
        print(f"{name}: {between[0]:.1f} ms between the first two spikes, {between[-1]:.1f} ms between the last two")
