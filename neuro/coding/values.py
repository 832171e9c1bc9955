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
"""The largest magnitude of a value: at -1.6 the neurons of the critic fall silent, at 3.8 they spike in each ms."""
SOME = 500
"""Control steps over which a value, or the size of errors, is averaged."""


class RewardScale:
    """Scale of rewards for the critic, from rewards of random moves.

    Args:
        discount: discount of the next reward.
        scale: value of a typical reward in each step, for ever.

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
        """Take the scale from rewards, of which one is not 0.

        A typical reward in each step, for ever, is to be a value of `scale`. Where rewards are rare, only as many count
        as come within the horizon, and within an episode. States are worth at first what random moves bring, if that is
        more than nothing: a value that is too high makes an agent try what it has not tried. Where rewards are rare it
        is at most the best return, since a goal that ends the episode must not be worth less than to go on.

        Args:
            rewards: of control steps.
            returns: of the episodes that have ended.
        """
        array = np.asarray(rewards, dtype=np.float64)
        some = array[array != 0.0]
        if not some.size:
            return
        dense, steps, most = some.size / array.size, self.horizon, math.inf
        if dense < 0.5:
            steps = max(1.0, min(dense * self.horizon, some.size / max(1, len(returns))))
            most = max(0.0, float(some.max()), *returns)
        self.factor = self.scale / (float(np.median(np.abs(some))) * steps)
        self.first = max(0.0, self.factor * min(most, float(array.mean()) * self.horizon))
        self.known = True

    def begin(self) -> None:
        """Begin a block of training."""
        self._level = 0.0

    def excess(self, values: Sequence[float], rewards: Floats) -> float:
        """Return the factor by which rewards and values have to shrink after a control step, 1 for no change.

        Random moves do not show the rewards of a good policy. So rewards shrink to half of MOST when values exceed
        MOST, and to MOST when one reward exceeds it. Dopamine neurons adapt to the range of rewards, too (Tobler,
        Fiorillo & Schultz, Science 307:1642, 2005).

        Args:
            values: values of the states, (copies,).
            rewards: rewards of the environments, (copies,).
        """
        # Of the few numbers of a control step, lists are faster than reductions of arrays.
        self._level += (sum(values) / len(values) - self._level) / SOME
        level, largest = abs(self._level), self.factor * max(map(abs, rewards.tolist()))
        return min(MOST / 2.0 / level if level > MOST else 1.0, MOST / largest if largest > MOST else 1.0)

    def shrink(self, share: float) -> None:
        """Let rewards be this share of what they were."""
        self.factor, self.first, self._level = self.factor * share, self.first * share, self._level * share


class TemporalDifference:
    """The error of predicted values: reward + discount V(now) - V(before), 0 at the begin of an episode.

    Values of the few copies of a control step are lists, with which Python is faster than calls of numpy.

    Args:
        scale: of the rewards.
        discount: of the value one control step later.
        adapts: whether the scale is learnt from the rewards, and shrinks where values come to exceed their range.

    Attributes:
        reward: of the last control step, as the critic learns it, one for each copy.
    """

    def __init__(self, scale: RewardScale, discount: float, adapts: bool = True) -> None:
        self._scale, self._discount, self._adapts = scale, discount, adapts
        self.begin(1)

    def begin(self, copies: int) -> None:
        """Begin a block of so many copies."""
        self._scale.begin()
        self.reward, self._value, self._ended = [0.0] * copies, [0.0] * copies, [False] * copies

    def errors(self, values: list[float], moment: Moment) -> list[float]:
        """Return the errors of the last control step but one from the values of the present states."""
        each = zip(self.reward, values, self._ended, self._value, moment.first.tolist(), strict=True)
        # What a state is worth follows a cut-off, and nothing an end; of what has just begun nothing is known.
        errors = [
            (reward + self._discount * value * (not ended) - before) * (not first)
            for reward, value, ended, before, first in each
        ]
        self._value, self._ended = values, moment.ended.tolist()
        return errors

    def share(self, moment: Moment) -> float:
        """Take the reward of the control step; return the factor on what the critic has learnt, 1 for no change."""
        scale, share = self._scale, 1.0
        if self._adapts:
            if not scale.known and moment.rewards.any():  # the scale is that of the first rewards: all before were 0
                first = moment.rewards[~moment.last]
                scale.learn([0.0] * (moment.steps - first.size) + first.tolist(), moment.returns)
            share = scale.excess(self._value, moment.rewards)
            if share < 1.0:
                self._value = [value * share for value in self._value]
        return share

    def take(self, moment: Moment) -> None:
        """Keep the reward of the control step in the scale of now, for the next errors."""
        self.reward = [reward * self._scale.factor for reward in moment.rewards.tolist()]


class Novelty:
    """A reward for what has seldom been seen: the mean of scale / sqrt(n), n how often each active place has been.

    Dopamine neurons respond to what is new, less with each time (Kakade & Dayan, Neural Networks 15:549, 2002). The
    form is that of Strehl & Littman, J. Comput. Syst. Sci. 74:1309, 2008.

    Args:
        scale: the reward of a state that has not been seen.

    Attributes:
        counts: how often each place has been active, (places,).
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self.counts: Ints = np.zeros(0, dtype=np.int64)

    def join(self, cells: Callable[[Floats], Ints], size: int) -> None:
        """Count from now on the active places of an observation, `cells` of it, of `size` places."""
        self._cells, self.counts = cells, np.zeros(size, dtype=np.int64)

    def of(self, observations: Floats) -> list[float]:
        """The reward of each observation, (copies, dimensions), each of which has been seen once more then."""
        rewards = []
        for vector in observations:
            cells = self._cells(vector)
            self.counts[cells] += 1
            rewards.append(self._scale * float((1.0 / np.sqrt(self.counts[cells])).sum()) / cells.size)
        return rewards


class ErrorScale:
    """Errors, unscaled or brought to a size, so that one learning rate fits any task.

    Args:
        size: mean root mean square of the errors; None for unscaled errors.

    Attributes:
        scales: True if errors are brought to a size.
    """

    def __init__(self, size: float | None) -> None:
        self._size, self.scales = size, size is not None
        self.begin()

    def begin(self) -> None:
        """Begin a block of training, in which the size is measured anew."""
        self._count, self._square = 0, 0.0

    def of(self, errors: Floats) -> Floats:
        """The errors of a control step, of all copies, scaled."""
        if self._size is None:
            return errors
        self._count = min(self._count + 1, SOME)
        self._square += (float(np.mean(errors**2)) - self._square) / self._count
        return errors * (self._size / math.sqrt(max(self._square, 1e-12)))
