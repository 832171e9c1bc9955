"""The teachers of this package, see `neuro.coding.world`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.coding.work import Work, on_numbers
from neuro.coding.world import Floats, Moment, Shown, Taught, Teacher
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import quantity


class _Reward(Taught):
    def __init__(self, choice: reward) -> None:
        self._share = 0.0 if choice.less is None else 1.0 / choice.less
        self._mean = 0.0

    def values(self, moment: Moment) -> Floats:
        excess = np.where(moment.last, 0.0, moment.rewards - self._mean)
        for value in moment.rewards[~moment.last] if self._share else ():
            self._mean += (float(value) - self._mean) * self._share
        return excess[:, None]

    def work(self) -> Work:
        return on_numbers(3 if self._share else 0, 2)  # the excess, and the two operations of the mean

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {"mean": np.array([self._mean])}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self._mean = float(arrays["mean"][0])


@dataclass(frozen=True, kw_only=True, eq=False)
class reward(Teacher):
    """Reward of the step, or the difference between the reward and a running mean."""

    less: Any = quantity(None, "", "steps of the running mean that is subtracted; by default no mean", at_least=1)

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""
        return _Reward(self)


class _Info(Taught):
    several = True

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

    def work(self) -> Work:
        return Work()  # the environment computes the numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class info(Teacher):
    """Entry of the environment's info: one or several numbers."""

    key: str = quantity(doc="key of the info", kind="name")

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""
        return _Info(self.key)


class _TD(Taught):
    """Error of a critic's prediction."""

    def __init__(self, choice: td, neurons: int) -> None:
        from neuro.coding.values import Novelty, RewardScale, TemporalDifference

        self._td, self._neurons, self._adapts = choice, neurons, choice.worth is not None
        self._decay: Floats = np.exp(
            -1.0 / np.asarray(() if choice.smooth is None else choice.smooth, dtype=np.float64)
        )
        self.scale = RewardScale(choice.discount, choice.worth if self._adapts else 1.0)
        self._difference = TemporalDifference(self.scale, choice.discount, self._adapts)
        self.novelty = Novelty(choice.novelty * (1.0 - choice.discount))

    def work(self) -> Work | None:
        from neuro.coding.fields import PERIOD

        td, cells = self._td, Work()
        # The mean of the critic; rest, gain and first value; the error; the scale of the reward.
        macs = (self._neurons + 1) + 3 + 2 + 1
        macs += 6 * (self._decay.size > 0) + 2 * (td.wait > 0)  # the kernel; a count and a comparison
        macs += 6 * self._adapts  # the running mean of values, and the comparisons of `RewardScale.excess`
        if td.novelty:
            encoder = self._places
            cell_work = encoder.work(PERIOD + 1, (encoder.size,))
            if cell_work is None or not encoder.active:
                return None
            cells = cell_work
            macs += 4 * encoder.active + 2  # a count, root, division and sum for each place; the mean and the reward
        return on_numbers(macs, self._neurons + 2) + cells

    def join(self, encoders: Mapping[str, Shown]) -> None:
        if self._td.novelty:
            names = [name for name, encoder in encoders.items() if type(encoder).cells is not Shown.cells]
            if self._td.places not in names:
                raise unknown("population with fields", str(self._td.places), names, path=("places",))
            encoder = encoders[self._td.places]
            self.novelty.join(encoder.cells, encoder.size)
            self._places = encoder

    def begin(self, copies: int) -> None:
        self._difference.begin(copies)
        self._parts, self._since = np.zeros((copies, 2)), np.zeros(copies, dtype=np.int64)

    def explored(self, rewards: Sequence[float], returns: Sequence[float]) -> None:
        if self._adapts:
            self.scale.learn(rewards, returns)

    def values(self, moment: Moment) -> Floats:
        td, spikes = self._td, moment.counts[self._td.critic]
        counts, initial = spikes.sum(axis=1), self.scale.first
        if self._decay.size:
            fired = self._smoothed(counts / self._neurons, moment).tolist()
        else:
            fired = [count / self._neurons for count in counts.tolist()]
        errors = self._difference.errors([initial + (rate - td.rest) / td.gain for rate in fired], moment)
        if td.wait:
            self._since = np.where(moment.first, 0, self._since + 1)
            return np.asarray(np.array(errors) * (self._since >= td.wait))[:, None]
        return np.array(errors)[:, None]

    def _smoothed(self, fired: Floats, moment: Moment) -> Floats:
        """Filter the spikes of a step by a kernel that rises and falls. Spikes count from the middle of their step."""
        fall, rise = self._td.smooth
        self._parts = self._parts * ~moment.first[:, None] * self._decay + fired[:, None] * np.sqrt(self._decay)
        smoothed: Floats = (self._parts[:, 0] - self._parts[:, 1]) / (fall - rise)
        return smoothed

    def share(self, moment: Moment) -> float:
        share = self._difference.share(moment)
        if share < 1.0:
            self.scale.shrink(share)
        self._difference.take(moment)
        if self._td.novelty:
            reward_pairs = zip(self._difference.reward, self.novelty.of(moment.observations), strict=True)
            self._difference.reward = [reward + new for reward, new in reward_pairs]
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
    """Temporal-difference error of a critic: reward + discount V(now) - V(before); 0 at the beginning of an episode.

    V is (mean spikes of a neuron of the critic in the step - rest) / gain. `worth` scales the rewards: a typical reward
    in each step, for ever, has the value `worth`, so that V stays within the range of the critic's neurons; see
    `neuro.coding.values.RewardScale`. `novelty` adds a reward for rare states: (1 - discount) novelty / sqrt(n),
    averaged over the active neurons of `places`, where n is the number of times that a neuron has been active.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 6.1; a critic of spiking neurons: Fremaux,
        Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013.
    """

    delayed: ClassVar[bool] = True
    critic: str = quantity(doc="population whose spikes encode the value", kind="name")
    discount: float = quantity(0.99, "", "factor on the value one step later", at_least=0, below=1)
    rest: float = quantity(0.0, "", "number of spikes of a neuron for a value of 0")
    gain: float = quantity(1.0, "", "number of additional spikes for a value of 1", above=0)
    worth: Any = quantity(
        None, "", "value of a typical reward in each step, for ever; by default rewards are not scaled", above=0
    )
    smooth: Any = quantity(
        None,
        "",
        "fall and rise of the kernel that filters spikes, in steps; by default only spikes of the present step count",
        kind="array",
        arrays=True,
        above=0,
    )
    wait: int = quantity(
        0, "", "first steps of an episode, whose error is 0 until the value settles", kind="integer", at_least=0
    )
    novelty: float = quantity(0.0, "", "reward for a state that has not been seen, in typical rewards", at_least=0)
    places: Any = quantity(None, "", "population with fields that counts visits for novelty", kind="name")

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

    def work(self) -> Work:
        # A square, the running mean, a limit, a root, a division and a product; the mean is over one number.
        return on_numbers(7 * self._scale.scales, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class same(Teacher):
    """Value of another signal of the world, before the factor `scale`. With `size` the value is scaled to that size."""

    as_: str = quantity(doc="name of the other signal", kind="name")
    size: Any = quantity(
        None, "", "root mean square to which the value is scaled; by default it is not scaled", above=0
    )

    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher. The loop passes the value of the other signal to the teacher."""
        return _Same(self.size)
