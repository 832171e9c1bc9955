"""A drone's network that learns by its own dopamine, without a host: `python loop_without_host.py [steps]`.

In `neuro_models/loop.yaml` each event of the camera is a spike of its pixel, spikes of the motors are the action, and
dopaminergic neurons fire by the reward less the expectation of a critic. No program computes an error or a reward.
After each fourth of the training the weights are frozen, the babbling neurons are cut off, and the drone flies four
laps. Writes loop_without_host.png.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import neuro
import neuro_models
from neuro_drone.evaluate import ENDLESS, Flights, fly_lap, grid, reset_arguments
from neuro_drone.scenario import load

PATH = neuro_models.path("loop")
SCENARIO = load("B60")


def flown(weights):
    """Return the mean error of four laps with frozen weights, px, and the loop that flew them."""
    learnt = neuro.closed_loop(neuro.load(PATH, params={"babble": 0.0}))
    learnt.pilot.put({"learnt": weights})
    places = grid(SCENARIO, 2)
    env = Flights(SCENARIO, (reset_arguments(place, index) for index, place in enumerate(places)))
    loop = neuro.closed_loop(learnt.network(frozen=True), env, learns=False, block=ENDLESS)
    return np.mean([fly_lap(loop, env, place).error_px for place in places]), loop


steps = int(sys.argv[1]) if len(sys.argv) > 1 else 40_000
training = neuro.closed_loop(neuro.load(PATH), seed=3)
numbers, errors = [0], [flown(training.pilot.weights)[0]]
for number in range(steps // 4, steps + 1, steps // 4):
    training.run(steps=number)
    error, flight = flown(training.pilot.weights)
    numbers.append(number)
    errors.append(error)
    print(f"after {number:,} steps {error:.1f} px")
host = [item for item in flight.sim.energy("loihi").items if item.what == "host"]
print(f"operations of a host in flight: {sum(item.count for item in host):,.0f}")

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
left.plot(np.array(numbers) / 1000, errors, "o-")
left.set(xlabel="thousand control steps", ylabel="error of frozen weights (px)", title="four laps", yscale="log")
onto = training.pilot.weights["columns_motors_x"].reshape(15, -1, 2).mean(axis=1)
for motor, name in enumerate(("positive", "negative")):
    right.plot(np.arange(15) - 7, onto[:, motor], marker="o", label=f"{name} motor")
right.set(xlabel="field (from the middle)", ylabel="weight (pA)", title="learnt weights of the columns onto")
right.set_ylim(top=1600)
right.legend(frameon=False, loc="upper center", ncols=2)
figure.savefig("loop_without_host.png", dpi=100)
