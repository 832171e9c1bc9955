"""Sparse batches of spikes, without torch: memory grows with the number of spikes, not of pixels."""

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
    """The spikes of one population in a batch, sorted by recording, step and neuron, without duplicates.

    Attributes:
        ends: spikes of recording b are `ends[b] : ends[b + 1]`, shape (batch + 1,), int64.
        step: step of each spike, from 0, shape (spikes,), int32.
        neuron: index of the neuron of each spike, shape (spikes,), int32.
    """

    ends: NDArray[np.int64]
    step: Ints
    neuron: Ints

    def of(self, recordings: Sequence[int]) -> Train:
        """Return the spikes of some recordings."""
        parts = [slice(int(self.ends[b]), int(self.ends[b + 1])) for b in recordings]
        lengths = [part.stop - part.start for part in parts]
        step, neuron = (
            np.concatenate([np.zeros(0, np.int32), *(values[part] for part in parts)])
            for values in (self.step, self.neuron)
        )
        return Train(np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))), step, neuron)

    def rows(self, steps: int) -> NDArray[np.int64]:
        """Return the offsets of the spikes of each step of each recording, shape (batch x steps + 1,).

        Row `b * steps + t` has the spikes `rows[b * steps + t] : rows[b * steps + t + 1]`.
        """
        recording = np.repeat(np.arange(len(self.ends) - 1), np.diff(self.ends))
        number = np.bincount(recording * steps + self.step, minlength=(len(self.ends) - 1) * steps)
        return np.concatenate(([0], np.cumsum(number, dtype=np.int64)))


class Events:
    """Spikes of a batch of recordings.

    A neuron emits at most one spike per step; duplicates are merged, as chips do. `events[k]` and `events[[3, 1]]` are
    batches of some recordings, so a data set can be one object. `len` is the number of recordings.

    Args:
        batch: number of recordings.
        steps: steps of each recording; index 0 is the first step of the run.
        spikes: by population, the recording, step and neuron of each spike, three arrays in any order.

    Attributes:
        trains: the spikes by population.

    Raises:
        ModelError: an array holds numbers that are not whole or are out of range, or the arrays differ in length.
    """

    def __init__(self, batch: int, steps: int, spikes: Mapping[str, tuple[Any, Any, Any]]) -> None:
        self.batch, self.steps = _number(batch, "batch", 0), _number(steps, "steps", 1)
        self.trains = {name: self._train(name, arrays) for name, arrays in spikes.items()}

    @classmethod
    def of_trains(cls, steps: int, trains: Mapping[str, Train]) -> Events:
        """Make a batch from trains that are already sorted and free of duplicates, without checks."""
        self = object.__new__(cls)
        self.batch = next((len(train.ends) - 1 for train in trains.values()), 0)
        self.steps, self.trains = steps, dict(trains)
        return self

    @classmethod
    def of_dense(cls, tensors: Mapping[str, Any]) -> Events:
        """Make a batch from dense tensors or arrays by population, (batch, steps, neurons), of 0 and 1.

        Raises:
            ModelError: a tensor holds other values, or the shapes do not agree.
        """
        tensors_on_host = {
            name: tensor.detach().to_dense().cpu() if hasattr(tensor, "detach") else tensor
            for name, tensor in tensors.items()
        }
        arrays = {name: np.asarray(tensor) for name, tensor in tensors_on_host.items()}
        sizes = {name: array.shape[:2] for name, array in arrays.items()}
        for name, array in arrays.items():
            if array.ndim != 3:
                raise ModelError(f"'{name}': found the shape {array.shape}: expected (batch, steps, neurons)")
            if not np.isin(array, (0, 1)).all():
                hint = "other numbers are given to the module as a dense tensor"
                raise ModelError(f"'{name}': found values other than 0 and 1: expected spikes", hint=hint)
        if len(set(sizes.values())) != 1:
            raise ModelError(f"found (batch, steps) of {sizes}: expected the same of all, and at least one population")
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
        """Make a batch from recordings of event cameras.

        Args:
            recordings: `neuro.events.Events`, or objects with the same attributes `t` (us), `x`, `y` (px) and `p`.
            population: name of the population of the pixels.
            shape: shape of the population: (2, rows, columns), OFF then ON, or (rows, columns) if both polarities
                share a neuron.
            step: step of the network, ms.
            duration: part of each recording to use in ms, a multiple of the step.
            scale: number of pixel rows and columns that one neuron stands for.
            start: time from a recording's first event to its first step, ms.

        Raises:
            ModelError: an event lies outside the shape, or a time is no multiple of the step.
        """
        steps = Clock(step).step(float(duration), "duration")
        if steps < 1:
            raise ModelError(f"duration = {duration:g} ms: expected at least one step of {step:g} ms")
        check_pixels(shape)
        trains = [_camera_train(recording, tuple(shape), step, steps, scale, start) for recording in recordings]
        return cls.of_trains(steps, {population: _concatenate(trains)})

    @classmethod
    def join(cls, parts: Sequence[Events]) -> Events:
        """Concatenate the recordings of several batches.

        Raises:
            ModelError: the list is empty, or steps or populations differ.
        """
        if not parts:
            raise ModelError("Events.join: found no batch: expected at least one")
        first = parts[0]
        for k, part in enumerate(parts):
            if part.steps != first.steps or part.trains.keys() != first.trains.keys():
                message = f"batch {k} has {part.steps} steps of {sorted(part.trains)}"
                raise ModelError(f"{message}: expected {first.steps} of {sorted(first.trains)}, as the first")
        return cls.of_trains(
            first.steps, {name: _concatenate([p.trains[name] for p in parts]) for name in first.trains}
        )

    def _train(self, name: str, spikes: tuple[Any, Any, Any]) -> Train:
        recording, step, neuron = (_integers(array, name) for array in spikes)
        if not len(recording) == len(step) == len(neuron):
            raise ModelError(f"'{name}': {len(recording)} recordings, {len(step)} steps, {len(neuron)} neurons")
        for word, values, end in (("recording", recording, self.batch), ("step", step, self.steps)):
            for k in np.flatnonzero((values < 0) | (values >= end))[:1]:
                raise ModelError(f"'{name}': spike {k}: found {word} {values[k]}: expected 0 to {end - 1}")
        for k in np.flatnonzero(neuron < 0)[:1]:
            raise ModelError(f"'{name}': spike {k}: found neuron {neuron[k]}: expected at least 0")
        order, recording = _sort_distinct(recording, step, neuron)
        ends = np.searchsorted(recording, np.arange(self.batch + 1))
        return Train(ends.astype(np.int64), step[order].astype(np.int32), neuron[order].astype(np.int32))

    def __len__(self) -> int:
        return self.batch

    def __getitem__(self, index: Any) -> Events:
        rows = index if isinstance(index, slice) else np.asarray(index)
        if isinstance(rows, np.ndarray) and not rows.size:
            rows = rows.astype(np.int64)
        chosen = np.atleast_1d(np.arange(self.batch)[rows]).tolist()
        return Events.of_trains(self.steps, {name: train.of(chosen) for name, train in self.trains.items()})

    def __iter__(self) -> Iterator[Events]:
        return (self[k] for k in range(self.batch))

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(train.step):,} of '{name}'" for name, train in self.trains.items())
        return f"Events(batch={self.batch}, steps={self.steps}, spikes: {counts or 'none'})"

    def dense(self, population: str, neurons: int) -> NDArray[np.float32]:
        """Return the spikes of a population as 0 and 1, shape (batch, steps, neurons)."""
        train = self.trains[population]
        spikes = np.zeros((self.batch, self.steps, neurons), dtype=np.float32)
        spikes[np.repeat(np.arange(self.batch), np.diff(train.ends)), train.step, train.neuron] = 1.0
        return spikes

    def counts(self, population: str, neurons: int) -> NDArray[np.float32]:
        """Return the number of spikes of each neuron of a population, shape (batch, neurons)."""
        train = self.trains[population]
        recording = np.repeat(np.arange(self.batch), np.diff(train.ends))
        number = np.bincount(recording * neurons + train.neuron, minlength=self.batch * neurons)
        return number.reshape(self.batch, neurons).astype(np.float32)


def collate(samples: Sequence[Any]) -> Any:
    """Collate samples with `Events`: the `collate_fn` of a `torch.utils.data.DataLoader`.

    Args:
        samples: `Events` of one recording each, or tuples of `Events` and of values that torch's default collates.
    """
    if isinstance(samples[0], Events):
        return Events.join(samples)
    from torch.utils.data import default_collate

    columns = list(zip(*samples, strict=True))
    return tuple(Events.join(part) if isinstance(part[0], Events) else default_collate(list(part)) for part in columns)


def _camera_train(events: Any, shape: tuple[int, ...], step: float, steps: int, scale: int, start: float) -> Train:
    """Return the spikes of one recording."""
    spike_steps, neuron = pixel_spikes(events, shape, step, steps=steps, scale=scale, start=start)
    order, _ = _sort_distinct(np.zeros(len(spike_steps), dtype=np.int64), spike_steps, neuron)
    ends = np.array([0, len(order)], dtype=np.int64)
    return Train(ends, spike_steps[order].astype(np.int32), neuron[order].astype(np.int32))


def _sort_distinct(recording: Any, step: Any, neuron: Any) -> tuple[Any, Any]:
    """Return the indices of the distinct spikes, sorted by recording, step and neuron, and their recordings."""
    steps, neurons = int(step.max(initial=0)) + 1, int(neuron.max(initial=0)) + 1
    order = np.unique((recording * steps + step) * neurons + neuron, return_index=True)[1]
    return order, recording[order]


def _concatenate(trains: Sequence[Train]) -> Train:
    lengths = np.concatenate([np.zeros(0, np.int64), *(np.diff(train.ends) for train in trains)])
    step, neuron = (
        np.concatenate([np.zeros(0, np.int32), *(getattr(train, word) for train in trains)])
        for word in ("step", "neuron")
    )
    return Train(np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))), step, neuron)


def _integers(values: Any, name: str) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.ndim != 1 or (array.dtype.kind not in "iu" and array.size):
        raise ModelError(f"'{name}': found {array.dtype} of the shape {array.shape}: expected a row of whole numbers")
    return array.astype(np.int64)


def _number(value: Any, word: str, smallest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < smallest:
        raise ModelError(f"Events: {word} = {value!r}: expected a whole number >= {smallest}")
    return int(value)
