"""Synapses compete: spike-timing-dependent plasticity drives their weights to either end of the range.

A neuron hears 1,000 excitatory inputs of 20 Hz, whose synapses learn, and 200 inhibitory ones of 10 Hz. Weights begin
alike. At the end most are near zero or near the largest, and the neuron fires at a moderate rate, whatever its input.
Source: Song, Miller & Abbott, Nature Neurosci. 3:919, 2000, figures 1 and 2. Writes song_2000.png.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import neuro

LEAK = 10.0  # nS
LARGEST = 0.015 * LEAK  # the paper's g_max

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--seconds", type=float, default=1500.0)
asked = options.parse_args()

potentials = {"E_L": -70.0, "V_reset": -60.0, "V_th": -54.0, "E_ex": 0.0, "E_in": -70.0}
neuron = neuro.iaf_cond_exp(C_m=200.0, g_L=LEAK, t_ref=0.0, tau_syn_ex=5.0, tau_syn_in=5.0, **potentials)
additive = {"mu_plus": 0.0, "mu_minus": 0.0}
rule = neuro.stdp(tau_plus=20.0, lambda_=0.005, alpha=1.05, Wmax=LARGEST, **additive)  # A+ = 0.005, A- = 1.05 A+


def learn(rate: float) -> tuple[float, np.ndarray]:
    """The rate of the neuron at the end, and its weights by the largest."""
    net = neuro.Network("song", resolution=0.1)
    net.population("exc", 1000, neuro.poisson_generator(rate=rate))
    net.population("inh", 200, neuro.poisson_generator(rate=10.0))
    net.population("cell", 1, neuron)
    net.connect("exc", "cell", neuro.all_to_all(), rule, weight=LARGEST, delay=0.1, name="learnt")
    net.connect("inh", "cell", neuro.all_to_all(), weight=-0.05 * LEAK, delay=0.1)
    sim = neuro.compile(net, seed=1)
    sim.run(1000.0 * asked.seconds)
    last = min(20.0, asked.seconds / 2)
    times, _ = sim.spikes("cell", since=1000.0 * (asked.seconds - last))
    return len(times) / last, sim.weights("learnt")[2] / LARGEST


drawing, axes = plt.subplots(1, 3, figsize=(11, 3.2), sharey=True, layout="constrained")
for rate, histogram in zip((10.0, 20.0, 40.0), axes, strict=True):
    fires, weights = learn(rate)
    low, high = np.mean(weights < 0.2), np.mean(weights > 0.8)
    print(
        f"inputs of {rate:g} Hz: {fires:.1f} Hz; {low:.0%} of the weights below a fifth, {high:.0%} above four fifths"
    )
    histogram.hist(weights, np.linspace(0.0, 1.0, 21), color="0.3")
    histogram.set(title=f"inputs of {rate:g} Hz: {fires:.0f} Hz", xlabel="weight, of the largest")
axes[0].set_ylabel("synapses")
drawing.savefig("song_2000.png", dpi=100)
