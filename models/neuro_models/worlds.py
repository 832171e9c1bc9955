"""Worlds of this package's networks, as environments of Gymnasium; importing this module registers them."""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium.spaces import Discrete

from neuro import ModelError

__all__ = ["Grid"]

ACTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""Rows and columns that an action leads on: right, down, left, up."""


class Grid(gymnasium.Env[Any, Any]):
    """A square of places with walls around; the way leads from the first place to the last one.

    The observation is the number of the place, row by row. The actions are 0 right, 1 down, 2 left, 3 up.

    Args:
        side: places in a row.
        goal: reward in the last place.
        wall: reward of a move against a wall, which leads nowhere.

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
        """Go to the next place; return it, the reward, and whether it is the goal."""
        y, x = (at + on for at, on in zip(divmod(self.place, self.side), ACTIONS[int(action)], strict=True))
        if not (0 <= y < self.side and 0 <= x < self.side):
            return self.place, self.wall, False, False, {}
        self.place = y * self.side + x
        there = self.place == self.side**2 - 1
        return self.place, self.goal if there else 0.0, there, False, {}


gymnasium.register(id="neuro_models/Grid-v0", entry_point=f"{__name__}:Grid")
