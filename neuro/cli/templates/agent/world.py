"""A room with a heater, as an environment of gymnasium: keep the room at 20 degrees in any weather."""

import gymnasium
import numpy as np
from gymnasium import spaces

AIM = 20.0  # goal, degrees


class Room(gymnasium.Env):
    """A room that loses 5 % of its difference to the weather in each step, and gains heat from the heater."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}
    observation_space = spaces.Box(np.array([10.0, 0.0], np.float32), np.array([30.0, 10.0], np.float32))
    action_space = spaces.Discrete(3)  # off, half, full

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        """Begin an episode."""
        super().reset(seed=seed)  # seeds self.np_random
        self.room, self.weather = self.np_random.uniform(12.0, 28.0), self.np_random.uniform(0.0, 10.0)
        self.steps = 0
        return self._observation(), {}

    def step(self, action):
        """Heat for a step. Return observation, reward, terminated, truncated and info."""
        self.room += 0.05 * (self.weather - self.room) + 0.8 * action + self.np_random.normal(0.0, 0.1)
        self.steps += 1
        reward = float(abs(self.room - AIM) < 1.0)
        return self._observation(), reward, False, self.steps == 100, {}

    def _observation(self):
        values = np.array([self.room, self.weather], np.float32)
        return np.clip(values, self.observation_space.low, self.observation_space.high)

    def render(self):
        """Return a picture of a thermometer from 10 to 30 degrees, with a line at the goal."""
        picture = np.full((100, 60, 3), 245, np.uint8)
        picture[99 - round(np.clip(5 * (self.room - 10.0), 0, 99)) :, 20:40] = (208, 52, 44)
        picture[99 - round(5 * (AIM - 10.0)), 10:50] = 0
        return picture
