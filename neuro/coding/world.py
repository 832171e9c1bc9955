"""A network in a world: encoders of observations, decoders of actions, and teachers of its signals.

A control step has five parts: encoders show the observation, the network runs, the decoder reads its spikes, the
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
"""Offsets of the copies, ticks within the control step and ids, as for `neuro.Stepper.step`."""
Infos: TypeAlias = Sequence[Mapping[str, Any]]


@dataclass(slots=True)
class Moment:
    """A control step of all copies, after the environment has answered.

    Attributes:
        counts: number of spikes of each neuron by population, (copies, neurons).
        first: whether the shown observation is the first of an episode, (copies,).
        last: whether the shown observation is the last of an episode; its action then has no effect, (copies,).
        rewards: rewards of the environment's step, 0 for a step that began an episode, (copies,).
        ended: whether the step ended an episode, other than by a cut-off, (copies,).
        infos: info of the environment for each copy.
        observations: observations after the step, (copies, dimensions).
        time: time of the network since learning began, ms.
        steps: number of steps of all environments so far.
        returns: returns of the finished episodes.
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
        size: required number of neurons; 0 for any number.
        active: number of neurons returned by `cells`, for the count of operations; 0 if unknown.
    """

    size = 0
    active = 0

    def learn(self, observations: Floats) -> None:
        """Learn the range of unbounded dimensions from observations of random moves, (observations, dimensions)."""

    def rewarded(self, rewards: Floats) -> None:
        """Receive the rewards of the last actions, (copies,), before `spikes` or `rates`; 0 at an episode's start."""

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        """Return the spikes of a control step of `ticks` ticks for the observations of all copies."""
        raise NotImplementedError

    def rates(self, observations: Floats) -> Floats:
        """Return the rates in a control step in Hz, (copies, neurons)."""
        raise NotImplementedError

    def cells(self, observation: Floats) -> Ints:
        """Return the active neurons for one observation, (dimensions,). Only encoders with fields have this method."""
        raise NotImplementedError

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work | None:
        """Return the operations for one observation; None without a count.

        Args:
            ticks: number of ticks of the control step.
            shape: shape of the population.
        """
        return None

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the learnt state, for a checkpoint."""
        return {}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore the state that `arrays` returned."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Encoder(Choice):
    """Base of the encoders: observations to spikes or rates of a population.

    Class attributes:
        gives: "spikes", for a spike_generator, or "rates", for a poisson_generator.
    """

    kind: ClassVar[str] = "encoder"
    gives: ClassVar[str] = "spikes"
    key: Any = quantity(None, "", "key of the part of a Dict observation; by default all parts", kind="name")
    dimensions: Any = quantity(None, "", "indices of the numbers in this part, from 0; by default all", kind="ids")

    @abstractmethod
    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder for a space of observations and a population of this shape.

        Raises:
            ModelError: the encoder cannot encode these observations, or needs another number of neurons.
        """

    def columns(self, space: gymnasium.Space[Any]) -> Ints:
        """Return the indices of the encoded numbers, in the order of `spaces.flat`.

        Raises:
            ModelError: the observation has no such part or number.
        """
        from neuro.coding.spaces import dimensions_of

        names = [dimension.name for dimension in dimensions_of(space)]
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
    of: Any = quantity(doc="population whose spikes are read, or a list of populations", kind="names")

    @abstractmethod
    def made(self, space: gymnasium.Space[Any], sizes: Sequence[int], most: Sequence[float]) -> Act:
        """Make the decoder.

        Args:
            space: space of the actions.
            sizes: number of neurons of each population of `of`.
            most: largest possible number of spikes of a neuron in a control step, for each population.

        Returns:
            A function from the counts by population, (copies, neurons), to the actions, copies first.

        Raises:
            ModelError: the populations do not fit the space.
        """

    def work(self, sizes: Sequence[int]) -> Work | None:
        """Return the operations for an action, from the sizes of its populations; None without a count."""
        return None

    def chosen(self, counts: Mapping[str, Ints], population: str) -> Bools:
        """Return True for each neuron of a population that voted for the chosen action, (copies, neurons).

        Raises:
            ModelError: the neurons of the population do not choose between actions.
        """
        raise ModelError(f"others: {self.name} chooses no action: expected the decoder winner")


class Taught:
    """A teacher in use.

    Attributes:
        several: True if the value may consist of several numbers.
    """

    several = False

    def join(self, encoders: Mapping[str, Shown]) -> None:
        """Connect to the encoders in use, by population, before learning.

        Raises:
            ModelError: the teacher needs another encoder.
        """

    def begin(self, copies: int) -> None:
        """Begin a block of training with a number of copies."""

    def explored(self, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Receive the rewards and returns of random moves, before learning."""

    def values(self, moment: Moment) -> Floats:
        """Return the new values of the signal, (copies, 1) or (copies, numbers)."""
        raise NotImplementedError

    def of(self, values: Floats) -> Floats:
        """Return the values of the signal from the values of another signal, both (copies, 1) or (copies, numbers)."""
        return values

    def share(self, moment: Moment) -> float:
        """Return the factor on the weights onto the critic after this step, 1 for no change."""
        return 1.0

    def work(self) -> Work | None:
        """Return the operations for a value of the signal; None without a count."""
        return None

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the state that lasts from block to block."""
        return {}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore the state that `arrays` returned."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Teacher(Choice):
    """Base of the teachers. A teacher sets a signal after each control step."""

    kind: ClassVar[str] = "teacher"
    delayed: ClassVar[bool] = False
    """True if the value belongs to the action before the last action."""
    scale: float = quantity(1.0, "", "factor on the value")
    opposed: bool = quantity(False, "", "whether the neurons of a pair receive opposite signs", kind="boolean")
    others: float = quantity(1.0, "", "share of the value for neurons that voted for another action")
    settle: Any = quantity(None, "ms", "time after which the value is 1/2; after twice this time 1/3", above=0)

    @abstractmethod
    def made(self, critic_size: int = 0) -> Taught:
        """Make the teacher."""

    def spread(self, values: Floats, size: int, time: float) -> Floats:
        """Return the values of a signal for the neurons that receive it, (copies, 1) or (copies, size).

        Raises:
            ModelError: the number of values is neither 1 nor the number of neurons (with `opposed`, of pairs).
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
        """Return the operations of `spread` and `others` for one copy. Each number takes a factor, and perhaps a sign.

        Args:
            size: number of neurons that receive the signal.
            several: whether the teacher has several numbers, at most one for each neuron or pair.
        """
        numbers = max(1, size // (1 + self.opposed)) if several else 1
        settle, shares = 2 * (self.settle is not None), size * (self.others != 1.0)
        return on_numbers(numbers * (1 + self.opposed) + settle + shares, numbers + size)


def _complete(part: Any) -> Any:
    if "made" in getattr(part, "__abstractmethods__", ()) or part.made in (Encoder.made, Decoder.made, Teacher.made):
        raise TypeError(f"{part.kind} '{part.__name__}' has no 'made': expected one, see neuro.coding.{part.kind}")
    return part


def _table(base: type[Choice], names: Sequence[str]) -> Registry[type[Any]]:
    return Registry(
        base.kind,
        dict.fromkeys(names, f"neuro.coding.world_{base.kind}s"),
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
"""Teachers, which set signals, by name."""
