"""A network meets a world: encoders of observations, decoders of actions, and what teaches its signals.

A control step goes round once: encoders show the observation, the network runs, the decoder reads its spikes, the
environment takes the action, and teachers set the signals for the next step.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro.coding.work import Work, on_numbers
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import quantity
from neuro.core.registry import Registry

if TYPE_CHECKING:
    import gymnasium


Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]
Bools: TypeAlias = npt.NDArray[np.bool_]
Spikes: TypeAlias = tuple[Ints, Ints, Ints]
"""Offsets of the copies, ticks within the control step and ids, as `neuro.Stepper.step` takes them."""
Infos: TypeAlias = Sequence[Mapping[str, Any]]


@dataclass(slots=True)
class Moment:
    """A control step of all copies, after the environment has answered.

    Attributes:
        counts: spikes of each neuron by population, (copies, neurons).
        first: whether the observation that was shown began an episode, (copies,).
        last: whether it was the last one of an episode, whose action had no effect.
        rewards: of the environment's step, 0 where an episode began with it.
        ended: whether that step ended an episode by itself, and did not cut it off.
        infos: what the environment said beside, one for each copy.
        observations: those after the step, (copies, dimensions).
        time: of the network since learning began, ms.
        steps: of all environments so far.
        returns: of the episodes that are over.
    """

    counts: Mapping[str, Ints]
    first: Bools
    last: Bools
    rewards: Floats
    ended: Bools
    infos: Infos
    observations: Floats
    time: float
    steps: int
    returns: Sequence[float]


class Shown:
    """An encoder in use, for one space of observations.

    Attributes:
        size: how many neurons it needs; 0 for any number.
        active: neurons that `cells` gives, for the count of operations; 0 if the number is not known.
    """

    size = 0
    active = 0

    def learn(self, observations: Floats) -> None:
        """Take the bounds of unbounded dimensions from what random moves have shown, (observations, dimensions)."""

    def rewarded(self, rewards: Floats) -> None:
        """Take the rewards of the last actions, (copies,), before `spikes` or `rates`; 0 where an episode begins."""

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        """Spikes of a control step of so many ticks, for the observations of all copies."""
        raise NotImplementedError

    def rates(self, observations: Floats) -> Floats:
        """Rates of a control step in Hz, (copies, neurons)."""
        raise NotImplementedError

    def cells(self, observation: Floats) -> Ints:
        """The neurons that stand for one observation, (dimensions,); of an encoder with fields."""
        raise NotImplementedError

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work | None:
        """Return the operations for one observation; None if they are not counted.

        Args:
            ticks: ticks of the control step.
            shape: shape of the population.
        """
        return None

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All that it has learnt, for a checkpoint."""
        return {}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from what `arrays` gave."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Encoder(Choice):
    """Base of the encoders: observations to spikes or rates of a population.

    Class attributes:
        gives: "spikes", for a spike_generator, or "rates", for a poisson_generator.
    """

    kind: ClassVar[str] = "encoder"
    gives: ClassVar[str] = "spikes"
    key: Any = quantity(None, "", "the part of an observation that is a Dict; all of it if not given", kind="name")
    dimensions: Any = quantity(None, "", "which numbers of it, counted from 0; all if not given", kind="ids")

    @abstractmethod
    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder for a space of observations and a population of this shape.

        Raises:
            ModelError: the observations are of another kind, or the number of neurons is another.
        """

    def columns(self, space: gymnasium.Space[Any]) -> Ints:
        """The numbers of an observation that it sees, in the order of `spaces.flat`.

        Raises:
            ModelError: there is no such part.
        """
        from neuro.coding.spaces import dimensions_of

        names = [one.name for one in dimensions_of(space)]
        columns = np.arange(len(names))
        if self.key is not None:
            begin = f"observation[{self.key!r}]"
            columns = np.array([k for k, name in enumerate(names) if name.startswith(begin)], dtype=np.int64)
            if not columns.size:
                raise unknown("part of the observation", self.key, getattr(space, "spaces", ()), path=("key",))
        if self.dimensions is not None:
            if max(self.dimensions, default=0) >= columns.size:
                message = f"dimensions = {list(self.dimensions)}: expected numbers below {columns.size}"
                raise ModelError(message, path=("dimensions",))
            columns = columns[np.asarray(self.dimensions, dtype=np.int64)]
        return columns


Act: TypeAlias = Callable[[Mapping[str, Ints]], npt.NDArray[Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Decoder(Choice):
    """Base of the decoders: spikes of populations in a control step to the action."""

    kind: ClassVar[str] = "decoder"
    of: Any = quantity(doc="the population whose spikes are read, or several", kind="names")

    @abstractmethod
    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder.

        Args:
            space: of the actions.
            sizes: neurons of each population of `of`.
            most: spikes of a neuron that are possible in a control step, of each.

        Returns:
            a function of the counts by population, (copies, neurons), that gives the actions, copies first.

        Raises:
            ModelError: the populations do not fit the space.
        """

    def work(self, sizes: Sequence[int]) -> Work | None:
        """Return the operations for an action, by the sizes of its populations; None if not counted."""
        return None

    def chosen(self, counts: Mapping[str, Ints], population: str) -> Bools:
        """Return which neurons of a population voted for the action that the counts give, (copies, neurons).

        Raises:
            ModelError: the neurons of the population do not choose between actions.
        """
        raise ModelError(f"others: {self.name} chooses no action: expected the decoder winner")


class Taught:
    """A teacher in use.

    Attributes:
        several: whether its value may be several numbers.
    """

    several = False

    def join(self, encoders: Mapping[str, Shown]) -> None:
        """Connect to the encoders in use, by population, before learning.

        Raises:
            ModelError: the teacher needs another encoder.
        """

    def begin(self, copies: int) -> None:
        """Begin a block of so many copies."""

    def explored(self, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """See the rewards of random moves, before anything is learnt."""

    def values(self, moment: Moment) -> Floats:
        """The values of its signal from now on, (copies, 1) or (copies, numbers)."""
        raise NotImplementedError

    def of(self, values: Floats) -> Floats:
        """Return the values of the signal for values of another signal, (copies, 1) or (copies, numbers)."""
        return values

    def share(self, moment: Moment) -> float:
        """Return the factor on the weights onto the critic after this step; 1 for no change."""
        return 1.0

    def work(self) -> Work | None:
        """Return the operations for a value of the signal; None if the operations are not counted."""
        return None

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All that it keeps from block to block."""
        return {}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from what `arrays` gave."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Teacher(Choice):
    """Base of what sets a signal after a control step."""

    kind: ClassVar[str] = "teacher"
    delayed: ClassVar[bool] = False
    """Whether the value tells of the action before the last one."""
    scale: float = quantity(1.0, "", "factor on the value")
    opposed: bool = quantity(False, "", "whether neurons of a pair hear opposite signs", kind="boolean")
    others: float = quantity(1.0, "", "share of the value for neurons that voted for another action than was taken")
    settle: Any = quantity(None, "ms", "time of the network after which the value is halved, then 1/3, ...", above=0)

    @abstractmethod
    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""

    def spread(self, values: Floats, size: int, time: float) -> Floats:
        """The values of a signal for the neurons that hear it, (copies, 1) or (copies, size).

        Raises:
            ModelError: the numbers are neither one nor as many as neurons or pairs.
        """
        factor = self.scale if self.settle is None else self.scale / (1.0 + time / self.settle)
        scaled = factor * values
        if self.opposed:
            pairs = np.empty((len(scaled), 2 * scaled.shape[1]))
            pairs[:, 0::2], pairs[:, 1::2] = scaled, -scaled
            scaled = pairs
            if scaled.shape[1] == 2 and size % 2 == 0:
                scaled = np.tile(scaled, size // 2)
        if scaled.shape[1] not in (1, size):
            message = f"{self.name}: {scaled.shape[1]} numbers for a signal to {size} neurons: expected 1 or {size}"
            raise ModelError(message)
        return scaled

    def spread_work(self, size: int, several: bool) -> Work:
        """Return the operations of `spread` and `others` for one copy: a factor and perhaps a sign for each number.

        Args:
            size: neurons that hear the signal.
            several: whether the teacher gives several numbers, then at most one for each neuron or pair.
        """
        numbers = max(1, size // (1 + self.opposed)) if several else 1
        settle, shares = 2 * (self.settle is not None), size * (self.others != 1.0)
        return on_numbers(numbers * (1 + self.opposed) + settle + shares, numbers + size)


def _complete(part: Any) -> Any:
    if "made" in getattr(part, "__abstractmethods__", ()) or part.made in (Encoder.made, Decoder.made, Teacher.made):
        raise TypeError(f"{part.kind} '{part.__name__}' has no 'made': expected one, see neuro.coding.{part.kind}")
    return part


def _table(base: type[Choice], own: Sequence[str]) -> Registry[type[Any]]:
    return Registry(
        base.kind,
        dict.fromkeys(own, f"neuro.coding.world_{base.kind}s"),
        takes=lambda part: isinstance(part, type) and issubclass(part, base),
        group=f"neuro.{base.kind}s",
        complete=_complete,
    )


ENCODERS = _table(
    Encoder, ("places", "tiles", "one_hot", "population", "shares", "rates", "pulse", "rewards", "events")
)
"""Encoders by name."""
DECODERS = _table(Decoder, ("winner", "difference", "mean", "counts"))
"""Decoders by name."""
TEACHERS = _table(Teacher, ("reward", "info", "td", "same"))
"""What sets signals, by name."""
