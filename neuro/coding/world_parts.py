"""The encoders, decoders and teachers of this package, see `neuro.coding.world`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.coding.world import Act, Bools, Decoder, Encoder, Floats, Infos, Ints, Moment, Shown, Spikes, Taught, Teacher
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import quantity

if TYPE_CHECKING:
    import gymnasium

    from neuro.coding.fields import Fields


class _OfFields(Shown):
    """An encoder of `neuro.coding.FIELDS`."""

    def __init__(self, fields: Fields, columns: Any, poisson: bool) -> None:
        self.fields, self._columns, self._poisson, self.size = fields, columns, poisson, fields.size

    def learn(self, observations: Floats) -> None:
        self.fields.learn(observations[:, self._columns])

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        return self.fields.spikes(observations[:, self._columns], ticks, rng if self._poisson else None)

    def cells(self, observation: Floats) -> Ints:
        return self.fields.cells(observation[self._columns])

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {"middle": self.fields.middle, "spread": self.fields.spread}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self.fields.middle[:], self.fields.spread[:] = arrays["middle"], arrays["spread"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _FieldEncoder(Encoder):
    spikes: str = quantity("regular", "", "regular or at random times", kind="word", words=("regular", "poisson"))

    def _fields(self, kind: str, space: gymnasium.Space[Any], **words: Any) -> Shown:
        from neuro.coding.fields import FIELDS
        from neuro.coding.spaces import dimensions_of

        columns, dimensions = self.columns(space), dimensions_of(space)
        fields = FIELDS[kind]([dimensions[k] for k in columns], **words)
        some = self.key is not None or self.dimensions is not None
        return _OfFields(fields, columns if some else slice(None), self.spikes == "poisson")


@dataclass(frozen=True, kw_only=True, eq=False)
class places(_FieldEncoder):
    """Place cells, see `neuro.coding.Places`."""

    group: int = quantity(2, "", "dimensions that a group of grids sees together", kind="integer", at_least=1)
    fields: int = quantity(6, "", "fields of a grid along a continuous dimension", kind="integer", at_least=2)
    active: int = quantity(24, "", "about how many neurons are active at a time", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the place cells."""
        return self._fields("places", space, group=self.group, fields=self.fields, active=self.active)


@dataclass(frozen=True, kw_only=True, eq=False)
class tiles(_FieldEncoder):
    """Tile coding, see `neuro.coding.Tiles`."""

    group: Any = quantity(None, "", "dimensions that a grid sees; all if not given", kind="integer", at_least=1)
    fields: int = quantity(6, "", "fields of a grid along a continuous dimension", kind="integer", at_least=2)
    active: int = quantity(8, "", "about how many neurons are active at a time", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the tiles."""
        return self._fields("tiles", space, group=self.group, fields=self.fields, active=self.active)


@dataclass(frozen=True, kw_only=True, eq=False)
class one_hot(_FieldEncoder):
    """A neuron for each value of each dimension, see `neuro.coding.OneHot`."""

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the neurons."""
        return self._fields("one_hot", space)


@dataclass(frozen=True, kw_only=True, eq=False)
class population(_FieldEncoder):
    """A population with tuning curves along each dimension, see `neuro.coding.Population`."""

    group: int = quantity(1, "", "dimensions to which a neuron is tuned", kind="integer", at_least=1)
    fields: int = quantity(8, "", "bells along a continuous dimension", kind="integer", at_least=3)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the neurons."""
        return self._fields("population", space, group=self.group, fields=self.fields)


class _Rates(Shown):
    """Rates as a function of the numbers that are observed."""

    def __init__(self, encoder: Encoder, space: gymnasium.Space[Any], rates: Callable[[Floats], Floats]) -> None:
        columns = encoder.columns(space)
        some = encoder.key is not None or encoder.dimensions is not None
        self._columns, self.size, self._rates = columns if some else slice(None), columns.size, rates

    def rates(self, observations: Floats) -> Floats:
        return self._rates(observations[:, self._columns])


@dataclass(frozen=True, kw_only=True, eq=False)
class shares(Encoder):
    """Rates that share a total: each neuron has its number's share of the sum, so that few events steer like many.

    Source: the coding of the drone's camera, of which a field is a number of the observation.
    """

    gives: ClassVar[str] = "rates"
    total: float = quantity(400.0, "Hz", "rate of all neurons together", above=0)
    of: str = quantity(
        "all", "", "the sum of all, of its row, or beyond twice the mean", kind="word", words=("all", "rows", "peaks")
    )
    most: float = quantity(400.0, "Hz", "rate of a neuron at most", above=0)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder; rows are those of the population."""

        def rates(observations: Floats) -> Floats:
            counts = observations
            if self.of == "peaks":
                counts = np.maximum(observations - 2.0 * observations.mean(axis=1, keepdims=True), 0.0)
            if self.of == "rows":
                counts = observations.reshape(len(observations), shape[0], -1)
            sums = counts.sum(axis=-1, keepdims=True)
            if self.of == "rows":
                sums *= shape[0]
            sums += sums == 0.0  # without events all rates are 0
            spread: Floats = (counts / sums).reshape(observations.shape)
            spread *= self.total
            return np.minimum(self.most, spread, out=spread)

        return _Rates(self, space, rates)


@dataclass(frozen=True, kw_only=True, eq=False)
class rates(Encoder):
    """A rate in proportion to each number; below 0 it is 0."""

    gives: ClassVar[str] = "rates"
    rate: float = quantity(20.0, "Hz", "for a number of 1", above=0)
    most: float = quantity(400.0, "Hz", "rate of a neuron at most", above=0)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder."""
        return _Rates(self, space, lambda observations: np.clip(self.rate * observations, 0.0, self.most))


class _Pulse(Shown):
    def __init__(self, at: float, neurons: int) -> None:
        self._at, self._neurons = at, neurons
        self._made: dict[tuple[int, int], Spikes] = {}

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        copies, neurons = len(observations), self._neurons
        if (copies, ticks) not in self._made:
            tick = min(ticks, max(1, round(self._at * ticks)))
            offsets = np.arange(copies + 1) * neurons
            made = offsets, np.full(copies * neurons, tick), np.tile(np.arange(neurons), copies)
            self._made = {(copies, ticks): made}
        return self._made[copies, ticks]


@dataclass(frozen=True, kw_only=True, eq=False)
class pulse(Encoder):
    """A spike of each neuron in each control step: the actors choose then."""

    at: float = quantity(0.95, "", "when, as a share of the step", above=0, at_most=1)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder."""
        return _Pulse(self.at, int(np.prod(shape)))


class _Events(Shown):
    def __init__(self, choice: events, shape: tuple[int, ...]) -> None:
        self._choice, self._shape = choice, shape

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        parts, offsets, neurons = [], [0], int(np.prod(self._shape))
        *first, height, width = self._shape
        for info in infos:
            events = info.get(self._choice.info)
            if events is None:  # the first observation of an episode may come without
                offsets.append(offsets[-1])
                continue
            y, x = np.asarray(events.y) // self._choice.scale, np.asarray(events.x) // self._choice.scale
            if x.size and (int(x.max()) >= width or int(y.max()) >= height):
                message = f"events: found an event at ({x.max()}, {y.max()}): expected a sensor of {width} x {height}"
                raise ModelError(message)
            ids = y.astype(np.int64) * width + x
            if first:
                ids += np.asarray(events.p, dtype=np.int64) * height * width
            span = max(1.0, self._choice.step_us)
            tick = np.clip((np.asarray(events.t) % span * ticks / span).astype(np.int64) + 1, 1, ticks)
            one = np.unique(tick * neurons + ids)
            parts.append(one)
            offsets.append(offsets[-1] + one.size)
        joined = np.concatenate(parts) if parts else np.zeros(0, np.int64)
        return np.array(offsets), joined // neurons, joined % neurons


@dataclass(frozen=True, kw_only=True, eq=False)
class events(Encoder):
    """The events of an event camera, pixel by pixel, at their times in the step; twice in a tick counts once.

    A population of shape [2, height, width] has one map for each polarity, a population of [height, width] takes both.
    """

    info: str = quantity("events", "", "the word of the environment's info that has them", kind="name")
    scale: int = quantity(1, "px", "in a row and in a column that are one neuron", kind="integer", at_least=1)
    step_us: float = quantity(50_000.0, "us", "time of the camera in a control step", above=0)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder.

        Raises:
            ModelError: the population has another shape.
        """
        if len(shape) not in (2, 3) or (len(shape) == 3 and shape[0] != 2):
            raise ModelError(f"events: a population of shape {list(shape)}: expected [height, width] or [2, ...]")
        return _Events(self, shape)


def _box(name: str, space: Any) -> Any:
    """The space, if its actions are numbers with bounds."""
    from gymnasium import spaces

    if not isinstance(space, spaces.Box) or not space.is_bounded():
        raise ModelError(f"{name}: action space {space}: expected a Box with finite bounds", hint="winner takes others")
    return space


def _numbers(name: str, space: Any, neurons: int, expected: int) -> None:
    if neurons != expected:
        raise ModelError(f"{name}: {neurons} neurons for actions of {space}: expected {expected}")


@dataclass(frozen=True, kw_only=True, eq=False)
class winner(Decoder):
    """The neurons with most spikes of each population, the first of equal ones, are the choice for a number."""

    votes: int = quantity(1, "", "neurons side by side that stand for one choice together", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder; along a number of a Box the neurons stand for actions between its bounds."""
        from gymnasium import spaces

        from neuro.coding.spaces import actions_of

        box = isinstance(space, spaces.Box)
        numbers = int(np.prod(space.shape or ())) if box else 1
        circuits, rest = divmod(len(sizes), max(1, numbers))
        if box and (rest or not circuits):
            raise ModelError(f"winner: {len(sizes)} populations for actions of {space}: expected {numbers}, or more")
        actions = actions_of(space, sizes[0] // self.votes if box else 2, circuits if box else 1)
        expected = [self.votes * size for size in actions.sizes]
        if list(sizes) != expected:
            message = f"winner: populations of {list(sizes)} neurons for actions of {space}"
            raise ModelError(f"{message}: expected {len(expected)} of {', '.join(map(str, expected))}")
        one, *others = self.of
        if not others:
            return lambda counts: actions.of(self._winners(counts[one])[:, None])
        return lambda counts: actions.of(np.array([self._winners(counts[name]) for name in self.of]).T)

    def _winners(self, fired: Ints) -> Ints:
        """Return the choice of a population in each copy, (copies,)."""
        if self.votes > 1:
            fired = fired.reshape(len(fired), -1, self.votes).sum(axis=2)
        winners: Ints = fired.argmax(axis=1)
        return winners

    def chosen(self, counts: Mapping[str, Ints], population: str) -> Bools:
        """Return which neurons of a population voted for the action."""
        if population not in self.of:
            raise ModelError(
                f"others: population '{population}' chooses no action: expected one of {', '.join(self.of)}"
            )
        fired = counts[population]
        chosen: Bools = np.arange(fired.shape[1]) // self.votes == self._winners(fired)[:, None]
        return chosen


@dataclass(frozen=True, kw_only=True, eq=False)
class difference(Decoder):
    """Pairs of neurons pull a number up and down: gain times the difference of their spikes over the most possible.

    Source: Mosca, MSc thesis, 2020, eq. 129.
    """

    gain: Any = quantity(1.0, "", "factor, one for all or one for each number", above=0, arrays=True)

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder: neurons 0 and 1 are the pair of the first number."""
        box, pairs = _box("difference", space), sum(sizes) // 2
        _numbers("difference", space, sum(sizes), 2 * int(np.prod(box.shape)))
        low, high, shape = box.low.astype(np.float64), box.high.astype(np.float64), (-1, *box.shape)
        gain = np.asarray(self.gain, np.float64)
        if gain.size not in (1, pairs):
            raise ModelError(f"difference: gain = {gain.tolist()}: expected a number or a list of {pairs}")
        factor = (np.broadcast_to(gain, (pairs,)) / most[0]).reshape(box.shape)
        names = self.of

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            each = [counts[name] for name in names]
            fired = each[0] if len(each) == 1 else np.concatenate(each, axis=1)
            actions: Floats = factor * (fired[:, 0::2] - fired[:, 1::2]).reshape(shape)
            np.maximum(actions, low, out=actions)  # with the next one half as long as clip
            np.minimum(actions, high, out=actions)
            return actions

        return act


@dataclass(frozen=True, kw_only=True, eq=False)
class mean(Decoder):
    """The mean of what the neurons stand for, spread evenly between the bounds, weighted by their spikes."""

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder; without a spike the action is in the middle."""
        box = _box("mean", space)
        low, high = (np.ravel(each).astype(np.float64) for each in (box.low, box.high))
        if len(sizes) != low.size:
            raise ModelError(f"mean: {len(sizes)} populations for actions of {space}: expected {low.size}")
        values = [np.linspace(a, b, n) for a, b, n in zip(low, high, sizes, strict=True)]
        names = self.of

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            numbers = []
            for name, stands_for in zip(names, values, strict=True):
                fired = counts[name]
                spikes = fired.sum(axis=1)
                total = fired @ stands_for
                numbers.append(np.where(spikes > 0, total / np.maximum(spikes, 1), stands_for.mean()))
            return np.stack(numbers, axis=1).reshape(-1, *box.shape).astype(box.dtype)

        return act


@dataclass(frozen=True, kw_only=True, eq=False)
class counts(Decoder):
    """Each neuron is a number of the action: offset + gain times its spikes, within the bounds."""

    gain: float = quantity(1.0, "", "for a spike", nonzero=True)
    offset: float = quantity(0.0, "", "without a spike")

    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder."""
        box, names = _box("counts", space), self.of
        _numbers("counts", space, sum(sizes), int(np.prod(box.shape)))
        low, high = box.low.astype(np.float64), box.high.astype(np.float64)

        def act(counts: Mapping[str, Ints]) -> npt.NDArray[Any]:
            fired = np.concatenate([counts[name] for name in names], axis=1).reshape(-1, *box.shape)
            return np.asarray(np.clip(self.offset + self.gain * fired, low, high).astype(box.dtype))

        return act


class _Reward(Taught):
    def __init__(self, choice: reward) -> None:
        self._share = 0.0 if choice.less is None else 1.0 / choice.less
        self._mean = 0.0

    def values(self, moment: Moment) -> Floats:
        excess = np.where(moment.last, 0.0, moment.rewards - self._mean)
        for value in moment.rewards[~moment.last] if self._share else ():
            self._mean += (float(value) - self._mean) * self._share
        return excess[:, None]

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {"mean": np.array([self._mean])}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self._mean = float(arrays["mean"][0])


@dataclass(frozen=True, kw_only=True, eq=False)
class reward(Teacher):
    """The reward of the step, or what it exceeds a running mean by."""

    less: Any = quantity(None, "", "steps of the running mean that is subtracted; none if not given", at_least=1)

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""
        return _Reward(self)


class _Info(Taught):
    def __init__(self, key: str) -> None:
        self._key, self._numbers = key, 1

    def values(self, moment: Moment) -> Floats:
        rows = []
        for info, last in zip(moment.infos, moment.last, strict=True):
            if last:
                rows.append(np.zeros(self._numbers))
                continue
            if self._key not in info:
                raise unknown("word of the environment's info", self._key, map(str, info))
            try:
                row = np.asarray(info[self._key], dtype=np.float64).reshape(-1)
            except (TypeError, ValueError):
                row = np.array([np.nan])
            if np.count_nonzero(np.isfinite(row)) < row.size:
                raise ModelError(f"info['{self._key}'] is {info[self._key]!r:.60}: expected finite numbers")
            self._numbers = row.size
            rows.append(row)
        return np.array(rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class info(Teacher):
    """A value of the environment's info, a number or several."""

    key: str = quantity(doc="the word of info", kind="name")

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""
        return _Info(self.key)


class _TD(Taught):
    """The error of a critic's prediction."""

    def __init__(self, choice: td, neurons: int) -> None:
        from neuro.coding.values import Novelty, RewardScale, TemporalDifference

        self._td, self._neurons, self._adapts = choice, neurons, choice.worth is not None
        self._decay: Floats = np.exp(
            -1.0 / np.asarray(() if choice.smooth is None else choice.smooth, dtype=np.float64)
        )
        self.scale = RewardScale(choice.discount, choice.worth if self._adapts else 1.0)
        self._difference = TemporalDifference(self.scale, choice.discount, self._adapts)
        self.novelty = Novelty(choice.novelty * (1.0 - choice.discount))

    def join(self, encoders: Mapping[str, Shown]) -> None:
        if self._td.novelty:
            names = [name for name, one in encoders.items() if type(one).cells is not Shown.cells]
            if self._td.places not in names:
                raise unknown("population with fields", str(self._td.places), names, path=("places",))
            encoder = encoders[self._td.places]
            self.novelty.join(encoder.cells, encoder.size)

    def begin(self, copies: int) -> None:
        self._difference.begin(copies)
        self._parts, self._since = np.zeros((copies, 2)), np.zeros(copies, dtype=np.int64)

    def explored(self, rewards: Sequence[float], returns: Sequence[float]) -> None:
        if self._adapts:
            self.scale.learn(rewards, returns)

    def values(self, moment: Moment) -> Floats:
        td, spikes = self._td, moment.counts[self._td.critic]
        counts, first = spikes.sum(axis=1), self.scale.first
        if self._decay.size:
            fired = self._smoothed(counts / self._neurons, moment).tolist()
        else:
            fired = [count / self._neurons for count in counts.tolist()]
        errors = self._difference.errors([first + (each - td.rest) / td.gain for each in fired], moment)
        if td.wait:
            self._since = np.where(moment.first, 0, self._since + 1)
            return np.asarray(np.array(errors) * (self._since >= td.wait))[:, None]
        return np.array(errors)[:, None]

    def _smoothed(self, fired: Floats, moment: Moment) -> Floats:
        """Return the spikes of a step by a kernel that rises and falls; each comes in the middle of its step."""
        slow, quick = self._td.smooth
        self._parts = self._parts * ~moment.first[:, None] * self._decay + fired[:, None] * np.sqrt(self._decay)
        smoothed: Floats = (self._parts[:, 0] - self._parts[:, 1]) / (slow - quick)
        return smoothed

    def share(self, moment: Moment) -> float:
        share = self._difference.share(moment)
        if share < 1.0:
            self.scale.shrink(share)
        self._difference.take(moment)
        if self._td.novelty:
            gained = zip(self._difference.reward, self.novelty.of(moment.observations), strict=True)
            self._difference.reward = [reward + new for reward, new in gained]
        return share

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        scale = np.array([self.scale.factor, self.scale.first, self.scale.known])
        return {"scale": scale} | ({"visits": self.novelty.counts} if self._td.novelty else {})

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self.scale.factor, self.scale.first = arrays["scale"][:2].tolist()
        self.scale.known = bool(arrays["scale"][2])
        if self._td.novelty:
            self.novelty.counts[:] = arrays["visits"]


@dataclass(frozen=True, kw_only=True, eq=False)
class td(Teacher):
    """The temporal-difference error of a critic: reward + discount V(now) - V(before), 0 at the begin of an episode.

    V is (mean spikes of a neuron of the critic in the step - rest) / gain. Where the reward has no scale of its own,
    `worth` gives it one: a typical reward in each step, for ever, is worth that much, so that V stays where the
    critic's neurons can say it; see `neuro.coding.values.RewardScale`. `novelty` adds a reward for what has seldom been
    seen: (1 - discount) novelty / sqrt(n), averaged over the `places` that stand for the state, each of which has been
    seen n times.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 6.1; a critic of spiking neurons: Fremaux,
        Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013.
    """

    delayed: ClassVar[bool] = True
    critic: str = quantity(doc="the population whose spikes say the value", kind="name")
    discount: float = quantity(0.99, "", "of the value one step later", at_least=0, below=1)
    rest: float = quantity(0.0, "", "spikes of a neuron that stand for a value of 0")
    gain: float = quantity(1.0, "", "spikes more that stand for a value of 1", above=0)
    worth: Any = quantity(
        None, "", "of a typical reward in each step, for ever; rewards as they are if not given", above=0
    )
    smooth: Any = quantity(
        None,
        "",
        "steps over which spikes count, fall and rise of the kernel; those of the step if not given",
        kind="array",
        arrays=True,
        above=0,
    )
    wait: int = quantity(
        0, "", "steps of an episode until the value has settled, without error", kind="integer", at_least=0
    )
    novelty: float = quantity(0.0, "", "reward for a state that has not been seen, in typical rewards", at_least=0)
    places: Any = quantity(None, "", "the population whose neurons with fields tell what has been seen", kind="name")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.smooth is not None and (len(self.smooth) != 2 or self.smooth[0] <= self.smooth[1]):
            message = f"td.smooth = {list(self.smooth)}: expected [fall, rise], the fall longer"
            raise ModelError(message, path=("smooth",))

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""
        return _TD(self, critic_size)


class _Same(Taught):
    def __init__(self, size: float | None) -> None:
        from neuro.coding.values import ErrorScale

        self._scale = ErrorScale(size)

    def begin(self, copies: int) -> None:
        self._scale.begin()

    def of(self, values: Floats) -> Floats:
        return self._scale.of(values)


@dataclass(frozen=True, kw_only=True, eq=False)
class same(Teacher):
    """The value of another signal of the world, before its scale; with a `size` it is brought to that size."""

    as_: str = quantity(doc="the other signal", kind="name")
    size: Any = quantity(
        None, "", "root mean square of the value, from its own of late; as it is if not given", above=0
    )

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher: the loop gives it the value of the other one."""
        return _Same(self.size)
