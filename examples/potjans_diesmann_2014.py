"""The spontaneous activity of a cortical column: eight populations of four layers, each with a rate of its own.

Rates are printed beside those of the reference implementation at full scale. Source: Potjans & Diesmann, Cereb. Cortex
24:785, 2014, figure 6; rates: INM-6/microcircuit-PD14-model. The network is `microcircuit.yaml` of `neuro_models`.
All of it needs 2.2 GB. Writes potjans_diesmann_2014.png.
"""

import argparse

import matplotlib.pyplot as plt

import neuro
import neuro_models
from neuro import plots

RATES = {  # Hz
    "L23E": 0.90, "L23I": 2.97, "L4E": 4.41, "L4I": 5.88, "L5E": 7.57, "L5I": 8.63, "L6E": 1.11, "L6I": 7.83,
}  # fmt: skip
BEGIN = 500.0  # ms

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--scale", type=float, default=1.0, help="of neurons and inputs")
options.add_argument("--ms", type=float, default=1000.0, help="measured, after 500 ms")
asked = options.parse_args()

network = neuro.load(neuro_models.path("microcircuit"), {"scale": asked.scale})
sim = neuro.compile(network, seed=1)
sim.run(BEGIN + asked.ms)
print("population  neurons  rate, Hz  published")
for name, published in RATES.items():
    times, _ = sim.spikes(name, since=BEGIN)
    size = len(network.populations[name])
    print(f"{name:10}  {size:7,}  {len(times) / size / asked.ms * 1000.0:8.2f}  {published:9.2f}")

figure, axis = plt.subplots(figsize=(8, 6), layout="constrained")
plots.raster(sim, of=list(RATES)[::-1], window=(BEGIN, BEGIN + min(asked.ms, 400.0)), ax=axis)
figure.savefig("potjans_diesmann_2014.png", dpi=100)
