"""The encoders of this package, see `neuro.coding.world`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.coding.work import Work, on_numbers
from neuro.coding.world import Encoder, Floats, Infos, Ints, Shown, Spikes
from neuro.core.errors import ModelError
from neuro.core.quantities import quantity

if TYPE_CHECKING:
    import gymnasium

    from neuro.coding.fields import Fields


class _OfFields(Shown):
    """An encoder of `neuro.coding.FIELDS`."""

    def __init__(self, fields: Fields, columns: Any, poisson: bool) -> None:
        self.fields, self._columns, self._poisson, self.size = fields, columns, poisson, fields.size
        self.active = fields.active

    def learn(self, observations: Floats) -> None:
        self.fields.learn(observations[:, self._columns])

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        return self.fields.spikes(observations[:, self._columns], ticks, rng if self._poisson else None)

    def cells(self, observation: Floats) -> Ints:
        return self.fields.cells(observation[self._columns])

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work:
        return self.fields.work(ticks, self._poisson)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {"middle": self.fields.middle, "spread": self.fields.spread}

    def put(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        self.fields.middle[:], self.fields.spread[:] = arrays["middle"], arrays["spread"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _FieldEncoder(Encoder):
    spikes: str = quantity("regular", "", "kind of spike times", kind="word", words=("regular", "poisson"))

    def _fields(self, kind: str, space: gymnasium.Space[Any], **parameters: Any) -> Shown:
        from neuro.coding.fields import FIELDS
        from neuro.coding.spaces import dimensions_of

        columns, dimensions = self.columns(space), dimensions_of(space)
        fields = FIELDS[kind]([dimensions[k] for k in columns], **parameters)
        has_columns = self.key is not None or self.dimensions is not None
        return _OfFields(fields, columns if has_columns else slice(None), self.spikes == "poisson")


@dataclass(frozen=True, kw_only=True, eq=False)
class places(_FieldEncoder):
    """Place cells, see `neuro.coding.Places`."""

    group: int = quantity(2, "", "number of dimensions of a group of grids", kind="integer", at_least=1)
    fields: int = quantity(6, "", "number of fields of a grid along a continuous dimension", kind="integer", at_least=2)
    active: int = quantity(24, "", "approximate number of active neurons", kind="integer", at_least=1)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the place cells."""
        return self._fields("places", space, group=self.group, fields=self.fields, active=self.active)


@dataclass(frozen=True, kw_only=True, eq=False)
class tiles(_FieldEncoder):
    """Tile coding, see `neuro.coding.Tiles`."""

    group: Any = quantity(None, "", "number of dimensions of a grid; by default all", kind="integer", at_least=1)
    fields: int = quantity(6, "", "number of fields of a grid along a continuous dimension", kind="integer", at_least=2)
    active: int = quantity(8, "", "approximate number of active neurons", kind="integer", at_least=1)

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

    group: int = quantity(1, "", "number of dimensions to which a neuron is tuned", kind="integer", at_least=1)
    fields: int = quantity(8, "", "number of bells along a continuous dimension", kind="integer", at_least=3)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the neurons."""
        return self._fields("population", space, group=self.group, fields=self.fields)


class _Rates(Shown):
    """Rates as a function of the observed numbers, with a number of operations for each number."""

    def __init__(
        self, encoder: Encoder, space: gymnasium.Space[Any], rates: Callable[[Floats], Floats], n_operations: float
    ) -> None:
        columns = encoder.columns(space)
        has_columns = encoder.key is not None or encoder.dimensions is not None
        self._columns, self.size, self._rates = columns if has_columns else slice(None), columns.size, rates
        self._n_operations = n_operations

    def rates(self, observations: Floats) -> Floats:
        return self._rates(observations[:, self._columns])

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work:
        return on_numbers(self._n_operations * self.size, 2 * self.size)


@dataclass(frozen=True, kw_only=True, eq=False)
class shares(Encoder):
    """Rates with a fixed total, in proportion to the numbers.

    Example: the numbers 1 and 3 get a quarter and three quarters of the total.

    Source: the coding of the drone's camera, with the counts of its fields as numbers.
    """

    gives: ClassVar[str] = "rates"
    total: float = quantity(400.0, "Hz", "rate of all neurons together", above=0)
    of: str = quantity(
        "all", "", "sum over all, a row, or parts above twice the mean", kind="word", words=("all", "rows", "peaks")
    )
    most: float = quantity(400.0, "Hz", "largest rate of a neuron", above=0)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder. Rows are the rows of the population."""

        def rates(observations: Floats) -> Floats:
            counts = observations
            if self.of == "peaks":
                counts = np.maximum(observations - 2.0 * observations.mean(axis=1, keepdims=True), 0.0)
            if self.of == "rows":
                counts = observations.reshape(len(observations), shape[0], -1)
            sums = counts.sum(axis=-1, keepdims=True)
            if self.of == "rows":
                sums *= shape[0]
            sums += sums == 0.0  # if all numbers are 0, so are the rates
            spread: Floats = (counts / sums).reshape(observations.shape)
            spread *= self.total
            return np.minimum(self.most, spread, out=spread)

        # Each number takes a sum, a division, a product with the total and a limit. `peaks` also takes a sum for the
        # mean, a subtraction of twice the mean and a maximum with 0.
        return _Rates(self, space, rates, 7.0 if self.of == "peaks" else 4.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class rates(Encoder):
    """Rates in proportion to numbers; 0 for negative numbers."""

    gives: ClassVar[str] = "rates"
    rate: float = quantity(20.0, "Hz", "rate for the number 1", above=0)
    most: float = quantity(400.0, "Hz", "largest rate of a neuron", above=0)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder."""
        return _Rates(self, space, lambda observations: np.clip(self.rate * observations, 0.0, self.most), 3.0)


class _Pulse(Shown):
    def __init__(self, at: float, neurons: int) -> None:
        self._at, self._neurons = at, neurons
        self._last_spikes: dict[tuple[int, int], Spikes] = {}

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        copies, neurons = len(observations), self._neurons
        if (copies, ticks) not in self._last_spikes:
            tick = min(ticks, max(1, round(self._at * ticks)))
            offsets = np.arange(copies + 1) * neurons
            pulse_spikes = offsets, np.full(copies * neurons, tick), np.tile(np.arange(neurons), copies)
            self._last_spikes = {(copies, ticks): pulse_spikes}
        return self._last_spikes[copies, ticks]

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work:
        return Work()  # the spikes are the same in each step


@dataclass(frozen=True, kw_only=True, eq=False)
class pulse(Encoder):
    """A spike of each neuron in each control step, at the time of the choice of an action."""

    at: float = quantity(0.95, "", "time of the spikes, as a share of the step", above=0, at_most=1)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder."""
        return _Pulse(self.at, int(np.prod(shape)))


class _Rewards(Shown):
    def __init__(self, choice: rewards, neurons: int) -> None:
        self._choice, self._neurons, self._rewards = choice, neurons, np.zeros(0)

    def rewarded(self, rewards: Floats) -> None:
        self._rewards = rewards

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        n_ticks = max(1, int(self._choice.within * ticks))
        spike_counts = np.clip(np.rint(self._choice.gain * self._rewards), 0, n_ticks).astype(np.int64)
        spike_ticks = [1 + np.arange(count) * n_ticks // max(1, count) for count in spike_counts]
        offsets = np.concatenate([[0], np.cumsum(spike_counts)]) * self._neurons
        joined = np.concatenate(spike_ticks) if spike_ticks else np.zeros(0, np.int64)
        return offsets, np.repeat(joined, self._neurons), np.tile(np.arange(self._neurons), joined.size)

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work:
        # The number of spikes takes a product, a rounding and two limits; each time takes a product and a division.
        return on_numbers(4.0 + 2.0 * max(1, int(self._choice.within * ticks)), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class rewards(Encoder):
    """The reward of the last action as spikes of all neurons together, evenly spaced from the start of the step.

    A reward on which an episode ends is shown with the last observation. A negative `gain` shows punishments.
    """

    gain: float = quantity(10.0, "", "number of spikes for a reward of 1, rounded, at least 0", nonzero=True)
    within: float = quantity(0.5, "", "duration of the spikes, as a share of the step", above=0, at_most=1)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder."""
        return _Rewards(self, int(np.prod(shape)))


class _Events(Shown):
    def __init__(self, choice: events, shape: tuple[int, ...]) -> None:
        self._choice, self._shape = choice, shape

    def spikes(self, observations: Floats, infos: Infos, ticks: int, rng: np.random.Generator) -> Spikes:
        parts, offsets, neurons = [], [0], int(np.prod(self._shape))
        *polarity, height, width = self._shape
        for info in infos:
            events = info.get(self._choice.info)
            if events is None:  # the first observation of an episode may have none
                offsets.append(offsets[-1])
                continue
            y, x = np.asarray(events.y) // self._choice.scale, np.asarray(events.x) // self._choice.scale
            if x.size and (int(x.max()) >= width or int(y.max()) >= height):
                message = f"events: found an event at ({x.max()}, {y.max()}): expected a sensor of {width} x {height}"
                raise ModelError(message)
            ids = y.astype(np.int64) * width + x
            if polarity:
                ids += np.asarray(events.p, dtype=np.int64) * height * width
            span = max(1.0, self._choice.step_us)
            tick = np.clip((np.asarray(events.t) % span * ticks / span).astype(np.int64) + 1, 1, ticks)
            ticks_and_ids = np.unique(tick * neurons + ids)
            parts.append(ticks_and_ids)
            offsets.append(offsets[-1] + ticks_and_ids.size)
        joined = np.concatenate(parts) if parts else np.zeros(0, np.int64)
        return np.array(offsets), joined // neurons, joined % neurons

    def work(self, ticks: int, shape: tuple[int, ...]) -> Work:
        return Work()  # the camera sends each event to its pixel's neuron


@dataclass(frozen=True, kw_only=True, eq=False)
class events(Encoder):
    """The events of an event camera, pixel by pixel, at their times in the step. A pixel spikes at most once in a tick.

    A population of shape [2, height, width] has a map for each polarity. A population of shape [height, width] has a
    single map for both.
    """

    info: str = quantity("events", "", "key of the events in the environment's info", kind="name")
    scale: int = quantity(1, "px", "side of the square of pixels that share a neuron", kind="integer", at_least=1)
    step_us: float = quantity(50_000.0, "us", "time of the camera in a control step", above=0)

    def made(self, space: gymnasium.Space[Any], shape: tuple[int, ...]) -> Shown:
        """Make the encoder.

        Raises:
            ModelError: the shape of the population is not a shape of pixels.
        """
        if len(shape) not in (2, 3) or (len(shape) == 3 and shape[0] != 2):
            raise ModelError(f"events: a population of shape {list(shape)}: expected [height, width] or [2, ...]")
        return _Events(self, shape)
