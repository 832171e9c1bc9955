"""One YAML file learns to fly a drone on three backends: `python drone_on_chips.py [steps]`.

`neuro_models/drone.yaml` learns by dopamine while it flies: once on the simulator `event`, once on the emulated Loihi,
once on the emulated SpiNNaker. The description is the same; `settings` are values of its parameters that a chip needs
(docs/how-to/drone.md, "On chips"). The frozen weights then fly nine laps, and a lap has its price on both chips.
Writes drone_on_chips.png.
"""

import sys
import warnings

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro_drone.energy import compute_bills
from neuro_drone.evaluate import grid, try_out
from neuro_drone.train import train

SPINNAKER = {"shifts": {"motors": [2, 0]}, "signals": {"cells_motors": 0.1}}
SETTINGS = {
    "event": {},
    "loihi": {"backend": "loihi"},
    "spinnaker": {"backend": "spinnaker", "c_min": 0, "delay": 2, "tau_c": 50, "eta": 0.4, "options": SPINNAKER},
}

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
warnings.simplefilter("ignore", neuro.ApproximationWarning)  # two spikes of a cell in 1 ms are one on Loihi
warnings.simplefilter("ignore", neuro.OverflowWarning)  # some tags and slots reach their bounds
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
models = {}
for backend, settings in SETTINGS.items():
    models[backend] = model = train("B60", steps=steps, seed=1, settings=settings)
    result = try_out(model, starts=grid(model.scenario, 3))
    print(f"{backend:9}: {result.error_px:.2f} px, {result.laps} of {result.starts} laps")
    shortest = min(len(lap.track) for lap in result.each)
    offsets = np.array([np.hypot(*lap.track[:shortest].T) for lap in result.each])
    left.plot(model.scenario.step / 1000 * np.arange(shortest), offsets.mean(axis=0), label=backend, lw=1)
left.set(xlabel="time (s)", ylabel="error (px)", title="nine laps with frozen weights, mean", yscale="log")
left.legend(frameon=False)

names = ("loihi", "spinnaker", "arm")
for place, bill in enumerate(compute_bills(models["event"], names).spiking):
    joules, lowest, highest = bill.total_j, bill.low_j, bill.high_j
    print(f"{names[place]:9}: {joules * 1e6:,.2f} uJ per control step ({lowest * 1e6:,.2f} to {highest * 1e6:,.2f})")
    right.errorbar(joules, place, xerr=[[joules - lowest], [highest - joules]], fmt="o", capsize=4)
right.set(yticks=range(len(names)), yticklabels=names, xscale="log", xlabel="energy per control step (J)")
right.set(title="price of flight", ylim=(-0.6, len(names) - 0.4))
figure.savefig("drone_on_chips.png", dpi=100)
