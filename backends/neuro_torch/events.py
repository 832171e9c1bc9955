"""Batches of spikes for the inputs of a network. Sparse ones take memory by their spikes, not by their pixels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neuro.coding.encoders import check_pixels, pixel_spikes
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.program.program import Population, Program
from neuro_torch.scan.layers import ScanTask
from neuro_torch.sources import TensorSource

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


def _check_trains(batch: Events) -> None:
    """Refuse spikes before the first neuron and outside of the steps: `Events.of_trains` takes any."""
    for name, train in batch.trains.items():
        least, first, last = train.neuron.min(initial=0), train.step.min(initial=0), train.step.max(initial=0)
        if least < 0:
            raise ModelError(f"batch: '{name}': found neuron {least}: expected at least 0")
        if first < 0 or last >= batch.steps:
            found = first if first < 0 else last
            raise ModelError(f"batch: '{name}': found step {found}: expected 0 to {batch.steps - 1}")


def sizes(program: Program, batch: Any, steps: int | None) -> tuple[int, int]:
    """Recordings and steps of a batch.

    Args:
        program: the network.
        batch: as given to `neuro_torch.Module`.
        steps: those that it has to have, None for any.

    Raises:
        ModelError: it names no inputs, or its parts or steps do not agree.
    """
    known = [part.name for part in program.populations if part.kind == "listed"]
    if not isinstance(batch, (Events, Mapping)):
        message = f"batch: found {type(batch).__name__}: expected neuro_torch.Events, or tensors by population"
        raise ModelError(message, hint=f"{{'{known[0]}': tensor}}" if known else "")
    named = batch.trains if isinstance(batch, Events) else batch
    for name in named:
        if name not in known:
            raise unknown("population of inputs", name, known)
    if isinstance(batch, Events):
        found = {(batch.batch, batch.steps)}
        _check_trains(batch)
    else:
        for name, each in batch.items():
            if not isinstance(each, (torch.Tensor, np.ndarray)):
                raise ModelError(f"batch: '{name}': found {type(each).__name__}: expected a tensor")
            if each.ndim < 3:
                message = f"batch: '{name}': found the shape {tuple(each.shape)}"
                raise ModelError(f"{message}: expected (batch, steps, neurons)")
        found = {tuple(each.shape[:2]) for each in batch.values()}
    if len(found) != 1:
        raise ModelError(f"batch: found (batch, steps) of {sorted(found)}: expected one of all inputs")
    size, given = found.pop()
    if size < 1 or given < 1:
        raise ModelError(f"batch: found {size} recordings of {given} steps: expected at least one of each")
    if steps is not None and given != steps:
        raise ModelError(f"batch: found {given} steps: expected {steps}, the module's duration")
    return size, given


def checked(part: Population, given: Any) -> Any:
    """What a batch gives to a generator: sparse spikes, a dense tensor or array, None where it does not name it.

    Raises:
        ModelError: a shape or a neuron is wrong, or what has no spikes of its own is not named.
    """
    if given is None:
        if part.stream is not None:
            hint = "neuro_torch.Events.of_recordings makes spikes of recordings"
            raise ModelError(f"batch: '{part.name}' is not named: expected the spikes of this {part.said}", hint=hint)
        return None
    if isinstance(given, Train):
        if given.neuron.size and int(given.neuron.max()) >= part.size:
            message = f"batch: '{part.name}': found neuron {given.neuron.max()}"
            raise ModelError(f"{message}: expected 0 to {part.size - 1}")
        return given
    check(part, given)
    return given


def given_to(part: Population, given: Any, task: ScanTask) -> Train | torch.Tensor | None:
    """What was checked, as a pass has it.

    Raises:
        ModelError: something is NaN.
    """
    return given if given is None or isinstance(given, Train) else fitted(part, given, task)


def emitted(program: Program, part: Population, given: Train | torch.Tensor | None, task: ScanTask, scans: Any) -> Any:
    """All that a generator emits: a dense tensor, or listed as the scans take it.

    Args:
        program: the network.
        part: the generator.
        given: what `given_to` has found.
        task: what the pass is about.
        scans: `neuro_torch.scan.compiled` or `neuro_torch.scan.operations`.
    """
    silent = part.kind == "listed" and not np.any(part.spike_steps <= task.steps)
    if isinstance(given, Train) and silent:
        return scans.listed(given, task)
    if silent and given is not None:
        return given
    source = TensorSource(part, program.resolution, program.seed)
    own = np.array([source.emit(step) for step in range(1, task.steps + 1)])
    every = torch.as_tensor(own).to(task.device, task.dtype).expand(task.batch, -1, -1)
    return every if given is None else every + dense(given, part, task)


def dense(given: Train | torch.Tensor, part: Population, task: ScanTask) -> torch.Tensor:
    """Spikes that are given, (batch, steps, neurons)."""
    if isinstance(given, Train):
        events = Events.of_trains(task.steps, {part.name: given})
        return torch.from_numpy(events.dense(part.name, part.size)).to(task.device, task.dtype)
    return given


def beginning(given: Any, steps: int) -> Any:
    """The first steps of the first recording of what was checked."""
    if isinstance(given, Train):
        one = given.of([0])
        some = one.step < steps
        return Train(np.array([0, some.sum()]), one.step[some], one.neuron[some])
    if isinstance(given, torch.Tensor) and given.layout is not torch.strided:
        return given[0].to_dense()[None, :steps]
    return None if given is None else given[:1, :steps]


def check(part: Population, given: Any) -> None:
    """Refuse a tensor or an array that does not fit a population, whatever its numbers are.

    Args:
        part: the population.
        given: a tensor or an array, (batch, steps, neurons) or (batch, steps, *shape of the population); it may be
            sparse.

    Raises:
        ModelError: it has another shape, or another kind of numbers.
    """
    try:
        tensor = torch.as_tensor(given)
    except TypeError:
        raise ModelError(f"batch: '{part.name}': found an array of {given.dtype}: expected numbers") from None
    shape = tuple(tensor.shape)
    if shape[2:] not in ((part.size,), part.shape):
        known = dict.fromkeys([(part.size,), part.shape])
        expected = " or ".join(f"(batch, steps, {', '.join(map(str, each))})" for each in known)
        raise ModelError(f"batch: '{part.name}': found the shape {shape}: expected {expected}")
    if tensor.is_complex():
        raise ModelError(f"batch: '{part.name}': found {tensor.dtype}: expected real numbers")


def fitted(part: Population, given: Any, task: ScanTask) -> Tensor:
    """What fits a population, (batch, steps, neurons).

    Args:
        part: the population.
        given: what `check` lets pass.
        task: what the pass is about.

    Raises:
        ModelError: it holds NaN.
    """
    tensor = torch.as_tensor(given)
    if tensor.layout is not torch.strided:
        tensor = tensor.to_dense()
    tensor = tensor.reshape(*tensor.shape[:2], part.size)
    if tensor.is_floating_point() and not tensor.is_meta:
        _check_finite(part, tensor.detach())
    return tensor.to(task.device, task.dtype)


def _check_finite(part: Population, tensor: Tensor) -> None:
    # A sum is one pass without a copy; it may overflow where every number is finite.
    if tensor.sum().isfinite() or tensor.isfinite().all():
        return
    b, t, i = (~tensor.isfinite()).nonzero()[0].tolist()
    message = f"found {float(tensor[b, t, i])} of recording {b}, step {t}, neuron {i}"
    raise ModelError(f"batch: '{part.name}': {message}: expected numbers")
