"""What a run leaves of each population, projection and probe; arrays of a file are read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from neuro.core.clock import NEVER, Clock
from neuro.program.program import Floats, Ints, Stretch

__all__ = ["Fed", "Trace", "Train", "Weights"]


Opener = Callable[[], AbstractContextManager[Any]]
_MISSING: Any = object()
_MOST = 1 << 17
"""Spikes of what was fed that are played at once."""


class Stored:
    """An array in an HDF5 file.

    Args:
        opener: gives the open file.
        name: of the data set.
        length: what comes after so many entries, as in a file that grows, is not seen, so that arrays of one part fit.
    """

    def __init__(self, opener: Opener, name: str, length: int) -> None:
        self._opener, self._name, self._length = opener, name, length

    def read(self) -> Any:
        """All of it."""
        return self[: self._length]

    def __getitem__(self, where: Any) -> Any:
        with self._opener() as file:
            return file[self._name][where]

    def span(self, after: float, to: float) -> slice:
        """Where those of ascending numbers lie that are in after < x <= to; few of them are read."""
        with self._opener() as file:
            data = file[self._name]
            return slice(*(_first_above(data, bound, self._length) for bound in (after, to)))


def span(times: Any, after: float, to: float) -> slice:
    """Likewise of an array, stored or not."""
    if isinstance(times, Stored):
        return times.span(after, to)
    return slice(*(int(np.searchsorted(times, bound, side="right")) for bound in (after, to)))


def _first_above(data: Any, bound: float, length: int) -> int:
    low, high = 0, length
    if not high or data[high - 1] <= bound:
        return high
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if data[middle] <= bound else (low, middle)
    return low


class Lazy:
    """A field of a dataclass that holds an array, or a `Stored` one that is read and kept when it is asked for."""

    def __init__(self, default: Any = _MISSING) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, part: Any, owner: type | None = None) -> Any:
        if part is None:
            if self._default is _MISSING:
                raise AttributeError(self._name)
            return self._default
        value = vars(part)[self._name]
        if isinstance(value, Stored):
            value = vars(part)[self._name] = value.read()
        return value

    def __set__(self, part: Any, value: Any) -> None:
        vars(part)[self._name] = value


def kept(part: Any, name: str) -> Any:
    """What a lazy field holds, an array or a `Stored` one, of which a slice can be read."""
    return vars(part)[name]


@dataclass(frozen=True, eq=False)
class Train:
    """Spikes of one population, by time, then neuron.

    Attributes:
        model: the name of its model.
        shape: its shape.
        counts: of the run, by name.
        recorded: whether its spikes were kept; if not `steps`, `ids` and `multiplicity` are empty.
        resolution_ms: the length of a step.
        steps, ids, multiplicity: one entry for each neuron and step with spikes; read when they are asked for.
        spike_counts, event_counts: spikes of each neuron, and its steps with spikes, whether recorded or not.
        emits: "spikes" or "current".
        payloads: of a graded population what each entry carries; None of others.
    """

    model: str
    shape: tuple[int, ...]
    counts: dict[str, int]
    recorded: bool
    resolution_ms: float
    steps: Lazy = Lazy()
    ids: Lazy = Lazy()
    multiplicity: Lazy = Lazy()
    spike_counts: Lazy = Lazy()
    event_counts: Lazy = Lazy()
    emits: str = "spikes"
    payloads: Lazy = Lazy(None)

    @property
    def times_ms(self) -> Floats:
        """The time of each entry in ms."""
        return Clock(self.resolution_ms).array_ms(np.asarray(self.steps))

    @property
    def spikes(self) -> int | None:
        """How many it emitted; None of a generator of currents, which emits none."""
        return self.counts["spikes"] if self.emits == "spikes" else None

    @property
    def size(self) -> int:
        """Number of neurons."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Fed:
    """What one event camera was fed while a run was recorded, as spikes; a stream that a simulation can play.

    Attributes:
        steps: ascending where events were fed in the order of time; an entry for each row of spikes of one step.
        sizes: how many spikes each entry has.
        ids: their neurons.
    """

    steps: Lazy = Lazy()
    sizes: Lazy = Lazy()
    ids: Lazy = Lazy()

    again: ClassVar[bool] = True
    """It can be played several times."""

    @property
    def identity(self) -> str:
        """What distinguishes it from another."""
        return f"{int(np.sum(self.sizes))} spikes"

    def after(self, step: int) -> Iterator[Stretch]:
        """All spikes of later steps, in stretches; no more than one of them is in memory."""
        steps, sizes, ids = np.asarray(self.steps), np.asarray(self.sizes), kept(self, "ids")
        to_come = np.minimum.accumulate(steps[::-1])[::-1]
        ends = np.cumsum(sizes)
        first, entry = 0, 0
        while entry < steps.size:
            end = max(entry + 1, int(np.searchsorted(ends, first + _MOST)))
            each, last = np.repeat(steps[entry:end], sizes[entry:end]), int(ends[end - 1])
            neurons = np.asarray(ids[first:last], dtype=np.int64)
            later = each > step
            until = NEVER if end == steps.size else int(to_come[end]) - 1
            yield Stretch(until, each[later], neurons[later])
            first, entry = last, end

    def given(self, events: Any) -> tuple[Ints, Ints]:
        """Nothing is fed to what was fed."""
        raise NotImplementedError


def synapse_said(synapse: str, drawn_by: str | None) -> str:
    """A synapse model, and the backend that draws the synapses, if it does."""
    return f"{synapse}, drawn by {drawn_by}" if drawn_by else synapse


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of one projection at the end of a run, and its delays where these learn.

    Attributes:
        source, target: names of the populations.
        synapse: the name of its model.
        synapses: their number.
        counts: of the run, by name.
        pre, post: the ends of each synapse; None for a grid or where weights were not kept.
        weight: one for each; kernels of a grid; None where weights were not kept.
        delay_ms: one for each, of a rule that changes delays; None of others.
        drawn_by: the backend that drew the synapses, by rules of its own; None where they are those of this language.
    """

    source: str
    target: str
    synapse: str
    synapses: int
    counts: dict[str, int]
    pre: Lazy = Lazy(None)
    post: Lazy = Lazy(None)
    weight: Lazy = Lazy(None)
    delay_ms: Lazy = Lazy(None)
    drawn_by: str | None = None

    @property
    def said(self) -> str:
        """The synapse model, and who drew the synapses if that was the backend."""
        return synapse_said(self.synapse, self.drawn_by)


@dataclass(frozen=True, eq=False)
class Trace:
    """What a probe recorded of one state.

    Attributes:
        population: whose neurons; "" of synapses.
        state: its name, "rate" of a rate.
        unit: of the values.
        times_ms: shape (times,).
        values: shape (times, neurons or synapses); of a rate or a mean, and at pre spikes, (times,).
        projection: whose synapses; "" of neurons.
        probe: the name of the probe, "" for that of the trace.
        mean: whether it is a mean.
        ids: the neuron of each column; None where it is all of them.
        pre, post: the ends of the synapse of each column, at pre spikes of each time; None of neurons, means and grids.
    """

    population: str
    state: str
    unit: str
    times_ms: Lazy = Lazy()
    values: Lazy = Lazy()
    projection: str = ""
    probe: str = ""
    mean: bool = False
    ids: Lazy = Lazy(None)
    pre: Lazy = Lazy(None)
    post: Lazy = Lazy(None)

    @property
    def at_pre_spikes(self) -> bool:
        """Whether it has what pre spikes leave in synapses."""
        return not self.single and bool(self.values.ndim == 1)

    @property
    def single(self) -> bool:
        """Whether it is one number for all, a rate or a mean."""
        return self.mean or self.state == "rate"

    @property
    def columns(self) -> int:
        """How many numbers are recorded each time; at pre spikes one."""
        return 1 if self.values.ndim == 1 else int(self.values.shape[1])

    def read(self) -> Any:
        """What `sim.trace` gives beside the times: the values, at pre spikes with the ends of the synapses, by name."""
        if self.at_pre_spikes:
            return {"pre": self.pre, "post": self.post, self.state: self.values}
        return self.values
