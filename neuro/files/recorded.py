"""Common interface to the spikes, traces and weights of a simulation or of results, with export to Neo and pandas."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, unknown
from neuro.core.extras import needed
from neuro.core.quantities import in_ms
from neuro.core.values import shown
from neuro.files.parts import Trace
from neuro.model.parts import Part
from neuro.model.views import NameAndShape, View, view_of_index
from neuro.program.program import Floats, Ints, Program

if TYPE_CHECKING:
    import neo
    from pandas import DataFrame


Window = tuple[float, float]
SMALL = 1_000_000
"""Largest number of static synapses whose weights are stored without a request.

More static weights are left out, because they follow from network and seed.
"""
_SAME = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of neurons of one population.

    Attributes:
        population: name of the population.
        neurons: ids of the neurons, ascending, (neurons,).
        times_ms, ids: time in ms and neuron of each spike, sorted by time, (spikes,).
        window: begin (excluded) and end (included) in ms.
    """

    population: str
    neurons: Ints
    times_ms: Floats
    ids: Ints
    window: Window

    @property
    def rate_hz(self) -> float:
        """Mean rate of a neuron in Hz, 0 without neurons or in an empty window."""
        seconds = (self.window[1] - self.window[0]) / 1000.0
        return self.times_ms.size / (self.neurons.size * seconds) if self.neurons.size and seconds else 0.0


def intervals(times_ms: Floats, ids: Ints) -> tuple[Floats, Ints]:
    """Return the intervals between successive spikes of each neuron in ms, and their neurons, by neuron, then time."""
    order = np.lexsort((times_ms, ids))
    times_ms, ids = times_ms[order], ids[order]
    is_same_neuron = ids[1:] == ids[:-1]
    return np.diff(times_ms)[is_same_neuron], ids[1:][is_same_neuron]


def variation(times_ms: Floats, ids: Ints) -> Floats:
    """Return the coefficient of variation of the intervals of each neuron with two intervals or more.

    The coefficient is the population standard deviation divided by the mean, and 1 for a Poisson process. Neurons
    whose intervals are all 0, with all spikes in one step, are left out.

    Source: Softky & Koch, J. Neurosci. 13:334, 1993
    """
    lengths, neurons = intervals(times_ms, ids)
    _, index, count = np.unique(neurons, return_inverse=True, return_counts=True)
    mean = np.bincount(index, lengths) / count
    square = np.bincount(index, (lengths - mean[index]) ** 2) / count
    defined = (count >= 2) & (mean > 0)
    return np.asarray(np.sqrt(square[defined]) / mean[defined])


@dataclass(frozen=True, slots=True, eq=False)
class SynapseWeights:
    """Weights of one projection.

    Attributes:
        shape: number of sources and number of targets.
        pre, post: source and target of each synapse, (synapses,); None for a grid.
        weight: weight of each synapse, (synapses,); for a grid the kernels, (maps, channels, height, width).
    """

    shape: tuple[int, int]
    pre: Ints | None
    post: Ints | None
    weight: Floats


class Recorded:
    """The recording of a run, read in the same way from a simulation and from results.

    Args:
        run: a `neuro.Simulation`, or results.

    Attributes:
        network, backend: names of the network and the backend.
        seed: seed of the run.
        duration_ms, resolution_ms: length of the run and of a step in ms.
        shapes: shapes of the populations by name.
        with_spikes: names of the populations with recorded spikes.
        held_ms: time in ms up to which the recording has been forgotten.
        with_weights: names of the projections with stored weights.

    Raises:
        ModelError: `run` is neither a simulation nor results.
    """

    def __init__(self, run: Any) -> None:
        self._run = run
        if hasattr(run, "program") and hasattr(run, "spikes"):
            program: Program = run.program
            self.network, self.backend, self.seed = program.name, str(run.backend), program.seed
            self.resolution_ms = program.resolution
            self.shapes = {part.name: part.shape for part in program.populations}
            self.with_spikes = [part.name for part in program.populations if part.records]
            self.with_weights = [p.name for p in program.projections if p.synapse.learns or p.size <= SMALL]
            names = [*self.shapes]
            self._ends = {part.name: (names[part.source], names[part.target]) for part in program.projections}
        elif hasattr(run, "traces") and hasattr(run, "populations"):
            about = run.about
            self.network, self.backend, self.seed = (
                str(about["network"]),
                str(about.get("backend", "")),
                int(about.get("seed", 0)),
            )
            self.resolution_ms = float(about["resolution_ms"])
            self.shapes = {name: tuple(part.shape) for name, part in run.populations.items()}
            self.with_spikes = [name for name, part in run.populations.items() if part.recorded]
            self.with_weights = [name for name, part in run.projections.items() if part.weight is not None]
            self._ends = {name: (part.source, part.target) for name, part in run.projections.items()}
        else:
            hint = "neuro.compile(net) gives a simulation" if hasattr(run, "populations") else ""
            raise ModelError(f"found {shown(run)}: expected a simulation, or results of a run", hint=hint)
        self.duration_ms, self.held_ms = float(run.time), float(run.held)

    def spikes(self, population: str, since: float) -> tuple[Floats, Ints]:
        """Return times in ms and neurons of the spikes of a population after `since`, sorted by time."""
        times_and_ids: tuple[Floats, Ints] = self._run.spikes(population, since=since)
        return times_and_ids

    def weights(self, name: str) -> SynapseWeights:
        """Return the weights of a projection."""
        values, ends = self._run.weights(name), self._ends[name]
        shape = (math.prod(self.shapes[ends[0]]), math.prod(self.shapes[ends[1]]))
        return SynapseWeights(shape, *(values if isinstance(values, tuple) else (None, None, values)))

    @cached_property
    def _traces(self) -> Mapping[str, Trace]:
        return dict(self._run.traces)  # a simulation copies its recording

    @property
    def probes(self) -> dict[str, str]:
        """Name of the probe of each trace, by the name of the trace."""
        return {name: trace.probe or name for name, trace in self._traces.items()}

    def trace(self, name: str) -> Trace:
        """Return a trace, with `ids` of all columns. A rate or a mean gets values of shape (times, 1)."""
        trace = self._traces[name]
        ids = np.arange(0 if trace.at_pre_spikes else trace.columns) if trace.ids is None else trace.ids
        return replace(trace, ids=ids, values=trace.values[:, None] if trace.single else trace.values)


def within(trace: Trace, window: Window) -> Trace:
    """Return the part of a trace in a window, with begin and end."""
    rows = slice(int(np.searchsorted(trace.times_ms, window[0])), up_to(trace.times_ms, window[1]))
    ends = {"pre": trace.pre[rows], "post": trace.post[rows]} if trace.at_pre_spikes else {}
    return replace(trace, times_ms=trace.times_ms[rows], values=trace.values[rows], **ends)


def trains(run: Recorded, of: Any = None, window: Any = None) -> list[SpikeTrain]:
    """Return the spikes of populations or of some of their neurons.

    Args:
        run: recording of the run.
        of: a population, a view of one, its name, or a list of these; by default all recorded populations.
        window: begin and end in ms; by default the whole run.

    Raises:
        ModelError: the population does not exist, nothing was recorded, or the window is invalid.
    """
    begin, end = checked_window(run, window)
    if of is None and not run.with_spikes:
        raise ModelError("no spikes were recorded", hint="net.probe or 'neuro run --record NAME' keeps them")
    is_one = isinstance(of, (str, Part, View, Mapping)) or not isinstance(of, Iterable)
    parts = run.with_spikes if of is None else [of] if is_one else list(of)
    if not parts:
        raise ModelError(f"of = {shown(of)}: expected a population, a view of one, a name, or a list of these")
    spike_trains = []
    for item in parts:
        view = view_of_index(item, {name: NameAndShape(name, shape) for name, shape in run.shapes.items()})
        part = view.population if isinstance(view, View) else view
        name = getattr(part, "name", part)
        if not isinstance(name, str) or name not in run.shapes:
            raise unknown("population", name, run.shapes)
        times, ids = run.spikes(name, begin)
        end_index = up_to(times, end)
        times, ids = times[:end_index], ids[:end_index]
        neurons = np.arange(math.prod(run.shapes[name]))
        if isinstance(view, View):
            neurons = view.within(run.shapes[name])[0]
            in_view = np.isin(ids, neurons)
            times, ids = times[in_view], ids[in_view]
        spike_trains.append(SpikeTrain(name, np.sort(neurons), times, ids, (begin, end)))
    return spike_trains


def checked_window(run: Recorded, window: Any) -> Window:
    """Return begin and end of a window in ms. The default is the whole recording, without the forgotten part.

    Raises:
        ModelError: the window is not two ascending times, begins in the forgotten part, or ends after the run.
    """
    if window is None:
        return run.held_ms, run.duration_ms
    numbers = tuple(window) if isinstance(window, (tuple, list, np.ndarray)) else ()
    pair = [in_ms(ms, "window") for ms in numbers]
    if len(pair) != 2 or not all(is_number(ms) and math.isfinite(ms) for ms in pair) or not 0 <= pair[0] < pair[1]:
        raise ModelError(f"window = {shown(window)}: expected (begin, end) in ms with 0 <= begin < end")
    if pair[0] < run.held_ms:
        message = f"window = {shown(window)}: records up to {run.held_ms:g} ms were forgotten"
        raise ModelError(f"{message}: expected a begin >= {run.held_ms:g} ms")
    if pair[1] > run.duration_ms * (1.0 + _SAME):
        end_text = f"{run.duration_ms:.12g} ms"
        raise ModelError(f"window = {shown(window)}: the run ends at {end_text}: expected an end <= {end_text}")
    return float(pair[0]), float(pair[1])


def up_to(times_ms: Floats, ms: float) -> int:
    """Return the number of ascending times up to `ms`. A time that exceeds `ms` only in its last digits counts."""
    return int(np.searchsorted(times_ms, ms * (1.0 + _SAME), side="right"))


@dataclass(frozen=True, slots=True, eq=False)
class DataFrames:
    """Data frames of a run.

    Attributes:
        spikes: one row for each spike, by time: `time_ms`, `population` (a category), `neuron`.
        populations: one row for each population with recorded spikes, by name: `neurons`, `spikes`, `rate_hz`.
        traces: a frame for each trace, with one column for each neuron or synapse, by `time_ms`; at pre spikes one row
            for each entry: `time_ms`, `pre`, `post` and the state. `attrs` has `of`, `state` and `unit`.
        weights: a frame for each projection, with one row for each synapse: `pre`, `post`, `weight`; for a grid one
            row for each weight of the kernels: `map`, `channel`, `row`, `column`, `weight`.
    """

    spikes: DataFrame
    populations: DataFrame
    traces: dict[str, DataFrame]
    weights: dict[str, DataFrame]


def to_pandas(run: object) -> DataFrames:
    """Return spikes, rates, traces and weights as data frames.

    Args:
        run: a simulation or results. Static weights of more than a million synapses are left out, as in files of
            `neuro run`, since network and seed decide them.

    Raises:
        ModelError: the package pandas is not installed.
    """
    pandas = needed("pandas", "pandas", "to_pandas: the package pandas is not installed")
    source = Recorded(run)
    every = trains(source) if source.with_spikes else []
    times = np.concatenate([np.zeros(0), *(train.times_ms for train in every)])
    ids = np.concatenate([np.zeros(0, np.int64), *(train.ids for train in every)])
    codes = np.repeat(np.arange(len(every)), [train.times_ms.size for train in every])
    order = np.argsort(times, kind="stable")
    names = [train.population for train in every]
    population = pandas.Categorical.from_codes(codes[order], categories=names)
    rows = {
        "neurons": [train.neurons.size for train in every],
        "spikes": [train.times_ms.size for train in every],
        "rate_hz": [train.rate_hz for train in every],
    }
    traces, weights = {}, {}
    for name in source.probes:
        trace = source.trace(name)
        if trace.at_pre_spikes:
            columns = {"time_ms": trace.times_ms, "pre": trace.pre, "post": trace.post, trace.state: trace.values}
            frame = pandas.DataFrame(columns)
        else:
            of = pandas.Index(trace.ids, name=trace.noun) if trace.noun else pandas.Index([trace.state])
            frame = pandas.DataFrame(trace.values, index=pandas.Index(trace.times_ms, name="time_ms"), columns=of)
        frame.attrs |= {"of": trace.of, "state": trace.state, "unit": trace.unit}
        traces[name] = frame
    for name in source.with_weights:
        part = source.weights(name)
        if part.pre is not None:
            columns = {"pre": part.pre, "post": part.post, "weight": part.weight}
        else:
            axes = np.indices(part.weight.shape).reshape(part.weight.ndim, -1)
            columns = dict(zip(("map", "channel", "row", "column"), axes, strict=True)) | {
                "weight": part.weight.ravel()
            }
        weights[name] = pandas.DataFrame(columns)
    spikes = pandas.DataFrame({"time_ms": times[order], "population": population, "neuron": ids[order]})
    return DataFrames(spikes, pandas.DataFrame(rows, index=pandas.Index(names, name="population")), traces, weights)


_EVEN = 1e-9


def to_neo(run: object) -> neo.Block:
    """Return a Neo block with one segment, the run, and a group for each population.

    The segment has a `SpikeTrain` for each neuron of each population with recorded spikes, also for silent neurons, in
    ms from 0 to the end of the run. Its annotations are `source_population`, and `source_id` and `source_index`, which
    are both the neuron, counted from 0. Each recorded state is an `AnalogSignal` of shape (times, neurons or synapses)
    in the unit and with the name of the state. Its annotations are `probe` and `source_population` or
    `source_projection`; the array annotation `channel_index` has the neurons or synapses. The annotations of the
    block are `simulator`, `backend`, `seed` and `resolution_ms`. Annotations have PyNN's names. Final weights and
    values at pre spikes are left out, since Neo has no type for them.

    Neo: Garcia et al., Front. Neuroinform. 8:10, 2014.

    Args:
        run: a simulation or results.

    Raises:
        ModelError: the package neo is not installed.
    """
    neo = needed("neo", "neo", "to_neo: the package neo is not installed")
    source = Recorded(run)
    annotations = {
        "simulator": "neuro",
        "backend": source.backend,
        "seed": source.seed,
        "resolution_ms": source.resolution_ms,
    }
    block, segment = neo.Block(name=source.network, **annotations), neo.Segment(name=source.network)
    block.segments.append(segment)
    parts: dict[str, list[Any]] = {}
    for train in trains(source) if source.with_spikes else []:
        spikes = list(_spike_trains(train))
        segment.spiketrains.extend(spikes)
        parts.setdefault(train.population, []).extend(spikes)
    for name in source.probes:
        trace = source.trace(name)
        if trace.times_ms.size and not trace.at_pre_spikes:
            signal = _signal(name, trace, source)
            kind = segment.analogsignals if isinstance(signal, neo.AnalogSignal) else segment.irregularlysampledsignals
            kind.append(signal)
            if trace.noun != "synapse":
                parts.setdefault(trace.of, []).append(signal)
    for population, objects in parts.items():
        block.groups.append(neo.Group(objects, name=population))
    return block


def _spike_trains(train: SpikeTrain) -> Any:
    import neo

    order = np.argsort(train.ids, kind="stable")
    ends = np.searchsorted(train.ids[order], train.neurons, side="right")
    begins = np.searchsorted(train.ids[order], train.neurons, side="left")
    times = train.times_ms[order]
    for neuron, begin, end in zip(train.neurons.tolist(), begins, ends, strict=True):
        source = {"source_population": train.population, "source_id": neuron, "source_index": neuron}
        yield neo.SpikeTrain(times[begin:end], units="ms", t_start=0.0, t_stop=train.window[1], **source)


def _signal(name: str, trace: Trace, run: Recorded) -> Any:
    """Return a Neo signal of a trace. If parts of the run were forgotten, it has explicit times."""
    import neo

    unit = trace.unit or "dimensionless"
    annotations: dict[str, Any] = {
        "name": trace.state,
        "array_annotations": {"channel_index": trace.ids},
        "probe": name,
        "source_projection" if trace.noun == "synapse" else "source_population": trace.of,
    }
    steps_ms = np.diff(trace.times_ms)
    if steps_ms.size and np.ptp(steps_ms) > _EVEN * trace.times_ms[-1]:
        return neo.IrregularlySampledSignal(trace.times_ms, trace.values, units=unit, time_units="ms", **annotations)
    import quantities

    span_ms = float(trace.times_ms[-1] - trace.times_ms[0]) if steps_ms.size else run.resolution_ms
    period = span_ms / max(1, steps_ms.size)
    period, start = period * quantities.ms, trace.times_ms[0] * quantities.ms
    return neo.AnalogSignal(trace.values, units=unit, t_start=start, sampling_period=period, **annotations)
