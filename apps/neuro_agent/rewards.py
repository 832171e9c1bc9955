"""The scale of rewards: a critic has rates, so values have to be of the size of its rate at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["RewardScale"]


class RewardScale:
    """What a reward is to the critic, from rewards of random moves.

    Args:
        discount: of the next reward.

    Attributes:
        factor: a reward times this is what the critic learns.
        first: the value that all states have before anything is learnt.
        known: whether a reward that is not 0 has told the scale.
    """

    def __init__(self, discount: float) -> None:
        self.horizon = 1.0 / (1.0 - discount)
        self.factor, self.first, self.known = 1.0, 0.0, False

    def learn(self, rewards: Sequence[float]) -> None:
        """Take the scale from rewards, of which one is not 0.

        A typical reward in each step, for ever, is to be a value of 1. Where rewards are rare, only as many count as
        come within the horizon. States are worth at first what random moves bring, if that is more than nothing: a
        value that is too high makes an agent try what it has not tried.
        """
        array = np.asarray(rewards, dtype=np.float64)
        some = array[array != 0.0]
        if not some.size:
            return
        dense = some.size / array.size
        steps = self.horizon if dense >= 0.5 else max(1.0, dense * self.horizon)
        self.factor = 1.0 / (float(np.median(np.abs(some))) * steps)
        self.first = max(0.0, self.factor * float(array.mean()) * self.horizon)
        self.known = True
