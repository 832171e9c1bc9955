"""Batches of spikes that are kept sparse, without torch: memory grows with the spikes, not with the pixels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.coding.encoders import check_pixels, pixel_spikes
from neuro.core.clock import Clock
from neuro.core.errors import ModelError

__all__ = ["Events", "Train", "collate"]

Ints = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Train:
    """The spikes of one population in a batch, by recording, then step, then neuron; each at most once.

    Attributes:
        ends: spikes of recording b are `ends[b] : ends[b + 1]`, shape (batch + 1,), int64.
        step: in which each is emitted, from 0.
        neuron: which emits it.
    """

    ends: NDArray[np.int64]
    step: Ints
    neuron: Ints

    def of(self, recordings: Sequence[int]) -> Train:
        """Those of some recordings."""
        parts = [slice(int(self.ends[b]), int(self.ends[b + 1])) for b in recordings]
        lengths = [part.stop - part.start for part in parts]
        step, neuron = (
            np.concatenate([np.zeros(0, np.int32), *(each[part] for part in parts)])
            for each in (self.step, self.neuron)
        )
        return Train(np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))), step, neuron)

    def rows(self, steps: int) -> NDArray[np.int64]:
        """Where the spikes of each step of each recording end, shape (batch x steps + 1,), the first 0."""
        recording = np.repeat(np.arange(len(self.ends) - 1), np.diff(self.ends))
        number = np.bincount(recording * steps + self.step, minlength=(len(self.ends) - 1) * steps)
        return np.concatenate(([0], np.cumsum(number, dtype=np.int64)))


class Events:
    """Spikes of a batch of recordings.

    A neuron emits at most one spike in a step: more of them are one, as chips merge them. `events[k]` and
    `events[[3, 1]]` are batches of some recordings, so a data set can be one object; `len` is the batch.

    Args:
        batch: recordings.
        steps: of each recording; that of index 0 is the first step of the run.
        spikes: by population the index of the recording, the step and the neuron of each spike, in any order.

    Attributes:
        trains: the spikes by population.

    Raises:
        ModelError: the arrays are no whole numbers, differ in length or lie outside.
    """

    def __init__(self, batch: int, steps: int, spikes: Mapping[str, tuple[Any, Any, Any]]) -> None:
        self.batch, self.steps = _number(batch, "batch", 0), _number(steps, "steps", 1)
        self.trains = {name: self._train(name, each) for name, each in spikes.items()}

    @classmethod
    def of_trains(cls, steps: int, trains: Mapping[str, Train]) -> Events:
        """Spikes that are sorted already, each once: nothing is looked at."""
        self = object.__new__(cls)
        self.batch = next((len(train.ends) - 1 for train in trains.values()), 0)
        self.steps, self.trains = steps, dict(trains)
        return self

    @classmethod
    def of_dense(cls, tensors: Mapping[str, Any]) -> Events:
        """Those of dense tensors or arrays by population, (batch, steps, neurons), of 0 and 1.

        Raises:
            ModelError: they hold something else, or their shapes do not agree.
        """
        held = {
            name: tensor.detach().to_dense().cpu() if hasattr(tensor, "detach") else tensor
            for name, tensor in tensors.items()
        }
        arrays = {name: np.asarray(tensor) for name, tensor in held.items()}
        sizes = {name: array.shape[:2] for name, array in arrays.items()}
        for name, array in arrays.items():
            if array.ndim != 3:
                raise ModelError(f"'{name}': found the shape {array.shape}: expected (batch, steps, neurons)")
            if not np.isin(array, (0, 1)).all():
                hint = "other numbers are given to the module as a dense tensor"
                raise ModelError(f"'{name}': found values other than 0 and 1: expected spikes", hint=hint)
        if len(set(sizes.values())) != 1:
            raise ModelError(f"found (batch, steps) of {sizes}: expected one of all, and at least one population")
        batch, steps = next(iter(sizes.values()))
        places: dict[str, Any] = {name: array.nonzero() for name, array in arrays.items()}
        return cls(batch, steps, places)

    @classmethod
    def of_recordings(
        cls,
        recordings: Iterable[Any],
        population: str,
        *,
        shape: Sequence[int],
        step: float,
        duration: float,
        scale: int = 1,
        start: float = 0.0,
    ) -> Events:
        """Those of event cameras.

        Args:
            recordings: `neuro.events.Events`, or what has their `t` (us), `x`, `y` (px) and `p`.
            population: the name of the pixels' population.
            shape: its shape: (2, rows, columns), OFF then ON, or (rows, columns) where both count as one.
            step: of the network, ms.
            duration: ms of each recording that are seen, a multiple of the step.
            scale: pixels in a row and in a column that are one neuron.
            start: ms from a recording's first event to its first step.

        Raises:
            ModelError: an event lies outside the shape, or a time is no multiple of the step.
        """
        steps = Clock(step).step(float(duration), "duration")
        if steps < 1:
            raise ModelError(f"duration = {duration:g} ms: expected at least one step of {step:g} ms")
        check_pixels(shape)
        trains = [_of_camera(one, tuple(shape), step, steps, scale, start) for one in recordings]
        return cls.of_trains(steps, {population: _joined(trains)})

    @classmethod
    def join(cls, parts: Sequence[Events]) -> Events:
        """The recordings of several batches, one after the other.

        Raises:
            ModelError: there is none, or their steps or populations differ.
        """
        if not parts:
            raise ModelError("Events.join: found no batch: expected at least one")
        first = parts[0]
        for k, part in enumerate(parts):
            if part.steps != first.steps or part.trains.keys() != first.trains.keys():
                message = f"batch {k} has {part.steps} steps of {sorted(part.trains)}"
                raise ModelError(f"{message}: expected {first.steps} of {sorted(first.trains)}, as the first")
        return cls.of_trains(first.steps, {name: _joined([p.trains[name] for p in parts]) for name in first.trains})

    def _train(self, name: str, spikes: tuple[Any, Any, Any]) -> Train:
        recording, step, neuron = (_whole(each, name) for each in spikes)
        if not len(recording) == len(step) == len(neuron):
            raise ModelError(f"'{name}': {len(recording)} recordings, {len(step)} steps, {len(neuron)} neurons")
        for word, values, end in (("recording", recording, self.batch), ("step", step, self.steps)):
            for k in np.flatnonzero((values < 0) | (values >= end))[:1]:
                raise ModelError(f"'{name}': spike {k}: found {word} {values[k]}: expected 0 to {end - 1}")
        for k in np.flatnonzero(neuron < 0)[:1]:
            raise ModelError(f"'{name}': spike {k}: found neuron {neuron[k]}: expected at least 0")
        order, recording = _each_once(recording, step, neuron)
        ends = np.searchsorted(recording, np.arange(self.batch + 1))
        return Train(ends.astype(np.int64), step[order].astype(np.int32), neuron[order].astype(np.int32))

    def __len__(self) -> int:
        return self.batch

    def __getitem__(self, index: Any) -> Events:
        at = index if isinstance(index, slice) else np.asarray(index)
        if isinstance(at, np.ndarray) and not at.size:
            at = at.astype(np.int64)
        chosen = np.atleast_1d(np.arange(self.batch)[at]).tolist()
        return Events.of_trains(self.steps, {name: train.of(chosen) for name, train in self.trains.items()})

    def __iter__(self) -> Iterator[Events]:
        return (self[k] for k in range(self.batch))

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(train.step):,} of '{name}'" for name, train in self.trains.items())
        return f"Events(batch={self.batch}, steps={self.steps}, spikes: {counts or 'none'})"

    def dense(self, population: str, neurons: int) -> NDArray[np.float32]:
        """The spikes of a population as 0 and 1, shape (batch, steps, neurons)."""
        train = self.trains[population]
        spikes = np.zeros((self.batch, self.steps, neurons), dtype=np.float32)
        spikes[np.repeat(np.arange(self.batch), np.diff(train.ends)), train.step, train.neuron] = 1.0
        return spikes

    def counts(self, population: str, neurons: int) -> NDArray[np.float32]:
        """Spikes of each neuron of a population, shape (batch, neurons)."""
        train = self.trains[population]
        recording = np.repeat(np.arange(self.batch), np.diff(train.ends))
        number = np.bincount(recording * neurons + train.neuron, minlength=self.batch * neurons)
        return number.reshape(self.batch, neurons).astype(np.float32)


def collate(samples: Sequence[Any]) -> Any:
    """What a `torch.utils.data.DataLoader` is given as `collate_fn` where samples hold `Events`.

    Args:
        samples: `Events` of one recording each, or tuples of them and what torch knows how to put together.
    """
    if isinstance(samples[0], Events):
        return Events.join(samples)
    from torch.utils.data import default_collate

    columns = list(zip(*samples, strict=True))
    return tuple(Events.join(each) if isinstance(each[0], Events) else default_collate(list(each)) for each in columns)


def _of_camera(events: Any, shape: tuple[int, ...], step: float, steps: int, scale: int, start: float) -> Train:
    """The spikes of one recording."""
    at, neuron = pixel_spikes(events, shape, step, steps=steps, scale=scale, start=start)
    order, _ = _each_once(np.zeros(len(at), dtype=np.int64), at, neuron)
    ends = np.array([0, len(order)], dtype=np.int64)
    return Train(ends, at[order].astype(np.int32), neuron[order].astype(np.int32))


def _each_once(recording: Any, step: Any, neuron: Any) -> tuple[Any, Any]:
    """The places of spikes by recording, step, neuron, each once, and the recording of each."""
    steps, neurons = int(step.max(initial=0)) + 1, int(neuron.max(initial=0)) + 1
    order = np.unique((recording * steps + step) * neurons + neuron, return_index=True)[1]
    return order, recording[order]


def _joined(trains: Sequence[Train]) -> Train:
    lengths = np.concatenate([np.zeros(0, np.int64), *(np.diff(train.ends) for train in trains)])
    step, neuron = (
        np.concatenate([np.zeros(0, np.int32), *(getattr(train, word) for train in trains)])
        for word in ("step", "neuron")
    )
    return Train(np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))), step, neuron)


def _whole(values: Any, name: str) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.ndim != 1 or (array.dtype.kind not in "iu" and array.size):
        raise ModelError(f"'{name}': found {array.dtype} of the shape {array.shape}: expected whole numbers in a row")
    return array.astype(np.int64)


def _number(value: Any, word: str, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ModelError(f"Events: {word} = {value!r}: expected a whole number >= {least}")
    return int(value)
