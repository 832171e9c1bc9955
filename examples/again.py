"""Stop and go on later: a saved simulation continues bit for bit, and a learnt network is a network again."""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import neuro

net = neuro.Network("again", resolution=0.1)
source = net.population("source", 50, neuro.poisson_generator(rate=40.0))
cells = net.population("cells", 10, neuro.iaf_psc_exp())
net.connect(source, cells, neuro.all_to_all(), neuro.stdp(lambda_=0.02, alpha=0.8, Wmax=200.0), weight=100.0, delay=1.0)

with TemporaryDirectory() as folder:
    sim = neuro.compile(net, seed=7)
    sim.run(500.0)
    sim.save(Path(folder, "state.h5"))
    sim.run(500.0)

    later = neuro.compile(net, seed=7)
    later.restore(Path(folder, "state.h5"))
    later.run(500.0)
    assert np.array_equal(sim.weights("source_cells")[2], later.weights("source_cells")[2])
    print(f"both at {later.time:g} ms with the same {later.weights('source_cells')[2].size} weights")

    learnt = sim.network()
    learnt.save(Path(folder, "learnt.yaml"))
    print("saved:", ", ".join(sorted(path.name for path in Path(folder).iterdir())))
    assert neuro.load(Path(folder, "learnt.yaml")) == learnt

before, after = net.projections["source_cells"].weight, learnt.projections["source_cells"].weight
print(f"mean weight {before:.1f} pA before, {np.mean(after):.1f} pA after")

figure, ax = plt.subplots(figsize=(6, 2.6), layout="constrained")
ax.hist(np.ravel(after), bins=40)
ax.axvline(before, color="k", linestyle="--", label="all of them before")
ax.set(xlabel="weight (pA)", ylabel="synapses", title="weights after 1 s of stdp")
ax.legend(frameon=False)
figure.savefig("again.png", dpi=100)
