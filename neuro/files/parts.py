"""Populations, projections and probes of a finished run. Arrays of a file are read on first access."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER, Clock
from neuro.program.program import Floats, Ints, Stretch
from neuro.program.spikes import one_by_one

__all__ = ["Fed", "Trace", "Train", "Weights"]


Opener = Callable[[], AbstractContextManager[Any]]
_MISSING: Any = object()
_CHUNK = 1 << 17
"""Largest number of spikes in a stretch of a replayed stream, unless a single step has more."""


class Stored:
    """An array in an HDF5 file.

    Args:
        opener: function that opens the file.
        name: name of the data set.
        length: number of entries to read. A growing file may have more entries. All arrays of a part must have the same
            length.
    """

    def __init__(self, opener: Opener, name: str, length: int) -> None:
        self._opener, self._name, self._length = opener, name, length

    def read(self) -> Any:
        """Read the whole array."""
        return self[: self._length]

    def __getitem__(self, key: Any) -> Any:
        with self._opener() as file:
            return file[self._name][key]

    def span(self, after: float, to: float) -> slice:
        """Return the slice of an ascending array with after < x <= to, by bisection in the file."""
        with self._opener() as file:
            data = file[self._name]
            return slice(*(_first_above(data, bound, self._length) for bound in (after, to)))


def span(times: Any, after: float, to: float) -> slice:
    """Return the slice of an ascending array, in memory or `Stored`, with after < x <= to."""
    if isinstance(times, Stored):
        return times.span(after, to)
    return slice(*(int(np.searchsorted(times, bound, side="right")) for bound in (after, to)))


def entries(columns: Sequence[Any], after: int, to: int, is_selected: NDArray[np.bool_] | None) -> tuple[Any, ...]:
    """Return the entries of spikes with after < step <= to.

    Args:
        columns: steps, neurons, multiplicities and payloads (None for no payloads); arrays or `Stored`.
        after: the last step before the entries.
        to: the last step of the entries.
        is_selected: True for each neuron whose spikes are returned, (neurons,); None for all neurons.
    """
    rows = span(columns[0], after, to)
    parts = tuple(None if column is None else column[rows] for column in columns)
    if is_selected is None:
        return parts
    is_chosen = is_selected[parts[1]]
    return tuple(None if part is None else part[is_chosen] for part in parts)


def spikes_in_ms(
    name: str, clock: Clock, steps: Ints, ids: Ints, multiplicity: Ints, payloads: NDArray[Any] | None
) -> tuple[Floats, Ints, Ints | None]:
    """Return time in ms, neuron and payload of each spike of a population, from its entries.

    An entry with multiplicity 3 gives three spikes. The arrays have the shape (spikes,).
    """
    steps, ids = one_by_one(name, multiplicity, steps, ids)
    return clock.array_ms(steps), ids, None if payloads is None else payloads.astype(np.int64)


def _first_above(data: Any, bound: float, length: int) -> int:
    begin, end = 0, length
    if not end or data[end - 1] <= bound:
        return end
    while begin < end:
        middle = (begin + end) // 2
        begin, end = (middle + 1, end) if data[middle] <= bound else (begin, middle)
    return begin


class Lazy:
    """Field of a dataclass for an array. A `Stored` array is read on first access and remembered."""

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


def unread(part: Any, name: str) -> Any:
    """Return the value of a lazy field without reading it from the file: an array, or a `Stored` array."""
    return vars(part)[name]


@dataclass(frozen=True, eq=False)
class Train:
    """Spikes of one population, by time, then neuron.

    Attributes:
        model: name of the neuron model.
        shape: shape of the population.
        counts: counts of the run by name.
        recorded: True if spikes were recorded; otherwise ``steps``, ``ids`` and ``multiplicity`` are empty.
        resolution_ms: length of a step in ms.
        steps, ids, multiplicity: step, neuron and number of spikes of each entry, (entries,). There is an entry for
            each neuron and step with spikes.
        spike_counts, event_counts: number of spikes, and number of steps with spikes, of each neuron, (neurons,). They
            are also there without a recording.
        emits: "spikes" or "current".
        payloads: payload of each entry of a graded population, (entries,); None otherwise.
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

    growing: ClassVar[tuple[str, ...]] = ("steps", "ids", "multiplicity", "payloads")
    """Names of the arrays that grow while a network runs."""

    @property
    def times_ms(self) -> Floats:
        """Time of each entry in ms."""
        return Clock(self.resolution_ms).array_ms(np.asarray(self.steps))

    @property
    def spikes(self) -> int | None:
        """Number of spikes, or None for a generator of currents."""
        return self.counts["spikes"] if self.emits == "spikes" else None

    @property
    def size(self) -> int:
        """Number of neurons."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Fed:
    """Spikes that were fed to an event camera during a run, as a stream that a simulation can play again.

    Attributes:
        steps: step of each entry, (entries,), ascending if events were fed in the order of time.
        sizes: number of spikes of each entry, (entries,).
        ids: neurons of all entries, one entry after the other, (spikes,).
    """

    steps: Lazy = Lazy()
    sizes: Lazy = Lazy()
    ids: Lazy = Lazy()

    repeatable: ClassVar[bool] = True
    """True, because the stream can be played several times."""

    @property
    def identity(self) -> str:
        """Text by which the stream differs from other streams."""
        return f"{int(np.sum(self.sizes))} spikes"

    def after(self, step: int) -> Iterator[Stretch]:
        """Yield the spikes of later steps in stretches. Only one stretch at a time is in memory."""
        steps, sizes, ids = np.asarray(self.steps), np.asarray(self.sizes), unread(self, "ids")
        to_come = np.minimum.accumulate(steps[::-1])[::-1]
        ends = np.cumsum(sizes)
        first_spike, entry = 0, 0
        while entry < steps.size:
            end = max(entry + 1, int(np.searchsorted(ends, first_spike + _CHUNK)))
            entry_steps, last_spike = np.repeat(steps[entry:end], sizes[entry:end]), int(ends[end - 1])
            neurons = np.asarray(ids[first_spike:last_spike], dtype=np.int64)
            is_later = entry_steps > step
            last_step = NEVER if end == steps.size else int(to_come[end]) - 1
            yield Stretch(last_step, entry_steps[is_later], neurons[is_later])
            first_spike, entry = last_spike, end

    def spikes_of(self, events: Any) -> tuple[Ints, Ints]:
        """Raise an error: the stream has its spikes already and takes no events."""
        raise NotImplementedError


def synapse_text(synapse: str, drawn_by: str | None) -> str:
    """Return the name of a synapse model, with the backend if a backend draws the synapses."""
    return f"{synapse}, drawn by {drawn_by}" if drawn_by else synapse


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of a projection at the end of a run, with delays if its rule changes delays.

    Attributes:
        source, target: names of the populations.
        synapse: name of the synapse model.
        synapses: number of synapses.
        counts: counts of the run by name.
        pre, post: source and target neuron of each synapse; None for a grid, or without stored weights.
        weight: weight of each synapse, or the kernels of a grid; None without stored weights.
        delay_ms: delay of each synapse in ms if the rule changes delays, else None.
        drawn_by: backend that drew the synapses by its own rules; None if neuro drew them.
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

    growing: ClassVar[tuple[str, ...]] = ()
    """Names of the arrays that grow while a network runs."""

    @property
    def synapse_text(self) -> str:
        """Name of the synapse model, with the backend if a backend drew the synapses."""
        return synapse_text(self.synapse, self.drawn_by)


@dataclass(frozen=True, eq=False)
class Trace:
    """Values of one state, recorded by a probe.

    Attributes:
        population: name of the population; "" for states of synapses.
        state: name of the state; "rate" for a rate.
        unit: unit of the values.
        times_ms: times in ms, shape (times,).
        values: shape (times, neurons or synapses); (times,) for a rate, a mean, or values at pre spikes.
        projection: name of the projection; "" for states of neurons.
        probe: name of the probe; "" if the trace has the same name.
        mean: True for a mean over neurons or synapses.
        ids: neuron of each column; None for all neurons.
        pre, post: source and target neuron of each column, or of each entry at pre spikes; None for neurons, means and
            grids.
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
    def of(self) -> str:
        """Name of the recorded population or projection."""
        return self.projection or self.population

    @property
    def noun(self) -> str:
        """Kind of the columns, "neuron" or "synapse"; "" for a rate or a mean."""
        return "" if self.single else "synapse" if self.projection else "neuron"

    @property
    def at_pre_spikes(self) -> bool:
        """True if the probe recorded synapses at each pre spike instead of at regular times."""
        return not self.single and bool(self.values.ndim == 1)

    @property
    def growing(self) -> tuple[str, ...]:
        """Names of the arrays that grow while a network runs."""
        return ("times_ms", "values", "pre", "post") if self.at_pre_spikes else ("times_ms", "values")

    @property
    def single(self) -> bool:
        """True for a rate or a mean, which has one value for all neurons at each time."""
        return self.mean or self.state == "rate"

    @property
    def columns(self) -> int:
        """Number of values at each time; 1 at pre spikes."""
        return 1 if self.values.ndim == 1 else int(self.values.shape[1])

    def read(self) -> Any:
        """Return the values in the form of `sim.trace`: an array, or at pre spikes the ends and values by name."""
        if self.at_pre_spikes:
            return {"pre": self.pre, "post": self.post, self.state: self.values}
        return self.values
