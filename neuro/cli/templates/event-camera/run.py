"""Show the recording to the network and print which neurons fired. Next: python -m pytest."""

from pathlib import Path

import numpy as np

import neuro

NETWORK = Path(__file__).with_name("network.yaml")


def spike_counts(duration=1000.0, seed=1, **parameters):
    """Return the number of spikes of each neuron of the grid in `duration` ms, shape (rows, columns)."""
    sim = neuro.compile(neuro.load(NETWORK, params=parameters), seed=seed)
    sim.run(duration)  # the recording is read while the network runs
    _, ids = sim.spikes("grid")
    return np.bincount(ids, minlength=48).reshape(6, 8)


if __name__ == "__main__":
    for row in spike_counts():
        print("".join(f"{count:5d}" for count in row))
