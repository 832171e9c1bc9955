"""The linear twin: the same places, choices, errors and rates, without spikes; it shows what spikes cost or bring."""

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

    It has no spikes: the settings `spikes`, `critics` and `backend` change nothing.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 13.5 (actor-critic with eligibility traces).
    """

    kind: ClassVar[str] = "linear twin"

    def pilot(self, worlds: Environments, seed: int) -> Any:
        """Return what learns in environments, as the pilot of a closed loop that has learnt nothing yet."""
        return _Pilot(self, seed)

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


class _Pilot:
    """What the twin learns in a closed loop; several episodes side by side learn one set of weights.

    Attributes:
        encoders: those of the places.
        taught: the errors, that for the critic and that for the actor.
        counts: the values of the last control step in place of the critic's spikes, (copies, 1).
    """

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
        self._critic = np.eye(1, 1 + sum(twin.actions.sizes))[0]  # rates of each column
        self._critic, self._actor = critic / active * self._critic, actor / active * (1.0 - self._critic)

    def begin(self, copies: int, block: int) -> None:
        """Begin a block, with all that was learnt before."""
        self._rng = np.random.default_rng([self._seed, block])
        self._z = [np.zeros_like(self._w) for _ in range(copies)]
        for taught in self.taught.values():
            taught.begin(copies)

    def act(self, observations: Floats, infos: Any) -> npt.NDArray[Any]:
        """Judge and choose."""
        winners, values = [], []
        self._e: list[tuple[Ints, Floats]] = []
        for vector in observations:
            cells, x = self.encoders["places"].fields.activity(vector)
            value, *_ = sums = (x[:, None] * self._w[cells]).sum(axis=0)
            p, chosen = self._choices.draw(sums[1:], self._rng)
            gained = np.concatenate([[1.0], -p])
            gained[1 + self._choices.first + chosen] += 1.0
            self._e.append((cells, x[:, None] * gained))
            values.append(float(value))
            winners.append(chosen)
        self.counts = {CRITIC: np.array(values)[:, None]}
        return self._twin.actions.of(np.array(winners))

    def explored(self, observations: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Learn bounds and scales from random moves."""
        self.encoders["places"].learn(observations)
        self.taught["error"].explored(rewards, returns)

    def teach(self, moment: Moment) -> None:
        """Learn from the errors of the last but one control step; then the last one is eligible, too."""
        s, errors = self._twin.settings, self.taught["error"].values(moment)
        scaled = self.taught["error0"].of(errors)
        for error, own, z, (cells, gained) in zip(errors[:, 0], scaled[:, 0], self._z, self._e, strict=True):
            self._w += (self._critic * error + self._actor * own) * z
            z *= s.discount * s.decay
            z[cells] += gained
        for k in np.flatnonzero(moment.last):
            self._z[k][...] = 0.0
        self._w[:, 0] *= self.taught["error"].share(moment)

    def merge(self) -> None:
        """They have one set of weights already."""

    def arrays(self) -> dict[str, Any]:
        """All that it needs to go on; all neurons of a critic would learn the same."""
        value, *policies = np.split(self._w, 1 + self._choices.first, axis=1)
        critic = np.broadcast_to(value, (len(value), self._twin.settings.critics))
        weights = dict(zip(self._twin.projections, (critic, *policies), strict=True))
        places, error = self.encoders["places"].arrays(), self.taught["error"].arrays()
        return {"learnt": weights, "encoder.places": places, "teacher.error": error}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Go on from `arrays`."""
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
