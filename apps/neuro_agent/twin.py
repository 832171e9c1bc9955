"""The linear twin: the same places, choices, errors and rates, without spikes; it shows what spikes cost or bring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_agent.agent import ActorCritic
from neuro_agent.learner import Decision, rates_of
from neuro_agent.network import Weights

if TYPE_CHECKING:
    from neuro.chips import Energy


Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class LinearTwin(ActorCritic):
    """An actor-critic with linear functions of the active places, TD(lambda) and a softmax policy.

    It has no spikes: the settings `spikes`, `critics` and `backend` change nothing.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 13.5 (actor-critic with eligibility traces).
    """

    kind: ClassVar[str] = "linear twin"

    def begin(self, n: int, block: int = 0) -> None:
        """Begin a block of training with n episodes side by side, which learn one set of weights."""
        self.rewards.begin()
        self.errors.begin()
        self._rng = np.random.default_rng([self.seed, block])
        self._choices = Choices(self.actions.sizes)
        value, *policies = self._learnt.values()
        self._w = np.hstack([value[:, :1], *policies])  # all neurons of a critic would learn the same
        each = np.split(self._w, 1 + self._choices.first, axis=1)
        each[0] = np.broadcast_to(each[0], value.shape)
        self._learnt = dict(zip(self.projections, each, strict=True))
        s, active = self.settings, self.places.active
        actor, critic = rates_of(s, active)
        self._critic = np.eye(1, self._w.shape[1])[0]  # rates of each column
        self._critic, self._actor = critic / active * self._critic, actor / active * (1.0 - self._critic)
        self._z = [np.zeros_like(self._w) for _ in range(n)]
        self._e: list[tuple[Ints, Floats]] = []

    def decide(self, observations: Floats, mixed: np.random.Generator | None = None) -> Decision:
        """Judge and choose, for each observation; see `Learner.decide`."""
        winners, values = [], []
        self._e = []
        for vector in observations:
            cells, x = self.places.activity(vector)
            cells = cells if mixed is None else mixed.permutation(self.places.size)[cells]
            value, *_ = sums = (x[:, None] * self._w[cells]).sum(axis=0)
            p, chosen = self._choices.draw(sums[1:], self._rng)
            gained = np.concatenate([[1.0], -p])
            gained[1 + self._choices.first + chosen] += 1.0
            self._e.append((cells, x[:, None] * gained))
            values.append(self.rewards.first + float(value))
            winners.append(chosen)
        return Decision(np.array(winners), np.array(values), np.zeros((len(observations), 0), dtype=np.int64))

    def teach(self, errors: Floats) -> None:
        """Learn from the errors of the last but one control step; then the last one is eligible, too."""
        s = self.settings
        for error, own, z, (cells, gained) in zip(errors, self.errors.of(errors), self._z, self._e, strict=True):
            self._w += (self._critic * error + self._actor * own) * z
            z *= s.discount * s.decay
            z[cells] += gained

    def shrink(self, share: float) -> None:
        """Let rewards and values be this share of what they were."""
        self.rewards.shrink(share)
        self._w[:, 0] *= share

    def forget(self, which: npt.NDArray[np.bool_]) -> None:
        """End the episode of some."""
        for k in np.flatnonzero(which):
            self._z[k][...] = 0.0

    def merge(self, before: Any) -> dict[str, Floats]:
        """They have one set of weights already."""
        return self.weights

    def learn_from(self, weights: Weights) -> None:
        """Have learnt these weights."""
        self._acting = None
        self._learnt = {name: weights[name].copy() for name in self.projections}

    def frozen(self, seed: int = 0, backend: str = "event") -> Any:
        """The twin as it is, which learns no more.

        Raises:
            ModelError: a backend other than the default is asked for.
        """
        if backend != "event":
            raise _no_spikes(backend)
        return _Frozen(self, seed)

    def energy(self, target: str, steps: int = 200) -> Energy:
        """Nothing: see `Raises`.

        Raises:
            ModelError: always, since no chip runs it.
        """
        raise _no_spikes(target)


def _no_spikes(where: str) -> ModelError:
    return ModelError(f"'{where}': the linear twin has no spikes, so no backend runs it: expected an ActorCritic")


class _Frozen:
    def __init__(self, twin: LinearTwin, seed: int) -> None:
        self._places, self._rng = twin.places, np.random.default_rng(seed)
        self._choices = Choices(twin.actions.sizes)
        self._w = np.hstack(list(twin.weights.values())[1:]) * twin.settings.sharpness

    def decide(self, observations: Floats) -> Ints:
        """The action of one observation."""
        cells, x = self._places.activity(observations[0])
        return self._choices.draw(x @ self._w[cells], self._rng)[1][None]


class Choices:
    """Choices by softmax, one for each circuit.

    Args:
        sizes: what each circuit chooses among.

    Attributes:
        first: of each circuit, in the order of all.
    """

    def __init__(self, sizes: Sequence[int]) -> None:
        self._sizes = np.array(sizes)
        self.first = np.cumsum([0, *sizes[:-1]])

    def draw(self, preferences: Floats, rng: np.random.Generator) -> tuple[Floats, Ints]:
        """The probability of each choice, and what each circuit has chosen."""
        p = np.exp(preferences - np.repeat(np.maximum.reduceat(preferences, self.first), self._sizes))
        p /= np.repeat(np.add.reduceat(p, self.first), self._sizes)
        drawn = np.arange(len(self.first)) + rng.random(len(self.first))
        chosen = np.searchsorted(np.cumsum(p), drawn, side="right") - self.first
        return p, np.clip(chosen, 0, self._sizes - 1)  # sums of probabilities are rounded
