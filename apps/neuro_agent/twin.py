"""The linear twin: the same places, choices, errors and rates without spikes, to measure the effect of spikes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Environments, Moment
from neuro_agent.agent import ActorCritic
from neuro_agent.network import CRITIC, rates_of

if TYPE_CHECKING:
    from neuro.chips import Energy


Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class LinearTwin(ActorCritic):
    """An actor-critic with linear functions of the active places, TD(lambda) and a softmax policy.

    The twin has no spikes, so the settings `spikes`, `critics` and `backend` have no effect.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 13.5 (actor-critic with eligibility traces).
    """

    kind: ClassVar[str] = "linear twin"

    def pilot(self, worlds: Environments, seed: int) -> Any:
        """Return an untrained pilot that learns in environments within a closed loop."""
        return _Pilot(self, seed)

    def frozen(self, seed: int = 0, backend: str = "event") -> Any:
        """Return the twin with frozen weights.

        Raises:
            ModelError: the backend is not the default.
        """
        if backend != "event":
            raise _no_spikes(backend)
        return _Frozen(self, seed)

    def energy(self, target: str, steps: int = 200) -> Energy:
        """Raise an error: no chip runs a network without spikes.

        Raises:
            ModelError: always.
        """
        raise _no_spikes(target)


def _no_spikes(caller: str) -> ModelError:
    return ModelError(f"'{caller}': the linear twin has no spikes, so no backend runs it: expected an ActorCritic")


class _Pilot:
    """Pilot of a learning twin in a closed loop; episodes side by side share one set of weights.

    Attributes:
        encoders: encoders of the places.
        taught: errors for the critic and for the actor.
        counts: values of the last control step, in place of the critic's spikes, (copies, 1).
    """

    # _w: weights, (places, 1 + choices); column 0 is the critic's. _z: eligibility of _w, one array for each copy.
    # _e: active places of the last step and their part of the eligibility, for each copy.

    def __init__(self, twin: LinearTwin, seed: int) -> None:
        world = twin.network().world_section
        assert world is not None
        self._twin, self._seed, self._choices = twin, seed, Choices(twin.actions.sizes)
        self.encoders = {"places": world.observe["places"].made(twin.observations, ())}
        error = replace(world.reward["error"], rest=0.0, gain=1.0)
        self.taught = {"error": error.made(1), "error0": world.reward["error0"].made()}
        self.taught["error"].join(self.encoders)
        s, active = twin.settings, twin.places.active
        actor, critic = rates_of(s, active)
        is_critic = np.eye(1, 1 + sum(twin.actions.sizes))[0]
        # Learning rates by column of _w.
        self._critic, self._actor = critic / active * is_critic, actor / active * (1.0 - is_critic)

    def begin(self, copies: int, block: int) -> None:
        """Begin a block with everything learnt so far."""
        self._rng = np.random.default_rng([self._seed, block])
        self._z = [np.zeros_like(self._w) for _ in range(copies)]
        for taught in self.taught.values():
            taught.begin(copies)

    def act(self, observations: Floats, infos: Any) -> npt.NDArray[Any]:
        """Compute values and choose actions."""
        winners, values = [], []
        self._e: list[tuple[Ints, Floats]] = []
        for vector in observations:
            cells, x = self.encoders["places"].fields.activity(vector)
            value, *_ = sums = (x[:, None] * self._w[cells]).sum(axis=0)
            p, chosen = self._choices.draw(sums[1:], self._rng)
            eligibility = np.concatenate([[1.0], -p])
            eligibility[1 + self._choices.first + chosen] += 1.0
            self._e.append((cells, x[:, None] * eligibility))
            values.append(float(value))
            winners.append(chosen)
        self.counts = {CRITIC: np.array(values)[:, None]}
        return self._twin.actions.of(np.array(winners))

    def explored(self, observations: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Set bounds and scales from random moves."""
        self.encoders["places"].learn(observations)
        self.taught["error"].explored(rewards, returns)

    def teach(self, moment: Moment) -> None:
        """Learn from the errors of the step before the last; then add the last step to the eligibility."""
        s, errors = self._twin.settings, self.taught["error"].values(moment)
        scaled = self.taught["error0"].of(errors)
        for error, actor_error, z, (cells, increment) in zip(errors[:, 0], scaled[:, 0], self._z, self._e, strict=True):
            self._w += (self._critic * error + self._actor * actor_error) * z
            z *= s.discount * s.decay
            z[cells] += increment
        for k in np.flatnonzero(moment.last):
            self._z[k][...] = 0.0
        self._w[:, 0] *= self.taught["error"].share(moment)

    def merge(self) -> None:
        """Do nothing, since the copies share their weights."""

    def arrays(self) -> dict[str, Any]:
        """Return everything that a resumed training needs; all neurons of the critic have the same weights."""
        value, *policies = np.split(self._w, 1 + self._choices.first, axis=1)
        critic = np.broadcast_to(value, (len(value), self._twin.settings.critics))
        weights = dict(zip(self._twin.projections, (critic, *policies), strict=True))
        places, error = self.encoders["places"].arrays(), self.taught["error"].arrays()
        return {"learnt": weights, "encoder.places": places, "teacher.error": error}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Resume from `arrays`."""
        size, weights = self._twin.places.size, arrays["learnt"]
        value, *policies = (np.reshape(weights[name], (size, -1)) for name in self._twin.projections)
        self._w = np.hstack([value[:, :1], *policies])
        self.encoders["places"].put(arrays["encoder.places"])
        self.taught["error"].put(arrays["teacher.error"])


class _Frozen:
    def __init__(self, twin: LinearTwin, seed: int) -> None:
        self._places, self._rng = twin.places, np.random.default_rng(seed)
        self._choices = Choices(twin.actions.sizes)
        self._w = np.hstack(list(twin.weights.values())[1:]) * twin.settings.sharpness

    def decide(self, observations: Floats) -> Ints:
        """Return the choices for one observation."""
        cells, x = self._places.activity(observations[0])
        return self._choices.draw(x @ self._w[cells], self._rng)[1][None]


class Choices:
    """Choices by softmax, one per circuit.

    Args:
        sizes: number of choices of each circuit.

    Attributes:
        first: index of each circuit's first choice in the concatenated array.
    """

    def __init__(self, sizes: Sequence[int]) -> None:
        self._sizes = np.array(sizes)
        self.first = np.cumsum([0, *sizes[:-1]])

    def draw(self, preferences: Floats, rng: np.random.Generator) -> tuple[Floats, Ints]:
        """Return the probability of each choice, and the choice of each circuit."""
        p = np.exp(preferences - np.repeat(np.maximum.reduceat(preferences, self.first), self._sizes))
        p /= np.repeat(np.add.reduceat(p, self.first), self._sizes)
        thresholds = np.arange(len(self.first)) + rng.random(len(self.first))
        choices = np.searchsorted(np.cumsum(p), thresholds, side="right") - self.first
        return p, np.clip(choices, 0, self._sizes - 1)  # a rounded sum of probabilities may be below 1
