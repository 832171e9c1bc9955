"""A neuron as text: FitzHugh and Nagumo's equations, over time and in the phase plane.

The text is parsed, checked for units and compiled; no code in it is run. Source: FitzHugh, Biophys. J. 1:445, 1961.
Writes equations.png.
"""

import matplotlib.pyplot as plt
import numpy as np

import neuro

fitzhugh_nagumo = neuro.equations(
    "fitzhugh_nagumo",
    equations={
        "V_m": "(V_m - V_m^3 / (3 * mv^2) - w + drive) / tau",
        "w": "(V_m + a - b * w) / tau_w",
    },
    parameters={"mv": "1 mV", "tau": "1 ms", "tau_w": "12.5 ms", "a": "0.7 mV", "b": 0.8, "drive": "0 mV"},
    initial={"V_m": "-1.2 mV", "w": "-0.62 mV"},
    integrator={"rk4": {"substeps": 4}},
)

drives = np.array([0.2, 0.35, 0.8])  # mV; the neuron has no threshold: an action potential is a way round
net = neuro.Network("excitable", resolution=0.1)
net.population("cells", 3, fitzhugh_nagumo(drive=drives.tolist()))
net.probe("state", "cells", ["V_m", "w"], every=0.1)
sim = neuro.compile(net)
sim.run(300.0)
times, recorded = sim.trace("state")
rises = (np.diff((recorded["V_m"] > 1.0).astype(int), axis=0) == 1).sum(0)
for drive, count in zip(drives, rises, strict=True):
    print(f"drive {drive:g} mV: {count} action potentials in 300 ms")

figure, (trace, plane) = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained", width_ratios=(2, 1))
for cell, drive in enumerate(drives):
    trace.plot(times, recorded["V_m"][:, cell] + 5 * cell, label=f"drive {drive:g} mV")
    plane.plot(recorded["V_m"][:, cell], recorded["w"][:, cell])
trace.set(xlabel="ms", yticks=[], ylabel="V_m")
trace.set_xlim(0, 400)
trace.legend(frameon=False, loc="center right")
v = np.linspace(-2.2, 2.2, 100)
plane.plot(v, v - v**3 / 3 + drives[-1], "0.7", linestyle="--")
plane.plot(v, (v + 0.7) / 0.8, "0.7", linestyle="--")
plane.set(xlabel="V_m, mV", ylabel="w, mV", ylim=(-1.5, 2.2))
figure.savefig("equations.png", dpi=100)
