"""Four regimes of a network of sparsely connected neurons, by the strength of inhibition and of the external drive.

All neurons fire in step (SR), or irregularly: together in fast or slow waves (SI), or each for itself (AI). Rates and
waves are printed beside those of the paper's table 1. Source: Brunel, J. Comput. Neurosci. 8:183, 2000, figure 8:
10,000 excitatory and 2,500 inhibitory neurons of model A. Writes brunel_2000.png.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import neuro

EXCITATORY, INPUTS = 10_000, 1_000  # and excitatory inputs of a neuron; a quarter as many inhibit
DELAY = 1.5  # ms
REGIMES = {  # letter: regime, g, external drive, rate and wave of the paper, Hz
    "A": ("SR", 3.0, 2.0, "", ""),
    "B": ("SI fast", 6.0, 4.0, 60.7, 180.0),
    "C": ("AI", 5.0, 2.0, 37.7, ""),
    "D": ("SI slow", 4.5, 0.9, 5.5, 22.0),
}


def network(g: float, drive: float, scale: float) -> neuro.Network:
    """Neurons of one kind, of which a fifth inhibit, `g` times as strongly.

    Args:
        g: weight of an inhibitory synapse to that of an excitatory one.
        drive: rate of the external inputs, in that which leads to the threshold in the mean.
        scale: of neurons and inputs, with stronger synapses.
    """
    size, inputs = int(scale * EXCITATORY), int(scale * INPUTS)
    weight = 0.1 / scale  # mV
    external = drive * 20.0 / (weight * 20e-3)  # Hz: that of all its external inputs leads to 20 mV in 20 ms
    net = neuro.Network("brunel", resolution=0.1)
    neuron = neuro.iaf_psc_delta(tau_m=20.0, t_ref=2.0, E_L=0.0, V_reset=10.0, V_th=20.0)
    for name, count in (("exc", size), ("inh", size // 4)):
        net.population(name, count, neuron)
        net.population(f"to_{name}", count, neuro.poisson_generator(rate=external))
        net.connect(f"to_{name}", name, neuro.one_to_one(), weight=weight, delay=DELAY)
    for target in ("exc", "inh"):
        net.connect("exc", target, neuro.fixed_indegree(inputs), weight=weight, delay=DELAY)
        net.connect("inh", target, neuro.fixed_indegree(inputs // 4), weight=-g * weight, delay=DELAY)
    return net


def wave(counts: np.ndarray) -> float:
    """The frequency between 10 and 500 Hz at which the power of all spikes peaks; counts are those of each ms."""
    power = np.convolve(np.abs(np.fft.rfft(counts - counts.mean())) ** 2, np.ones(5), mode="same")
    at = np.fft.rfftfreq(len(counts), 1e-3)
    inside = (at > 10.0) & (at < 500.0)
    return float(at[inside][power[inside].argmax()])


def irregularity(times: np.ndarray, ids: np.ndarray) -> float:
    """The mean coefficient of variation of the intervals of a hundred neurons."""
    intervals = (np.diff(times[ids == neuron]) for neuron in range(100))
    return float(np.mean([each.std() / each.mean() for each in intervals if len(each) > 2]))


options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--ms", type=float, default=1000.0, help="measured, after 200 ms")
options.add_argument("--scale", type=float, default=1.0, help="of neurons and inputs")
asked = options.parse_args()

drawing, axes = plt.subplots(2, 4, figsize=(12, 5), sharex="col", height_ratios=(2, 1), layout="constrained")
print("regime    rate, Hz (paper)  wave, Hz (paper)    CV")
for (letter, (name, g, drive, paper_rate, paper_wave)), (raster, activity) in zip(REGIMES.items(), axes.T, strict=True):
    sim = neuro.compile(network(g, drive, asked.scale), seed=1)
    sim.run(200.0 + asked.ms)
    times, ids = sim.spikes("exc", since=200.0)
    bins = np.arange(200.0, 200.5 + asked.ms, 1.0)
    counts = np.histogram(times, bins)[0]
    rates = counts / (asked.scale * EXCITATORY) * 1000.0
    found = f"{rates.mean():8.1f} ({paper_rate:>4})  {wave(counts) if paper_wave else '-':>8} ({paper_wave:>3})"
    print(f"{letter} {name:8}{found}  {irregularity(times, ids):10.2f}")
    end = 200.0 + asked.ms
    shown = (ids < 50) & (times > end - 200.0)
    raster.plot(times[shown], ids[shown], "k.", markersize=1.5)
    raster.set(title=f"{letter}: {name}\ng = {g:g}, drive {drive:g}", ylim=(-1, 50))
    activity.bar(bins[1:], rates, width=1.0, color="k")
    activity.set(xlim=(end - 200.0, end), xlabel="ms")
axes[0, 0].set_ylabel("neuron")
axes[1, 0].set_ylabel("rate, Hz")
drawing.savefig("brunel_2000.png", dpi=100)
