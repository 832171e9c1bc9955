"""A camera learns to follow a light: rates in, spikes out, reward back, every 50 ms.

An 8 x 8 camera sees a light that swings to and fro. One motor turns the camera right, one left; at first both do the
same. The dopamine of a motor is positive while it turns towards the light and negative while it turns away; STDP does
the rest. The network and how it meets its world are `follower.yaml`, the world is the class `Light`. What was learnt
is frozen, acts on a float simulator and on Loihi, and has its price. Writes follower.png.
"""

import warnings
from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np

import neuro

COLUMNS = np.arange(8) - 3.5  # where each column of the camera looks, px


class Light(gymnasium.Env):
    """The camera turns by the action, px; the reward is higher the nearer the light."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (8, 8), np.float64)
    action_space = gymnasium.spaces.Box(-2.0, 2.0, (1,), np.float64)

    def reset(self, *, seed=None, options=None):
        """Begin somewhere on the light's way."""
        super().reset(seed=seed)
        self.steps, self.heading = int(self.np_random.integers(60)), 0.0
        self.end = self.steps + 200
        return self._look()

    def step(self, action):
        """Turn by the action."""
        self.heading, self.steps = self.heading + float(action[0]), self.steps + 1
        seen, info = self._look()
        return seen, 1.0 - abs(info["offset"]) / 3.5, False, self.steps >= self.end, info

    def _look(self):
        light = 3.0 * np.sin(2.0 * np.pi * self.steps / 60.0)
        offset = float(np.clip(light - self.heading, -3.5, 3.5))
        return np.tile(np.exp(-0.5 * (COLUMNS - offset) ** 2), (8, 1)), {"offset": offset}


def main() -> None:
    """Learn, freeze, act on two backends, and draw."""
    loop = neuro.closed_loop(neuro.load(Path(__file__).with_name("follower.yaml")), Light, seed=1)
    returns = loop.run(steps=2000).returns
    print(f"return of the first episode {returns[0]:.1f} of 200, of the last {returns[-1]:.1f}")
    weights, frozen = loop.sim.weights("cells_motors")[2].reshape(8, 8, 2).mean(axis=0), loop.network(frozen=True)
    warnings.simplefilter("ignore", neuro.ApproximationWarning)  # two spikes of a cell in 1 ms are one on Loihi
    for backend in ("event", "loihi"):
        acting = neuro.closed_loop(frozen, Light, backend=backend, learns=False)
        print(f"frozen on {backend}: {acting.test(episodes=5)}")
    step_uj = 1e6 * acting.sim.energy("loihi").total_j / (acting.sim.time / 50.0)
    print(f"Loihi takes {step_uj:.1f} uJ for a control step")

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
    left.plot(returns, "o-")
    left.set(xlabel="episode", ylabel="return", title="how near the camera stays to the light")
    for motor, name in enumerate(("right", "left")):
        right.plot(COLUMNS, weights[:, motor], marker="o", label=f"onto the {name} motor")
    right.set(xlabel="column (px from the middle)", ylabel="mean weight (pA)", title="learnt weights", ylim=(0, 800))
    right.legend(frameon=False, loc="lower center", ncols=2)
    figure.savefig("follower.png", dpi=100)


if __name__ == "__main__":
    main()
