"""What an agent learns from: rewards on the scale of its critic, novelty, and errors on the scale of its actor."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from neuro.coding import Fields

__all__ = ["ErrorScale", "Novelty", "RewardScale"]

Floats = npt.NDArray[np.float64]

MOST = 1.25
"""The largest magnitude of a value: at -1.6 the neurons of the critic fall silent, at 3.8 they spike in each ms."""
SOME = 500
"""Control steps over which a value, or the size of errors, is averaged."""
TYPICAL = 0.05
"""Size of an error, root mean square, to which errors are normalised."""


class RewardScale:
    """What a reward is to the critic, from rewards of random moves.

    Args:
        discount: of the next reward.
        scale: what a typical reward in each step, for ever, is to be worth.

    Attributes:
        factor: a reward times this is what the critic learns.
        first: the value that all states have before anything is learnt.
        known: whether the scale has been taken from a reward that is not 0.
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

    def excess(self, values: Floats, rewards: Floats) -> float:
        """By which share rewards and values have to shrink after a control step, 1 if they need not.

        Random moves do not show what a good policy gets. So rewards shrink to half of MOST where values come to exceed
        it, and to MOST where one reward alone does. Neurons for dopamine adapt to the range of rewards, too (Tobler,
        Fiorillo & Schultz, Science 307:1642, 2005).

        Args:
            values: of the states, (copies,).
            rewards: as the environments gave them, (copies,).
        """
        # Of the few numbers of a control step, lists are faster than reductions of arrays.
        self._level += (sum(values.tolist()) / len(values) - self._level) / SOME
        level, largest = abs(self._level), self.factor * max(map(abs, rewards.tolist()))
        return min(MOST / 2.0 / level if level > MOST else 1.0, MOST / largest if largest > MOST else 1.0)

    def shrink(self, share: float) -> None:
        """Let rewards be this share of what they were."""
        self.factor, self.first, self._level = self.factor * share, self.first * share, self._level * share


class Novelty:
    """A reward for what has seldom been seen: the mean of scale / sqrt(n), n how often each active place has been.

    Dopamine neurons respond to what is new, less with each time (Kakade & Dayan, Neural Networks 15:549, 2002). The
    form is that of Strehl & Littman, J. Comput. Syst. Sci. 74:1309, 2008.

    Args:
        places: that stand for observations.
        scale: the reward of a state that has not been seen.

    Attributes:
        counts: how often each place has been active, (places,); empty if the scale is 0.
    """

    def __init__(self, places: Fields, scale: float) -> None:
        self._places, self._scale = places, scale
        self.counts = np.zeros(places.size if scale else 0, dtype=np.int64)

    def __bool__(self) -> bool:
        return self._scale > 0.0

    def of(self, observations: Floats) -> Floats:
        """The reward of each observation, (copies, dimensions), each of which has been seen once more then."""
        found = np.zeros(len(observations))
        for k, vector in enumerate(observations):
            cells = self._places.cells(vector)
            self.counts[cells] += 1
            found[k] = self._scale * float((1.0 / np.sqrt(self.counts[cells])).sum()) / cells.size
        return found


class ErrorScale:
    """What an error is to the actor: itself, or of the size TYPICAL on average, so that its rate fits any task.

    Args:
        normalised: whether to scale.
    """

    def __init__(self, normalised: bool) -> None:
        self._normalised = normalised
        self.begin()

    def begin(self) -> None:
        """Begin a block of training, in which the size is measured anew."""
        self._count, self._square = 0, 0.0

    def of(self, errors: Floats) -> Floats:
        """The errors of a control step, (copies,), scaled."""
        if not self._normalised:
            return errors
        self._count = min(self._count + 1, SOME)
        self._square += (float(np.mean(errors**2)) - self._square) / self._count
        return errors * (TYPICAL / math.sqrt(max(self._square, 1e-12)))
