"""A network of one's own flies the drone: `python drone_own_network.py [steps]`.

Any YAML file with 64 Poisson generators `cells` and 4 neurons `motors` will do; what learns by a signal to the motors
receives the error of its axis. This one, `drone_own_network.yaml`, lets the two motors of an axis inhibit each other.
On the command line: `neuro drone train --set network=drone_own_network.yaml`.
"""

import sys
from pathlib import Path

from neuro_drone.evaluate import grid, try_out
from neuro_drone.train import train

NETWORK = Path(__file__).with_name("drone_own_network.yaml")

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 6_000
model = train("B60", steps=steps, seed=0, settings={"network": str(NETWORK)})
tried = try_out(model, starts=grid(model.scenario, 2))
print(f"after {steps} steps, weights frozen: {tried.error_px:.1f} px, {tried.laps} of {tried.starts} laps")
for name, weights in model.learnt.items():
    print(f"{name}: {weights.size} weights from {weights.min():.0f} to {weights.max():.0f} pA")
