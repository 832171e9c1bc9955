"""Environments of this package's networks for Gymnasium; importing this module registers them."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from neuro import ClosedLoop, ModelError

__all__ = ["Grid", "Track", "values"]

Floats = NDArray[np.float64]

ACTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""Step of each action in (rows, columns): right, down, left, up."""


class Grid(gymnasium.Env[Any, Any]):
    """A square grid with walls around; the task is to go from the first place to the last one.

    The observation is the number of the place, row by row. The actions are 0 right, 1 down, 2 left, 3 up.

    Args:
        side: number of places in a row.
        goal: reward in the last place.
        wall: reward of a move against a wall, after which the place is the same.

    Raises:
        ModelError: side is below 2.
    """

    def __init__(self, side: int = 5, goal: float = 1.0, wall: float = -0.1) -> None:
        if side < 2:
            raise ModelError(f"Grid: side = {side}: expected at least 2")
        self.observation_space, self.action_space = Discrete(side * side), Discrete(len(ACTIONS))
        self.side, self.goal, self.wall = side, goal, wall

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        """Begin in the first place."""
        super().reset(seed=seed)
        self.place = 0
        return self.place, {}

    def step(self, action: Any) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Go to the next place; return the place, the reward, and whether the goal is reached."""
        y, x = (place + move for place, move in zip(divmod(self.place, self.side), ACTIONS[int(action)], strict=True))
        if not (0 <= y < self.side and 0 <= x < self.side):
            return self.place, self.wall, False, False, {}
        self.place = y * self.side + x
        is_at_goal = self.place == self.side**2 - 1
        return self.place, self.goal if is_at_goal else 0.0, is_at_goal, False, {}


class Track(gymnasium.Env[Any, Any]):
    """A track that an animal runs along at constant speed, with a reward at the end. The only action is 0, to run.

    The observation is the covered share of the track.

    Args:
        steps: control steps of a run.
        reward: reward at the end.
    """

    observation_space, action_space = Box(0.0, 1.0, (1,), np.float64), Discrete(1)

    def __init__(self, steps: int = 230, reward: float = 100.0) -> None:
        self.steps, self.reward = steps, reward

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a run."""
        super().reset(seed=seed)
        self.position = 0
        return np.zeros(1), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Run for a step; return the position, and the reward at the end."""
        self.position += 1
        is_at_end = self.position == self.steps
        return np.array([self.position / self.steps]), self.reward * is_at_end, is_at_end, False, {}

    @staticmethod
    def expected(reward: float = 100.0) -> Floats:
        """Return the expected value after each step of the track, (200,): the reward discounted with 4000 ms."""
        return reward * np.exp(np.arange(-199.0, 1.0) * 20.0 / 4000.0)


def values(loop: ClosedLoop) -> Floats:
    """Return the value after each step of the track, (runs, 200), as the teacher of `linear_track.yaml` reads it.

    Args:
        loop: a loop that has run in a single block, with recorded spikes.
    """
    td = loop.network().world_section.reward["error"]  # type: ignore[union-attr]  # it has a world
    runs, steps = len(loop.log), loop.log.lengths[0]
    spikes = loop.sim.spikes("critic")[0]
    indices = np.ceil(spikes / 20.0).astype(int) - 1  # a spike at the end of a step belongs to it
    counts = np.bincount(indices, minlength=runs * (steps + 1))[: runs * (steps + 1)].reshape(runs, steps + 1)
    fired = counts / loop.sim.get("critic", "V_m").size
    decay = np.exp(-1.0 / np.asarray(td.smooth))
    parts, smoothed = np.zeros((runs, 2)), []
    for k in range(steps):
        parts = parts * decay + fired[:, k, None] * np.sqrt(decay)
        smoothed.append((parts[:, 0] - parts[:, 1]) / (td.smooth[0] - td.smooth[1]))
    value: Floats = (np.array(smoothed[td.wait :]).T - td.rest) / td.gain
    return value


gymnasium.register(id="neuro_models/Track-v0", entry_point=f"{__name__}:Track")
gymnasium.register(id="neuro_models/Grid-v0", entry_point=f"{__name__}:Grid")
