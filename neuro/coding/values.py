"""Values of states: the scale of rewards for a critic of spiking neurons, and the error of its predictions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from neuro.coding.world import Moment

Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]

MOST = 1.25
"""Largest magnitude of a value that the critic has to represent.

The critic's neurons are silent at a value of -1.6 and spike in each ms at 3.8.
"""
SOME = 500
"""Number of control steps over which a value or the size of errors is averaged."""


class RewardScale:
    """Scale of rewards for the critic, from rewards of random moves.

    Args:
        discount: discount of the next reward.
        scale: value of a state from which each step, for ever, has a typical reward.

    Attributes:
        factor: factor of a reward for the critic.
        first: value of all states before learning.
        known: True if the scale comes from a reward that was not 0.
    """

    def __init__(self, discount: float, scale: float = 1.0) -> None:
        self.horizon, self.scale = 1.0 / (1.0 - discount), scale
        self.factor, self.first, self.known = 1.0, 0.0, False
        self._level = 0.0

    def learn(self, rewards: Sequence[float], returns: Sequence[float] = ()) -> None:
        """Compute the scale from rewards. Nothing changes if all rewards are 0.

        A state from which each step, for ever, has a typical reward gets the value `scale`. Rewards are rare if fewer
        than half of the steps have one. Then `scale` is the value of as many typical rewards as occur within the
        horizon or within an episode, whichever is fewer, but of at least one.

        The value of all states before learning is the value of random moves, at least 0, because a value that is too
        high makes an agent explore. If rewards are rare, the value before learning is at most the best return: a goal
        that ends the episode must not have a lower value than the states before the goal.

        Args:
            rewards: rewards of control steps.
            returns: returns of the episodes that have ended.
        """
        all_rewards = np.asarray(rewards, dtype=np.float64)
        nonzero = all_rewards[all_rewards != 0.0]
        if not nonzero.size:
            return
        density, steps, limit = nonzero.size / all_rewards.size, self.horizon, math.inf
        if density < 0.5:
            steps = max(1.0, min(density * self.horizon, nonzero.size / max(1, len(returns))))
            limit = max(0.0, float(nonzero.max()), *returns)
        self.factor = self.scale / (float(np.median(np.abs(nonzero))) * steps)
        self.first = max(0.0, self.factor * min(limit, float(all_rewards.mean()) * self.horizon))
        self.known = True

    def begin(self) -> None:
        """Begin a block of training."""
        self._level = 0.0

    def excess(self, values: Sequence[float], rewards: Floats) -> float:
        """Return the factor by which rewards and values have to shrink after a control step, 1 for no change.

        Random moves do not show the rewards of a good policy. Therefore rewards and values shrink during training: the
        average value to half of MOST if the average exceeds MOST, and the largest reward to MOST if a reward exceeds
        MOST. Dopamine neurons adapt to the range of rewards, too (Tobler, Fiorillo & Schultz, Science 307:1642, 2005).

        Args:
            values: values of the states, (copies,).
            rewards: rewards of the environments, (copies,).
        """
        # For the few numbers of a control step, lists are faster than reductions of arrays.
        self._level += (sum(values) / len(values) - self._level) / SOME
        level, largest = abs(self._level), self.factor * max(map(abs, rewards.tolist()))
        return min(MOST / 2.0 / level if level > MOST else 1.0, MOST / largest if largest > MOST else 1.0)

    def shrink(self, share: float) -> None:
        """Multiply the scale of rewards, and the values, by `share`."""
        self.factor, self.first, self._level = self.factor * share, self.first * share, self._level * share


class TemporalDifference:
    """Error of predicted values: reward + discount V(now) - V(before); 0 at the beginning of an episode.

    Values are lists of Python, which for the few copies of a network are faster than arrays of NumPy.

    Args:
        scale: scale of the rewards.
        discount: factor on the value one control step later.
        adapts: whether the scale is learnt from the rewards, and shrinks if values exceed their range.

    Attributes:
        reward: scaled reward of the last control step, one for each copy.
    """

    def __init__(self, scale: RewardScale, discount: float, adapts: bool = True) -> None:
        self._scale, self._discount, self._adapts = scale, discount, adapts
        self.begin(1)

    def begin(self, copies: int) -> None:
        """Begin a block of training with a number of copies."""
        self._scale.begin()
        self.reward, self._value, self._ended = [0.0] * copies, [0.0] * copies, [False] * copies

    def errors(self, values: list[float], moment: Moment) -> list[float]:
        """Return the errors of the predictions one control step ago.

        Args:
            values: values of the present states, which the errors need as V(now).
            moment: the present control step.
        """
        per_copy = zip(self.reward, values, self._ended, self._value, moment.first.tolist(), strict=True)
        # V(now) is 0 after the end of an episode, but not after a cut-off. The first step of an episode has no error.
        errors = [
            (reward + self._discount * value * (not ended) - before) * (not first)
            for reward, value, ended, before, first in per_copy
        ]
        self._value, self._ended = values, moment.ended.tolist()
        return errors

    def share(self, moment: Moment) -> float:
        """Adapt the scale to the rewards of a control step. Return the factor on the critic's weights, or 1."""
        scale, share = self._scale, 1.0
        if self._adapts:
            if not scale.known and moment.rewards.any():  # the first rewards other than 0
                rewards = moment.rewards[~moment.last]
                scale.learn([0.0] * (moment.steps - rewards.size) + rewards.tolist(), moment.returns)
            share = scale.excess(self._value, moment.rewards)
            if share < 1.0:
                self._value = [value * share for value in self._value]
        return share

    def take(self, moment: Moment) -> None:
        """Store the rewards of the control step in the present scale, for the next errors."""
        self.reward = [reward * self._scale.factor for reward in moment.rewards.tolist()]


class Novelty:
    """Reward for rare states: the mean over active places of scale / sqrt(n), with n activations of the place.

    Dopamine neurons respond to new stimuli, less with each repetition (Kakade & Dayan, Neural Networks 15:549, 2002).
    The formula comes from Strehl & Littman, J. Comput. Syst. Sci. 74:1309, 2008.

    Args:
        scale: reward of a state that has not been seen.

    Attributes:
        counts: number of activations of each place, (places,).
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self.counts: Ints = np.zeros(0, dtype=np.int64)

    def join(self, cells: Callable[[Floats], Ints], size: int) -> None:
        """Start counting. `cells` returns the active places of an observation, and there are `size` places."""
        self._cells, self.counts = cells, np.zeros(size, dtype=np.int64)

    def of(self, observations: Floats) -> list[float]:
        """Count the places of observations, (copies, dimensions), and return the reward of each observation."""
        rewards = []
        for vector in observations:
            cells = self._cells(vector)
            self.counts[cells] += 1
            rewards.append(self._scale * float((1.0 / np.sqrt(self.counts[cells])).sum()) / cells.size)
        return rewards


class ErrorScale:
    """Scale of errors. Errors scaled to one size let the same learning rate fit any task.

    Args:
        size: root mean square of the scaled errors; None for unscaled errors.

    Attributes:
        scales: True if errors are scaled to a size.
    """

    def __init__(self, size: float | None) -> None:
        self._size, self.scales = size, size is not None
        self.begin()

    def begin(self) -> None:
        """Begin a block of training and measure the size of errors again."""
        self._count, self._square = 0, 0.0

    def of(self, errors: Floats) -> Floats:
        """Return the scaled errors of all copies in a control step."""
        if self._size is None:
            return errors
        self._count = min(self._count + 1, SOME)
        self._square += (float(np.mean(errors**2)) - self._square) / self._count
        return errors * (self._size / math.sqrt(max(self._square, 1e-12)))
