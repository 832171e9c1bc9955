"""The network of an agent and its learning: places, a critic, circuits that choose, one error for all."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.apps import SOME, Log, RewardScale, States, actions_of, check, dimensions_of
from neuro.coding import PERIOD, Fields, OneHot, Places, Population, Tiles
from neuro_agent.network import CRITIC, GAIN, REST, SEED, STEP, TAU, USUAL, Settings, Weights, circuit, network

if TYPE_CHECKING:
    pass


Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


TYPICAL = 0.05
"""Size of an error, root mean square, to which errors are normalised."""


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


def encoder_of(space: gymnasium.Space[Any], settings: Settings) -> Fields:
    """The neurons that stand for observations.

    Raises:
        ModelError: the space is of another kind or empty, or the encoder refuses it or has too many neurons for it.
    """
    dimensions, s = dimensions_of(space), settings
    if not dimensions:
        raise ModelError("observation space: it is empty: expected at least one dimension")
    match s.encoder:
        case "tiles":
            return Tiles(dimensions, s.group, s.fields, s.active)
        case "one_hot":
            return OneHot(dimensions)
        case "population":
            return Population(dimensions, s.group, s.fields)
    return Places(dimensions, s.group, s.fields, s.active)


class Learner:
    """The network of an agent, and what it learns; `ActorCritic` trains and tests it.

    Args:
        observations: the space of an environment's observations.
        actions: that of its actions.
        seed: of the network's draws, and of the random moves before learning.
        settings: by name, see `Settings`.

    Attributes:
        kind: in what way it learns; what one kind has learnt says nothing to another.
        settings: what was chosen.
        places: the neurons that stand for observations.
        states: which of their numbers have states.
        actions: what the neurons of the circuits stand for.
        rewards: the scale of rewards.
        novelty: of observations.
        errors: what an error is to the actor.
        begun: episodes and blocks of training that have begun; each has a seed of its own.
        explored: whether bounds and scales are known, from random moves or since none are needed.
        log: of the last training.
        seen: observations of its last control steps, (n, dimensions).

    Raises:
        ModelError: a space is of another kind or needs too many neurons, a setting is unknown, or a setting or the seed
            is out of bounds.
    """

    kind: ClassVar[str] = "spiking"

    def __init__(
        self, observations: gymnasium.Space[Any], actions: gymnasium.Space[Any], *, seed: int = 0, **settings: Any
    ) -> None:
        self.settings = s = Settings().changed(settings)
        self.observations, self.seed = observations, check(SEED, seed, "seed")
        self.places, self.states = encoder_of(observations, s), States(observations)
        self.actions = actions_of(actions, s.levels, s.circuits)
        self.rewards = RewardScale(s.discount, s.reward_scale)
        self.novelty = Novelty(self.places, s.novelty * (1.0 - s.discount))
        self.errors = ErrorScale(s.errors == "normalised")
        self.explored, self.begun = False, (0, 0)
        self.log = Log()
        self.seen: Floats = np.zeros((0, len(self.places.dimensions)))
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
        s, active = self.settings, self.places.active
        etas = _etas(rates_of(s, active), active)
        return network(self.places.size, self.actions.sizes, s, etas, None if learns else self.weights)

    def begin(self, n: int, block: int = 0) -> None:
        """Compile n copies of the network for a block of training, with what was learnt before."""
        learnt = self.weights
        self.rewards.begin()
        self.errors.begin()
        seed = block_seed(self.seed, block)
        self._draws = draws_of(self, seed)
        self._copies = neuro.compile(self.network(), copies=n, seed=seed, backend=self.settings.backend)
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

    def shrink(self, share: float) -> None:
        """Let rewards and values be this share of what they were: see `RewardScale.excess`."""
        self.rewards.shrink(share)
        value = share * self.weights["value"]
        self._learnt["value"][...] = value
        if self._copies is not None:
            self._set({"value": value})

    def merge(self, before: Mapping[str, Floats]) -> dict[str, Floats]:
        """Let all copies have what they had at first, and what each of them has learnt since."""
        assert self._copies is not None
        return {name: self._copies.merge(name, w.ravel()).reshape(w.shape) for name, w in before.items()}

    def decide(self, observations: Floats, mixed: np.random.Generator | None = None) -> Decision:
        """Show an observation to each copy, (copies, dimensions), and let it judge and choose.

        With `mixed` each place spikes in place of another, drawn anew: a control.
        """
        spikes = self.places.spikes(observations, STEP, self._draws)
        if mixed is not None:
            offsets, ticks, ids = spikes
            ids = mixed.permutation(self.places.size)[ids]
            copies = np.repeat(np.arange(len(observations)), np.diff(offsets))
            spikes = offsets, ticks, ids[np.lexsort((ids, ticks, copies))]
        values, *chosen = self._stepper.step(spikes, self._ask)
        winners = np.array([each.argmax(axis=1) for each in chosen]).T
        counts = values.sum(axis=1) / self.settings.critics
        return Decision(winners, self.rewards.first + (counts - REST) / GAIN, values)

    def teach(self, errors: Floats) -> None:
        """Set the errors of the last but one control step, one for each copy: its synapses learn."""
        assert self._copies is not None
        self._copies.signal("error", errors[:, None])
        errors = self.errors.of(errors)
        for k in range(len(self.actions.sizes)):
            self._copies.signal(f"error{k}", errors[:, None])

    def forget(self, which: npt.NDArray[np.bool_]) -> None:
        """End the episode of some copies: their eligibility is 0."""
        assert self._copies is not None
        for name in self.projections:
            self._copies.clear(name, which)


def draws_of(agent: Learner, seed: int) -> np.random.Generator | None:
    """What draws the spikes of places; None where they are regular."""
    return np.random.default_rng([seed, 2]) if agent.settings.spikes == "poisson" else None


def block_seed(seed: int, block: int) -> int:
    """The seed of the network's draws in a block of training."""
    return int(np.random.SeedSequence([seed, block, 1]).generate_state(1)[0])


def rates_of(settings: Settings, active: int) -> tuple[float, float]:
    """By how much an error of 1 changes the preference for an action, and the value, in the state of `active` places.

    The settings are those of USUAL places. One place that stands for a state alone takes all of an error's noise, which
    many share; the exponent is that with which both FrozenLake (one place) and MountainCar (24) are learnt.
    """
    share = (active / USUAL) ** (2.0 / 3.0)
    return settings.actor_rate * share, settings.critic_rate * share


def _etas(rates: tuple[float, float], active: int) -> tuple[float, float]:
    """The learning rates of the rules in mV, for the actor and the critic.

    An active place brings x, which is 1 / (1 - exp(-PERIOD / tau)) at a spike and decays; the means are over a period.
    """
    actor, critic = rates
    x = np.exp(-np.arange(PERIOD) / TAU) / (1.0 - math.exp(-PERIOD / TAU))
    return actor / (active * float(np.mean(x**2))), critic / (active * REST * float(np.mean(x)) ** 2)
