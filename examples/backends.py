"""One network, every backend: the same spikes, at different speeds."""

from pathlib import Path
from time import perf_counter

import numpy as np

import neuro
from neuro.backend import installed

net = neuro.load(Path(__file__).with_name("follower.yaml"))
spikes = {}
for name, backend in installed().items():
    sim = neuro.compile(net, backend=name, seed=3)
    sim.set("cells", rate=20.0)
    sim.signal("reward", [0.01, -0.01, 0.01, -0.01])
    begin = perf_counter()
    sim.run(500.0)
    spikes[name] = sim.spikes("motors")
    print(f"{name:9} {spikes[name][0].size} spikes in {perf_counter() - begin:.4f} s: {backend.description}")

times, ids = spikes["reference"]
for name, (other_times, other_ids) in spikes.items():
    assert np.array_equal(times, other_times), name
    assert np.array_equal(ids, other_ids), name
