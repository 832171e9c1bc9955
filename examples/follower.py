"""A camera learns to follow a light: rates in, spikes out, reward back, every 50 ms.

An 8 x 8 camera sees a light that swings to and fro. Two motors turn the camera left, two turn it right. At first
all do the same. The reward of a motor is positive while it turns towards the light and negative while it turns
away; dopamine STDP does the rest. The network is `follower.yaml`.
Writes follower.png.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import neuro

COLUMNS = np.arange(8) - 3.5  # where each column of the camera looks, px
SIDES = np.array([-1, 1, -1, 1])  # which way each motor turns

sim = neuro.compile(neuro.load(Path(__file__).with_name("follower.yaml")), seed=1)
heading, errors = 0.0, []
for step in range(1000):
    light = 3.0 * np.sin(2.0 * np.pi * step / 60.0)
    offset = np.clip(light - heading, -3.5, 3.5)
    errors.append(abs(light - heading))

    sim.set("cells", rate=np.tile(60.0 * np.exp(-0.5 * (COLUMNS - offset) ** 2), 8))
    sim.signal("reward", 0.002 * offset * SIDES)
    begin = sim.time
    sim.run(50.0)
    _, motors = sim.spikes("motors", since=begin)
    heading += 0.1 * SIDES[motors].sum()
    sim.forget(before=sim.time)

print(f"error in the first 100 steps {np.mean(errors[:100]):.2f} px, in the last 100 {np.mean(errors[-100:]):.2f} px")
_, _, weight = sim.weights("cells_motors")
left_to_right = weight.reshape(8, 8, 4).mean(axis=0)
print("weights by column onto a left and a right motor, pA:")
print(left_to_right[:, :2].T.round(0))

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
left.plot(0.05 * np.arange(1000), errors, linewidth=0.7)
left.set(xlabel="time (s)", ylabel="error (px)", title="the camera behind the light")
for motor, name in enumerate(("left", "right")):
    right.plot(COLUMNS, left_to_right[:, motor], marker="o", label=f"onto a {name} motor")
right.set(xlabel="column (px from the middle)", ylabel="mean weight (pA)", title="what it has learnt")
right.legend(frameon=False)
figure.savefig("follower.png", dpi=100)
