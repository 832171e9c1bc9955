"""One network on every backend: equal spikes from the float ones; a chip that rounds and learns coarsely, its bill."""

import warnings
from pathlib import Path
from time import perf_counter

import matplotlib.pyplot as plt

import neuro

net = neuro.load(Path(__file__).with_name("follower.yaml"))
spikes = {}
for backend in ("reference", "event", "loihi"):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", neuro.ApproximationWarning)  # it tells all that the chip does otherwise
        sim = neuro.compile(net, backend=backend, seed=3)
    sim.set("cells", rate=20.0)
    sim.signal("reward", [0.01, -0.01])
    begin = perf_counter()
    sim.run(500.0)
    times, ids = sim.spikes("motors")
    spikes[backend] = set(zip(times.tolist(), ids.tolist(), strict=True))
    print(f"{backend:9} {times.size} spikes in {perf_counter() - begin:.4f} s")

assert spikes["event"] == spikes["reference"]
shared = len(spikes["loihi"] & spikes["event"]) / len(spikes["event"])
bill = sim.energy("loihi")
print(f"loihi fires {shared:.0%} of the spikes at the very step, since it learns in steps of 5 pA, and takes")
print(f"{bill.totals()}; print(bill) tells the sources")

figure, ax = plt.subplots(figsize=(8, 2.4), layout="constrained")
rows = [(backend, motor) for backend in spikes for motor in range(2)]
ax.eventplot(
    [[time for time, neuron in spikes[backend] if neuron == motor] for backend, motor in rows],
    colors=[f"C{list(spikes).index(backend)}" for backend, _ in rows],
)
ax.set(yticks=[0.5, 2.5, 4.5], yticklabels=list(spikes), xlabel="time (ms)", title="spikes of the two motors")
figure.savefig("backends.png", dpi=100)
