"""The linear twin: the same places, choices, errors and rates, without spikes; it shows what spikes cost or bring."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_agent.agent import ActorCritic
from neuro_agent.learner import Decision, rates_of
from neuro_agent.network import Weights

__all__ = ["LinearTwin"]

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class LinearTwin(ActorCritic):
    """An actor-critic with linear functions of the active places, TD(lambda) and a softmax policy.

    It has no spikes: the settings `spikes` and `critics` change nothing.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 13.5 (actor-critic with eligibility traces).
    """

    def begin(self, n: int, block: int = 0) -> None:
        """Begin a block of training with n episodes side by side, which learn one set of weights."""
        self.rewards.begin()
        self.errors.begin()
        self._rng = np.random.default_rng([self.seed, block])
        self._z = [{name: np.zeros_like(each) for name, each in self._learnt.items()} for _ in range(n)]
        self._e: list[dict[str, tuple[Ints, Floats]]] = [{} for _ in range(n)]

    def decide(self, observations: Floats, mixed: np.random.Generator | None = None) -> Decision:
        """Judge and choose, for each observation; see `Learner.decide`."""
        winners, values = [], []
        for k, vector in enumerate(observations):
            cells, x = self.places.activity(vector)
            cells = cells if mixed is None else mixed.permutation(self.places.size)[cells]
            values.append(self.rewards.first + float((x * self._learnt["value"][cells, 0]).sum()))
            x = x[:, None]
            self._e[k] = {"value": (cells, x)}
            chosen = []
            for name in self.projections[1:]:
                p = _softmax((x * self._learnt[name][cells]).sum(axis=0))
                winner = int(self._rng.choice(len(p), p=p))
                self._e[k][name] = cells, x * (np.eye(len(p))[winner] - p)
                chosen.append(winner)
            winners.append(chosen)
        return Decision(np.array(winners), np.array(values), np.zeros((len(observations), 0), dtype=np.int64))

    def teach(self, errors: Floats) -> None:
        """Learn from the errors of the last but one control step; then the last one is eligible, too."""
        s, (actor, critic) = self.settings, rates_of(self.settings, self.places.active)
        for error, own, z, e in zip(errors, self.errors.of(errors), self._z, self._e, strict=True):
            for name, trace in z.items():
                taught = critic * error if name == "value" else actor * own
                self._learnt[name] += taught / self.places.active * trace
                trace *= s.discount * s.decay
                cells, gained = e[name]
                trace[cells] += gained

    def forget(self, which: npt.NDArray[np.bool_]) -> None:
        """End the episode of some."""
        for k in np.flatnonzero(which):
            for trace in self._z[k].values():
                trace[...] = 0.0

    def merge(self, before: Any) -> dict[str, Floats]:
        """They have one set of weights already."""
        return self.weights

    def learn_from(self, weights: Weights) -> None:
        """Have learnt these weights."""
        for name, each in self._learnt.items():
            each[...] = weights[name]

    def frozen(self, seed: int = 0, backend: str = "event") -> Any:
        """The twin as it is, which learns no more."""
        return _Frozen(self, seed)


class _Frozen:
    def __init__(self, twin: LinearTwin, seed: int) -> None:
        self._twin, self._rng = twin, np.random.default_rng(seed)

    def decide(self, observations: Floats) -> Ints:
        """The action of one observation."""
        (cells, x), weights = self._twin.places.activity(observations[0]), self._twin.weights
        sharp = self._twin.settings.sharpness
        ps = [_softmax((x @ weights[name][cells]) * sharp) for name in self._twin.projections[1:]]
        return np.array([[self._rng.choice(len(p), p=p) for p in ps]])


def _softmax(u: Floats) -> Floats:
    p = np.exp(u - u.max())
    found: Floats = p / p.sum()
    return found
