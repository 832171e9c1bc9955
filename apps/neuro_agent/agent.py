"""An agent of spiking neurons that learns by reward, with an actor, a critic, and one error for both."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

import neuro
from neuro_agent import files, training
from neuro_agent.actions import actions_of
from neuro_agent.log import Log, Test
from neuro_agent.network import BASE, CRITIC, SLOPE, STEP, TAU, Weights, circuit, network
from neuro_agent.places import PERIOD, Places, dimensions_of, flat
from neuro_agent.rewards import RewardScale
from neuro_agent.settings import settings_of

__all__ = ["ActorCritic", "Decision", "Frozen"]

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Decision:
    """What some copies of an agent's network did in a control step.

    Attributes:
        winners: the neuron of each circuit that spiked, (copies, circuits).
        values: of the states, as the critic's spikes tell, (copies,).
        spikes: of the critic, (copies, neurons).
    """

    __slots__ = ("spikes", "values", "winners")

    def __init__(self, winners: Ints, values: Floats, spikes: Ints) -> None:
        self.winners, self.values, self.spikes = winners, values, spikes


class ActorCritic:
    """A spiking agent.

    Args:
        observations: the space of an environment's observations.
        actions: that of its actions.
        seed: of the network's draws, and of the random moves before learning.
        settings: by name, see `Settings`.

    Attributes:
        settings: what was chosen.
        places: the neurons that stand for observations.
        actions: what the neurons of the circuits stand for.
        rewards: the scale of rewards.
        explored: whether bounds and scales are known, from random moves or since none are needed.
        log: of the last training.

    Raises:
        ModelError: a space is of another kind or needs too many neurons, or a setting is unknown or out of bounds.
    """

    def __init__(
        self, observations: gymnasium.Space[Any], actions: gymnasium.Space[Any], *, seed: int = 0, **settings: Any
    ) -> None:
        self.settings = s = settings_of(settings)
        self.observations, self.seed = observations, seed
        self.places = Places(dimensions_of(observations), s.group, s.fields, s.active)
        self.actions = actions_of(actions, s.levels)
        self.rewards = RewardScale(s.discount)
        self.explored = False
        self.log = Log()
        sizes = (s.critics, *self.actions.sizes)
        self._learnt: dict[str, Floats] = {
            name: np.zeros((self.places.size, size)) for name, size in zip(self.projections, sizes, strict=True)
        }
        self._copies: neuro.Copies | None = None

    def __repr__(self) -> str:
        sizes = " + ".join(map(str, self.actions.sizes))
        return (
            f"ActorCritic({self.places.size} places, {self.settings.critics} critics, {sizes} actors, seed={self.seed})"
        )

    @property
    def projections(self) -> tuple[str, ...]:
        """The projections that learn: that onto the critic, then those onto the circuits."""
        return ("value", *(f"policy{k}" for k in range(len(self.actions.sizes))))

    @property
    def weights(self) -> dict[str, Floats]:
        """What has been learnt, by projection, mV, (places, neurons)."""
        if self._copies is not None:
            for name, each in self._learnt.items():
                each[...] = self._copies[0].get(name, "weight").reshape(each.shape)
        return {name: each.copy() for name, each in self._learnt.items()}

    def network(self, learns: bool = True) -> neuro.Network:
        """The network as a description, which learns from nothing, or has what was learnt in static synapses."""
        s = self.settings
        rates = _rates(self.places.active, s.actor_rate, s.critic_rate)
        return network(self.places.size, self.actions.sizes, s, rates, None if learns else self.weights)

    # training

    def train(
        self,
        env: Any,
        until: float | None = None,
        *,
        steps: int | None = None,
        episodes: int | None = None,
        window: int = 100,
        patience: float = 60.0,
        progress: bool = False,
        out: str | PathLike[str] | None = None,
    ) -> Log:
        """Learn in an environment, or in a vector of environments at a time; a second call goes on.

        Args:
            env: a gymnasium.Env, or a VectorEnv, each of whose environments has a copy of the network; the copies add
                up what they learn.
            until: stop when the mean return of the last `window` episodes reaches this.
            steps: stop after so many control steps.
            episodes: stop after so many episodes.
            window: episodes of that mean.
            patience: seconds within which the environment must answer.
            progress: whether to show how far it is on stderr.
            out: a file to which the agent is saved at the end. Beside it lies FILE.training meanwhile, from which the
                same call goes on after a kill, to the same bits.

        Returns:
            the episodes of this call.

        Raises:
            ModelError: the environment has other spaces, gives NaN, raises or does not answer; what was learnt before
                stays.
        """
        end = training.End(until, steps, episodes, window)
        path = None if out is None else Path(out)
        self.log = training.train(self, env, end, patience=patience, progress=progress, out=path)
        if path is not None:
            self.save(path)
            training.checkpoint(self, path, env).remove()
        return self.log

    def test(
        self, env: Any, episodes: int = 100, *, seed: int = 0, backend: str = "event", patience: float = 60.0
    ) -> Test:
        """Episodes without learning, of seeds that no training has.

        Args:
            env: one environment.
            episodes: how many.
            seed: of the environment and of the network's draws.
            backend: that runs the network; a chip runs it as `deployed` says.
            patience: seconds within which the environment must answer.

        Raises:
            ModelError: as of `train`; or the backend refuses the network.
        """
        return training.test(self, env, episodes, seed, backend, patience)

    def controls(
        self, env: Any, *, steps: int, episodes: int = 100, names: tuple[str, ...] = training.CONTROLS
    ) -> dict[str, Test]:
        """What must fail: agents like this one, not trained yet, that are kept from learning; tested after `steps`.

        shuffled: errors of other times teach. frozen: nothing does. random: actions are drawn, whatever the circuit
        chooses. scrambled: the numbers of each observation change places at each step.
        """
        found = {}
        for name in names:
            twin = type(self)(self.observations, self.actions.space, seed=self.seed, **self.settings.plain())
            training.train(twin, env, training.End(steps=steps), control=name)
            found[name] = twin.test(env, episodes)
        return found

    # what training calls

    def begin(self, n: int, block: int = 0) -> None:
        """Compile n copies of the network for a block of training, with what was learnt before."""
        learnt = self.weights
        self._copies = neuro.compile(
            self.network(), copies=n, seed=training.episode_seed(self.seed, -1 - block & 0xFFFF)
        )
        count = [CRITIC, *(circuit(k) for k in range(len(self.actions.sizes)))]
        self._stepper = self._copies.stepper(float(STEP), emit=["places", "ask"], count=count)
        self._ask = (np.arange(n + 1), np.full(n, STEP - 1), np.zeros(n, dtype=np.int64))
        self._set(learnt)

    def _set(self, weights: Weights) -> None:
        assert self._copies is not None
        for sim in self._copies:
            for name, each in weights.items():
                sim.set(name, weight=each.ravel())

    def learn_from(self, weights: Weights) -> None:
        """Have learnt these weights, and go on from them."""
        for name, each in self._learnt.items():
            each[...] = weights[name]
        self._copies = None

    def merge(self, before: Mapping[str, Floats]) -> dict[str, Floats]:
        """Let all copies have what they had at first, and what each of them has learnt since."""
        assert self._copies is not None
        after = {}
        for name, first in before.items():
            each = np.stack([sim.get(name, "weight") for sim in self._copies])
            after[name] = (first.ravel() + (each - first.ravel()).sum(axis=0)).reshape(first.shape)
        self._set(after)
        return after

    def decide(self, observations: Floats) -> Decision:
        """Show an observation to each copy, (copies, dimensions), and let it judge and choose."""
        values, *chosen = self._stepper.step(self.places.spikes(observations, STEP), self._ask)
        winners = np.stack([each.argmax(axis=1) for each in chosen], axis=1)
        return Decision(winners, self.rewards.first + (values.sum(axis=1) - self._rest) / self._gain, values)

    def teach(self, errors: Floats) -> None:
        """Set the errors of the last but one control step, one for each copy: its synapses learn."""
        assert self._copies is not None
        for k in range(-1, len(self.actions.sizes)):
            self._copies.signal("error" if k < 0 else f"error{k}", errors[:, None])

    def forget(self, which: npt.NDArray[np.bool_]) -> None:
        """End the episode of some copies: their eligibility is 0."""
        assert self._copies is not None
        for name in self.projections:
            self._copies.clear(name, which)

    def frozen(self, seed: int = 0, backend: str = "event") -> Frozen:
        """The agent as it is, which learns no more."""
        return Frozen(self, seed, backend)

    def act(self, observation: Any) -> Any:
        """The action for one observation, by the frozen agent."""
        if not hasattr(self, "_acting"):
            self._acting = self.frozen(self.seed)
        return self.actions.action(self._acting.decide(flat(self.observations, observation)[None])[0])

    # files

    def save(self, path: str | PathLike[str]) -> None:
        """Write the agent to one HDF5 file: settings, spaces, what was learnt, the log.

        Raises:
            ModelError: the file cannot be written.
        """
        files.save(self, Path(path))

    @classmethod
    def load(cls, path: str | PathLike[str]) -> ActorCritic:
        """Read an agent that `save` wrote.

        Raises:
            ModelError: there is no such file, it is something else, or damaged.
        """
        return files.load(Path(path))

    @property
    def _rest(self) -> float:
        """Spikes of the critic in a control step in which nothing excites it."""
        p = 1.0 - math.exp(-BASE / 1000.0)
        return self.settings.critics * STEP * p / (1.0 + p)

    @property
    def _gain(self) -> float:
        """By how many spikes 1 mV changes that."""
        left = math.exp(-BASE / 1000.0)
        return self.settings.critics * STEP * SLOPE / 1000.0 * left / (2.0 - left) ** 2


class Frozen:
    """An agent that decides and learns no more."""

    def __init__(self, agent: ActorCritic, seed: int, backend: str) -> None:
        self._agent = agent
        self._circuits = [circuit(k) for k in range(len(agent.actions.sizes))]
        self.sim = neuro.compile(agent.network(learns=False), backend=backend, seed=seed)
        self._stepper = self.sim.stepper(float(STEP), emit=["places", "ask"], count=self._circuits)

    def decide(self, observations: Floats) -> Ints:
        """The neuron of each circuit that spiked, (1, circuits), for one observation, (1, dimensions)."""
        _, ticks, ids = self._agent.places.spikes(observations, STEP)
        chosen = self._stepper.step((ticks, ids), ([STEP - 1], [0]))
        return np.stack([each.argmax(axis=1) for each in chosen], axis=1)


def _rates(active: int, actor: float, critic: float) -> tuple[float, float]:
    """The learning rates of actor and critic in mV, from what an error of 1 is to change in one state.

    An active place brings x, which is 1 / (1 - exp(-PERIOD / tau)) at a spike and decays; the means are over a period.
    """
    x = np.exp(-np.arange(PERIOD) / TAU) / (1.0 - math.exp(-PERIOD / TAU))
    p = 1.0 - math.exp(-BASE / 1000.0)
    spikes = STEP * p / (1.0 + p)
    return actor / (active * float(np.mean(x**2))), critic / (active * spikes * float(np.mean(x)) ** 2)
