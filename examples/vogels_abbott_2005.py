"""A network keeps itself active: a kick of 50 ms starts irregular spikes that do not end.

Four thousand neurons with conductances, a fifth of which inhibit; 2 % of the pairs are connected. Without the kick, or
with little inhibition, there is silence or an avalanche. Source: Vogels & Abbott, J. Neurosci. 25:10786, 2005, with
the numbers of Brette et al., J. Comput. Neurosci. 23:349, 2007, benchmark 1. Both show irregular spikes that go on, and
name no rate. Writes vogels_abbott_2005.png.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import neuro

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--neurons", type=int, default=4_000)
options.add_argument("--ms", type=float, default=1000.0)
asked = options.parse_args()

EXCITATORY = asked.neurons * 4 // 5
MEMBRANE = {"C_m": 200.0, "g_L": 10.0, "E_L": -60.0, "V_th": -50.0, "V_reset": -60.0, "t_ref": 5.0}
SYNAPSES = {"E_ex": 0.0, "E_in": -80.0, "tau_syn_ex": 5.0, "tau_syn_in": 10.0}


def network(kick: float, inhibition: float) -> neuro.Network:
    """The network of the benchmark.

    Args:
        kick: rate of twenty generators during the first 50 ms, Hz.
        inhibition: weight of an inhibitory synapse, nS.
    """
    net = neuro.Network("vogels-abbott", resolution=0.1)
    for name, size in (("exc", EXCITATORY), ("inh", asked.neurons - EXCITATORY)):
        net.population(name, size, neuro.iaf_cond_exp(**MEMBRANE, **SYNAPSES))
    net.population("kick", 20, neuro.poisson_generator(rate=kick, stop=50.0))
    net.connect("kick", "exc", neuro.pairwise_bernoulli(0.1), weight=6.0, delay=0.1)
    for target in ("exc", "inh"):
        net.connect("exc", target, neuro.pairwise_bernoulli(0.02), weight=6.0, delay=0.1)
        net.connect("inh", target, neuro.pairwise_bernoulli(0.02), weight=-inhibition, delay=0.1)
    return net


def irregularity(times: np.ndarray, ids: np.ndarray) -> float:
    """The mean coefficient of variation of the intervals of 500 neurons; NaN without enough spikes."""
    intervals = (np.diff(times[ids == neuron]) for neuron in range(500))
    found = [each.std() / each.mean() for each in intervals if len(each) > 2]
    return float(np.mean(found)) if found else np.nan


figure, axes = plt.subplots(1, 3, figsize=(11, 3.2), sharey=True, layout="constrained")
cases = {"as published": (300.0, 67.0), "without the kick": (0.0, 67.0), "a tenth of the inhibition": (300.0, 6.7)}
for (name, (kick, inhibition)), axis in zip(cases.items(), axes, strict=True):
    sim = neuro.compile(network(kick, inhibition), seed=1)
    sim.run(asked.ms)
    times, ids = sim.spikes("exc", since=asked.ms / 2)
    rate = len(times) / EXCITATORY / asked.ms * 2000.0
    print(f"{name}: {rate:.1f} Hz in the second half, CV of the intervals {irregularity(times, ids):.2f}")
    times, ids = sim.spikes("exc")
    shown = ids < 200
    axis.plot(times[shown], ids[shown], "k.", markersize=1)
    axis.set(title=f"{name}: {rate:.0f} Hz", xlabel="ms", xlim=(0, asked.ms), ylim=(0, 200))
axes[0].set_ylabel("neuron")
figure.savefig("vogels_abbott_2005.png", dpi=100)
