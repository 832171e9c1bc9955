"""A light swings to and fro before a camera that turns: an environment of Gymnasium."""

import gymnasium
import numpy as np

COLUMNS = np.arange(8) - 3.5  # positions of the columns of cells, px from the middle


class Light(gymnasium.Env):
    """A camera sees 8 x 8 cells, and turns by the action in px. The reward grows as the light comes nearer."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (8, 8), np.float64)
    action_space = gymnasium.spaces.Box(-2.0, 2.0, (1,), np.float64)

    def reset(self, *, seed=None, options=None):
        """Begin an episode, with the light somewhere on its way."""
        super().reset(seed=seed)
        self.steps, self.heading = int(self.np_random.integers(60)), 0.0
        self.end = self.steps + 200
        return self._look()

    def step(self, action):
        """Turn the camera. Return observation, reward, terminated, truncated and info."""
        self.heading += float(action[0])
        self.steps += 1
        observation, info = self._look()
        return observation, 1.0 - abs(info["offset"]) / 3.5, False, self.steps >= self.end, info

    def _look(self):
        light = 3.0 * np.sin(2.0 * np.pi * self.steps / 60.0)
        offset = float(np.clip(light - self.heading, -3.5, 3.5))
        return np.tile(np.exp(-0.5 * (COLUMNS - offset) ** 2), (8, 1)), {"offset": offset}
