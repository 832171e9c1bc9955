"""Actions as choices: for each number of an action circuits of neurons; the ones that spike are what is done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from neuro import ModelError
from neuro_agent.observations import BOUNDLESS

__all__ = ["Actions", "actions_of"]

EXPECTED = "Discrete, MultiDiscrete, MultiBinary, or a Box with finite bounds"
MOST = 64
"""Neurons of a circuit, see `neuro.soft_wta`."""


@dataclass(frozen=True)
class Actions:
    """What the neurons that spike mean.

    Attributes:
        sizes: neurons of each circuit.
        space: of the actions.
        values: of a Box, what the neurons of each circuit stand for; of one of whole numbers the action is the nearest.
    """

    sizes: tuple[int, ...]
    space: gymnasium.Space[Any]
    values: tuple[npt.NDArray[np.float64], ...] = ()

    def of(self, winners: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
        """The actions of the winners of each circuit, (copies, circuits); the first axis is that of the copies."""
        if isinstance(self.space, spaces.Box):
            chosen = np.stack([values[winners[:, k]] for k, values in enumerate(self.values)], axis=1)
            means = chosen.reshape(len(chosen), *self.space.shape, -1).mean(axis=-1)
            # Means of equal numbers are rounded, and so may lie beyond the bound.
            winners = np.clip(means, self.space.low, self.space.high)
            if np.issubdtype(self.space.dtype, np.integer):
                winners = np.rint(winners)
        elif isinstance(self.space, (spaces.Discrete, spaces.MultiDiscrete)):
            winners = winners + np.ravel(self.space.start)
        return winners.reshape(-1, *(self.space.shape or ())).astype(self.space.dtype, copy=False)


def actions_of(space: gymnasium.Space[Any], levels: int, circuits: int = 1) -> Actions:
    """The circuits for a space of actions.

    Args:
        space: of the actions.
        levels: neurons of each circuit of a Box, between its bounds.
        circuits: for each number of a Box, which is the mean of what they choose.

    Raises:
        ModelError: it is of another kind, has no bounds, or needs more neurons than a circuit has.
    """
    found = _actions(space, levels, circuits)
    if max(found.sizes, default=0) > MOST:
        raise ModelError(f"action space {space}: {max(found.sizes)} actions: expected at most {MOST}")
    if not found.sizes:
        raise ModelError(f"action space {space}: it is empty: expected {EXPECTED}")
    return found


def _actions(space: gymnasium.Space[Any], levels: int, circuits: int) -> Actions:
    match space:
        case spaces.Discrete():
            return Actions((int(space.n),), space)
        case spaces.MultiDiscrete():
            return Actions(tuple(int(n) for n in np.ravel(space.nvec)), space)
        case spaces.MultiBinary():
            return Actions((2,) * int(np.prod(space.shape)), space)
        case spaces.Box():
            ends = [np.ravel(each).astype(np.float64) for each in (space.low, space.high)]
            if np.abs(ends).max(initial=0.0) >= BOUNDLESS:
                raise ModelError(
                    f"action space {space}: it has no bounds, or one beyond {BOUNDLESS:,.0f}: expected {EXPECTED}",
                    hint="a wrapper gives it others: gymnasium.wrappers.TransformAction",
                )
            values = tuple(
                np.linspace(low, high, levels) for low, high in zip(*ends, strict=True) for _ in range(circuits)
            )
            return Actions((levels,) * len(values), space, values)
    raise ModelError(f"action space: found {type(space).__name__}: expected {EXPECTED}")
