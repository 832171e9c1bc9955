"""What a network would take on each chip: joules with their range, at both clocks.

A balanced network runs once; its counts are priced by the published figures of each chip. Dynamic energy is that of
operations, static energy that of a chip that is on. Writes bill.png.
"""

import matplotlib.pyplot as plt

import neuro

net = neuro.Network("priced", resolution=1.0)
cell = neuro.iaf_psc_exp(t_ref=2.0)
drive = net.population("drive", 400, neuro.poisson_generator(rate=20.0))
exc, inh = net.population("exc", 800, cell), net.population("inh", 200, cell)
for target in (exc, inh):
    net.connect(drive, target, neuro.fixed_indegree(40), weight=90.0, delay=1.0)
    net.connect(exc, target, neuro.fixed_indegree(80), weight=12.0, delay=2.0)
    net.connect(inh, target, neuro.fixed_indegree(20), weight=-90.0, delay=2.0)
sim = neuro.compile(net, seed=1)
sim.run(1000.0)
counts = sim.counts()
print(f"a second: {counts.spikes:,} spikes, {counts.synaptic_ops:,} synaptic operations")

chips = ("loihi", "spinnaker", "truenorth")
figure, axes = plt.subplots(1, 2, figsize=(10, 2.6), sharex=True, sharey=True, layout="constrained")
for axis, clock in zip(axes, ("as fast as the chip can", "in real time"), strict=True):
    for place, chip in enumerate(chips):
        bill = sim.energy(chip)
        at = bill if clock.startswith("as") else bill.real_time
        print(f"{chip}, {clock}: {1e3 * at.total_j:.3g} mJ ({1e3 * at.low_j:.3g} to {1e3 * at.high_j:.3g})")
        axis.plot([at.low_j, at.high_j], [place, place], "0.6", linewidth=4, solid_capstyle="round")
        axis.plot(at.total_j, place, "o", color="C0", markersize=9)
    axis.set(xscale="log", title=clock, xlabel="joules for a second of the network")
    axis.set_yticks(range(len(chips)), chips)
    axis.margins(y=0.3)
    axis.grid(axis="x", alpha=0.3)
figure.savefig("bill.png", dpi=100)
