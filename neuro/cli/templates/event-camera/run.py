"""Show the recording to the network and draw what it saw. Next: python -m pytest."""

from pathlib import Path

import numpy as np

import neuro
from neuro import events

NETWORK = Path(__file__).with_name("network.yaml")
RECORDING = Path(__file__).with_name("walk.dat")  # or any other: neuro events info FILE tells its sensor
SIDE = 8  # px of a cell


def seen(recording=RECORDING, seed=1):
    """How many spikes each neuron of the grid fired: (rows, columns)."""
    net = neuro.load(NETWORK)
    rows, columns = net.populations["grid"].shape
    camera = events.load(recording)
    cells = (camera.y // SIDE) * columns + camera.x // SIDE
    # Times on the network's grid, from its first step on; events of a cell in one step become one spike.
    steps = np.ceil((camera.t - camera.t[0]) / 1000.0 / net.resolution).astype(int) + 1
    steps, cells = np.unique([steps, cells], axis=1)
    sim = neuro.compile(net, seed=seed)
    sim.inject("cells", steps * net.resolution, cells)
    sim.run(float(steps[-1]) * net.resolution + 50.0)  # ms
    _, ids = sim.spikes("grid")
    return np.bincount(ids, minlength=rows * columns).reshape(rows, columns)


if __name__ == "__main__":
    for row in seen():
        print("".join(f"{count:5d}" for count in row))
