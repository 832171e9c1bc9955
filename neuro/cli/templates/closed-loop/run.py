"""A light swings to and fro; every 50 ms the camera looks, moves and is rewarded. Next: python -m pytest."""

from pathlib import Path

import numpy as np

import neuro

NETWORK = Path(__file__).with_name("network.yaml")
COLUMNS = np.arange(8) - 3.5  # of the camera's cells, px from the middle
SIDES = np.array([-1, 1, -1, 1])  # direction in which each motor turns


def follow(steps=1000, dopamine=0.002, seed=1):
    """The distance of the light from the middle of the picture in each step, px: (steps,)."""
    sim = neuro.compile(neuro.load(NETWORK), seed=seed)
    heading, errors = 0.0, np.zeros(steps)
    for step in range(steps):
        light = 3.0 * np.sin(2.0 * np.pi * step / 60.0)
        errors[step] = abs(light - heading)
        offset = np.clip(light - heading, -3.5, 3.5)
        sim.set("cells", rate=np.tile(60.0 * np.exp(-0.5 * (COLUMNS - offset) ** 2), 8))  # Hz
        sim.signal("reward", dopamine * offset * SIDES)  # a motor that turns towards the light is rewarded
        begin = sim.time
        sim.run(50.0)  # ms
        _, motors = sim.spikes("motors", since=begin)
        heading += 0.1 * SIDES[motors].sum()
    return errors


if __name__ == "__main__":
    errors = follow()
    print(f"error of the first 100 steps {errors[:100].mean():.2f} px, of the last {errors[-100:].mean():.2f} px")
