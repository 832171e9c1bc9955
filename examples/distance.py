"""Which neurons of a sheet one reaches, how likely, how strongly and how late: `connect_by_distance.png`."""

import matplotlib.pyplot as plt
import numpy as np

import neuro

SIDE, EXTENT = 40, 1.0  # neurons and mm of a side
NEAR = neuro.gaussian(std=0.12, a=0.8)
RING = neuro.gaussian(std=0.03, mean=0.3, a=0.5)
WEIGHT, DELAY = neuro.exponential(a=80.0, beta=0.2), neuro.linear(c=0.5, a=5.0)
ONE = 6 * SIDE + 33  # near a corner

net = neuro.Network("sheet")
sheet = net.population("sheet", [SIDE, SIDE], neuro.iaf_psc_exp(), extent=[EXTENT, EXTENT], periodic=True)
for name, profile in (("near", NEAR), ("ring", RING)):
    rule = neuro.distance_dependent(p=profile, mask=neuro.circular(radius=0.5), autapses=False)
    values = {"weight": neuro.of_distance(WEIGHT), "delay": neuro.of_distance(DELAY)}
    net.connect(sheet, sheet, rule, name=name, **values)
sim = neuro.compile(net, "reference")


def distance(pre: np.ndarray, post: np.ndarray) -> np.ndarray:
    """The shortest way between neurons, in mm."""
    way = (np.stack(np.divmod(post, SIDE)) - np.stack(np.divmod(pre, SIDE))) * EXTENT / SIDE
    way -= EXTENT * np.rint(way / EXTENT)
    return np.sqrt((way**2).sum(axis=0))


figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
everyone = np.arange(SIDE * SIDE)
steps, fine = np.linspace(0.0, 0.5, 26), np.linspace(0.0, 0.5, 200)
possible = np.histogram(distance(np.full(everyone.size - 1, ONE), np.delete(everyone, ONE)), steps)[0] * everyone.size
for name, profile, color in (("near", NEAR, "tab:blue"), ("ring", RING, "tab:orange")):
    pre, post, weight = sim.weights(name)
    far = distance(pre, post)
    rows, columns = np.divmod(post[pre == ONE], SIDE)
    axes[0].plot(columns, rows, ".", markersize=4, color=color, label=name)
    found = np.histogram(far, steps)[0]
    there = found > 0
    mean = np.histogram(far, steps, weights=far)[0][there] / found[there]
    axes[1].plot(mean, found[there] / possible[there], ".", color=color, label=f"{name}: share of pairs")
    axes[1].plot(fine, profile.at(fine), color=color, label=f"{name}: p")
    print(f"{name}: {pre.size} synapses, {far.mean():.3f} mm in the mean, {weight.mean():.4g} pA")
axes[0].plot(*divmod(ONE, SIDE)[::-1], "k*", markersize=10, label="source")
axes[0].set(title="targets of one neuron", xlabel="column", ylabel="row")
axes[0].set(xlim=(-0.5, SIDE - 0.5), ylim=(-0.5, SIDE - 0.5))
axes[0].set_aspect("equal")
axes[0].legend(loc="center left", fontsize=8)
axes[1].set(title="connected pairs", xlabel="distance (mm)", ylabel="probability", ylim=(0.0, 0.85))
axes[1].legend(fontsize=8)
pre, post, weight = sim.weights("near")
order = np.argsort(distance(pre, post))[::50]
axes[2].plot(distance(pre, post)[order], weight[order], color="tab:green")
axes[2].set(title="weight and delay", xlabel="distance (mm)")
axes[2].set_ylabel("weight (pA)", color="tab:green")
late = axes[2].twinx()
late.plot(steps, np.rint(DELAY.at(steps) / 0.1) * 0.1, color="tab:red", drawstyle="steps-mid")
late.set_ylabel("delay (ms), in steps", color="tab:red")
figure.savefig("connect_by_distance.png", dpi=80)
