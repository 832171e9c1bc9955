"""The network of an agent and its learning: places, a critic, circuits that choose, one error for all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import check
from neuro.coding import PERIOD, Fields
from neuro_agent.network import CRITIC, GAIN, REST, SEED, STEP, TAU, USUAL, Settings, Weights, circuit, network
from neuro_agent.spaces import States, actions_of, encoder_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Log:
    """Episodes of a training, in the order in which they ended.

    Attributes:
        returns: sums of rewards, (episodes,).
        lengths: control steps, (episodes,).
        steps: control steps of all environments up to its end, (episodes,).
        solved: True if the requested mean return was reached, False if not, None if the training had no such goal.
    """

    def __init__(self, returns: Any = (), lengths: Any = (), steps: Any = (), solved: bool | None = None) -> None:
        self._returns, self._lengths, self._steps = list(returns), list(lengths), list(steps)
        self.solved = solved

    def __repr__(self) -> str:
        n = len(self)
        if not n:
            return "Log(no episode)"
        solved = {None: "", False: ", not solved", True: ", solved"}[self.solved]
        mean = f"mean return of the last {min(n, 100)}: {self.mean(100):g}"
        return f"Log({n} episodes, {self._steps[-1]:,} steps, {mean}{solved})"

    def __len__(self) -> int:
        return len(self._returns)

    @property
    def returns(self) -> Floats:
        """Sums of rewards."""
        return np.array(self._returns, dtype=np.float64)

    @property
    def lengths(self) -> Ints:
        """Control steps of each episode."""
        return np.array(self._lengths, dtype=np.int64)

    @property
    def steps(self) -> Ints:
        """Control steps of all environments up to the end of each episode."""
        return np.array(self._steps, dtype=np.int64)

    def add(self, total: float, length: int, step: int) -> None:
        """An episode has ended."""
        self._returns.append(total)
        self._lengths.append(length)
        self._steps.append(step)

    def mean(self, window: int) -> float:
        """The mean return of the last episodes; NaN before there are any."""
        return float(np.mean(self._returns[-window:])) if self._returns else float("nan")

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all entries and the outcome as arrays for a file."""
        solved = np.array([-1 if self.solved is None else self.solved], dtype=np.int8)
        return {"returns": self.returns, "lengths": self.lengths, "steps": self.steps, "solved": solved}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Log:
        """Return the log that `arrays` describes; an older file does not say whether the goal was reached."""
        returns, lengths, steps = (arrays[name].tolist() for name in ("returns", "lengths", "steps"))
        solved = int(arrays["solved"][0]) if "solved" in arrays else -1
        return cls(returns, lengths, steps, None if solved < 0 else bool(solved))

    def plot(self, bar: float | None = None) -> Figure:
        """A picture of the returns: each episode, the mean of 100, and a bar to reach."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 3.2), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(self.returns, ".", markersize=2, color="0.6", label="episode")
        if len(self) >= 2:
            window = min(100, len(self))
            mean = np.convolve(self.returns, np.full(window, 1 / window), "valid")
            axes.plot(np.arange(window - 1, len(self)), mean, label=f"mean of {window}")
        if bar is not None:
            axes.axhline(bar, linestyle=":", color="0.3", label=f"{bar:g}")
        axes.set_xlabel("episode")
        axes.set_ylabel("return")
        axes.legend(frameon=False)
        return figure


class Test:
    """Episodes without learning.

    Attributes:
        returns: sums of rewards, (episodes,).
        lengths: control steps, (episodes,).
    """

    __test__ = False  # not one of pytest's

    def __init__(self, returns: Floats, lengths: Ints) -> None:
        self.returns, self.lengths = returns, lengths

    @property
    def mean(self) -> float:
        """The mean return."""
        return float(self.returns.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """The mean's 95 % interval, of the normal distribution; NaN of one episode, which says nothing of others."""
        n = len(self.returns)
        half = 1.96 * float(self.returns.std(ddof=1)) / float(np.sqrt(n)) if n > 1 else float("nan")
        return self.mean - half, self.mean + half

    def __repr__(self) -> str:
        if len(self.returns) == 1:
            return f"Test(1 episode, return {self.mean:g})"
        low, high = self.interval
        return f"Test({len(self.returns)} episodes, mean return {self.mean:g}, 95 % {low:g} to {high:g})"


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
