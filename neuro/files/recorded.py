"""What was recorded, read in one way of a simulation that runs and of the results that one has left, and exported."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, unknown
from neuro.core.extras import needed
from neuro.core.quantities import in_ms
from neuro.core.values import shown
from neuro.model.parts import Part
from neuro.model.views import Shaped, View, named
from neuro.program.program import Floats, Ints, Program
from neuro.program.spikes import one_by_one

if TYPE_CHECKING:
    import neo
    from pandas import DataFrame


Window = tuple[float, float]
SMALL = 1_000_000
"""Static weights of more synapses, which follow from network and seed, are kept only where they are asked for."""
_SAME = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of neurons of one population.

    Attributes:
        population: its name.
        neurons: whose spikes these are, ascending.
        times_ms, ids: one entry a spike, sorted by time.
        window: the spikes are those after its begin and up to its end, in ms.
    """

    population: str
    neurons: Ints
    times_ms: Floats
    ids: Ints
    window: Window

    @property
    def rate_hz(self) -> float:
        """The mean rate of a neuron; 0 of none, and of a window without length."""
        seconds = (self.window[1] - self.window[0]) / 1000.0
        return self.times_ms.size / (self.neurons.size * seconds) if self.neurons.size and seconds else 0.0


def intervals(times_ms: Floats, ids: Ints) -> tuple[Floats, Ints]:
    """The intervals between spikes of the same neuron in ms, and whose they are, by neuron, then time."""
    order = np.lexsort((times_ms, ids))
    times_ms, ids = times_ms[order], ids[order]
    same = ids[1:] == ids[:-1]
    return np.diff(times_ms)[same], ids[1:][same]


def variation(times_ms: Floats, ids: Ints) -> Floats:
    """The coefficient of variation of the intervals of each neuron that has two or more, by neuron.

    Standard deviation (of the intervals themselves, not of those they are drawn from) by mean; 1 of a Poisson process.
    Intervals that are all 0, of neurons that emit several spikes in one step and no others, have none.
    Source: Softky & Koch, J. Neurosci. 13:334, 1993
    """
    lengths, whose = intervals(times_ms, ids)
    _, whose, count = np.unique(whose, return_inverse=True, return_counts=True)
    mean = np.bincount(whose, lengths) / count
    square = np.bincount(whose, (lengths - mean[whose]) ** 2) / count
    defined = (count >= 2) & (mean > 0)
    return np.asarray(np.sqrt(square[defined]) / mean[defined])


@dataclass(frozen=True, slots=True, eq=False)
class StateTrace:
    """What a probe recorded of one state, in `unit`.

    Attributes:
        of: the population or projection.
        noun: what a column is of, "neuron" or "synapse"; "" of a rate or a mean, which has one.
        columns: their numbers: of neurons in the population, of synapses among those that are recorded.
        values: shape (times, columns); of synapses at pre spikes (times,), one entry for each spike and synapse.
        pre, post: the ends of each column, at pre spikes of each entry; None of neurons, means and grids.
    """

    of: str
    state: str
    unit: str
    noun: str
    columns: Ints
    times_ms: Floats
    values: NDArray[Any]
    pre: Ints | None = None
    post: Ints | None = None

    @property
    def at_pre_spikes(self) -> bool:
        """Whether it has what pre spikes leave, at their times."""
        return self.values.ndim == 1

    def within(self, window: Window) -> StateTrace:
        """What was recorded in a window, its begin and end included."""
        inside = slice(int(np.searchsorted(self.times_ms, window[0])), up_to(self.times_ms, window[1]))
        pre, post = self.pre, self.post
        if pre is not None and post is not None and self.at_pre_spikes:
            pre, post = pre[inside], post[inside]
        return replace(self, times_ms=self.times_ms[inside], values=self.values[inside], pre=pre, post=post)


@dataclass(frozen=True, slots=True, eq=False)
class SynapseWeights:
    """Weights of one projection: `pre` and `post` of each, None of a grid, whose weights are its kernels."""

    shape: tuple[int, int]
    pre: Ints | None
    post: Ints | None
    weight: Floats


@dataclass(frozen=True, eq=False)
class Recorded:
    """What was recorded of a run, whether a simulation still has it or results do.

    Attributes:
        network, backend: their names.
        seed: of everything random.
        duration_ms, resolution_ms: of the run, and of a step.
        shapes: of the populations, by name.
        kept: names of the populations whose spikes there are.
        held_ms: what was recorded up to then is not held any more.
        weighed: names of the projections whose weights are kept.
        spikes: gives times in ms after a time, and neurons of a population, sorted by time.
        weights: gives the weights of a projection.
        traces_of_run: gives all traces; a simulation copies what it has recorded.
    """

    network: str
    backend: str
    seed: int
    duration_ms: float
    resolution_ms: float
    shapes: dict[str, tuple[int, ...]]
    kept: list[str]
    held_ms: float
    weighed: list[str]
    spikes: Callable[[str, float], tuple[Floats, Ints]]
    weights: Callable[[str], SynapseWeights]
    traces_of_run: Callable[[], Mapping[str, Any]]

    @cached_property
    def _traces(self) -> Mapping[str, Any]:
        return self.traces_of_run()

    @property
    def probes(self) -> dict[str, str]:
        """The probe of each trace, by the name of the trace."""
        return {name: trace.probe or name for name, trace in self._traces.items()}

    def trace(self, name: str) -> StateTrace:
        """What a probe recorded of one state."""
        part = self._traces[name]
        noun = "" if part.single else "synapse" if part.projection else "neuron"
        columns = part.ids if part.ids is not None else np.arange(0 if part.at_pre_spikes else part.columns)
        values = part.values[:, None] if part.single else part.values
        words = (part.state, part.unit, noun, columns, part.times_ms, values)
        return StateTrace(part.projection or part.population, *words, part.pre, part.post)


def recorded(run: Any) -> Recorded:
    """What was recorded.

    Args:
        run: a `neuro.Simulation`, or results.

    Raises:
        ModelError: it is neither.
    """
    if hasattr(run, "program") and hasattr(run, "spikes"):
        return _of_simulation(run)
    if hasattr(run, "traces") and hasattr(run, "populations"):
        return _of_results(run)
    hint = "neuro.compile(net) gives a simulation" if hasattr(run, "populations") else ""
    raise ModelError(f"found {shown(run)}: expected a simulation, or results of a run", hint=hint)


def _of_simulation(run: Any) -> Recorded:
    program: Program = run.program
    sizes = [part.size for part in program.populations]

    def weights(name: str) -> SynapseWeights:
        part = next((each for each in program.projections if each.name == name), None)
        if part is None:
            raise unknown("projection", name, [each.name for each in program.projections])
        values, shape = run.weights(name), (sizes[part.source], sizes[part.target])
        return SynapseWeights(shape, *values) if part.grid is None else SynapseWeights(shape, None, None, values)

    return Recorded(
        program.name,
        run.backend,
        program.seed,
        run.time,
        program.resolution,
        {part.name: part.shape for part in program.populations},
        [part.name for part in program.populations if part.records],
        run.held,
        [part.name for part in program.projections if part.synapse.learns or part.size <= SMALL],
        lambda population, since: run.spikes(population, since=since),
        weights,
        lambda: run.traces,
    )


def _of_results(run: Any) -> Recorded:
    shapes = {name: tuple(part.shape) for name, part in run.populations.items()}

    def spikes(population: str, since: float) -> tuple[Floats, Ints]:
        part = run.populations.get(population)
        if part is None or not part.recorded:
            hint = f"'neuro run --record {population}' keeps them"
            raise ModelError(f"spikes of '{population}' were not kept", hint=hint)
        times = part.times_ms
        first = up_to(times, since) if since > 0 else 0
        times, ids = one_by_one(population, part.multiplicity[first:], times[first:], part.ids[first:])
        return times, ids

    def weights(name: str) -> SynapseWeights:
        if name not in run.projections:
            raise unknown("projection", name, run.projections)
        part = run.projections[name]
        if part.weight is None:
            raise ModelError(f"weights of '{name}' were not kept", hint="'neuro run --all-weights' keeps them")
        shape = (math.prod(shapes[part.source]), math.prod(shapes[part.target]))
        return SynapseWeights(shape, part.pre, part.post, part.weight)

    return Recorded(
        str(run.about["network"]),
        str(run.about.get("backend", "")),
        int(run.about.get("seed", 0)),
        float(run.about["duration_ms"]),
        float(run.about["resolution_ms"]),
        shapes,
        [name for name, part in run.populations.items() if part.recorded],
        0.0,
        [name for name, part in run.projections.items() if part.weight is not None],
        spikes,
        weights,
        lambda: run.traces,
    )


def trains(run: Recorded, of: Any = None, window: Any = None) -> list[SpikeTrain]:
    """Spikes of populations or of some of their neurons.

    Args:
        run: what was recorded.
        of: a population or a view of one, its name, or a list of these; all that was recorded if not given.
        window: begin and end in ms; the whole run if not given.

    Raises:
        ModelError: there is no such population, nothing was recorded, or the window is none.
    """
    begin, end = checked_window(run, window)
    if of is None and not run.kept:
        raise ModelError("no spikes were recorded", hint="net.probe or 'neuro run --record NAME' keeps them")
    is_one = isinstance(of, (str, Part, View, Mapping)) or not isinstance(of, Iterable)
    asked = run.kept if of is None else [of] if is_one else list(of)
    if not asked:
        raise ModelError(f"of = {shown(of)}: expected a population, a view of one, a name, or a list of these")
    found = []
    for each in asked:
        view = named(each, {name: Shaped(name, shape) for name, shape in run.shapes.items()})
        part = view.population if isinstance(view, View) else view
        name = getattr(part, "name", part)
        if not isinstance(name, str) or name not in run.shapes:
            raise unknown("population", name, run.shapes)
        times, ids = run.spikes(name, begin)
        last = up_to(times, end)
        times, ids = times[:last], ids[:last]
        neurons = np.arange(math.prod(run.shapes[name]))
        if isinstance(view, View):
            neurons = view.within(run.shapes[name])[0]
            mine = np.isin(ids, neurons)
            times, ids = times[mine], ids[mine]
        found.append(SpikeTrain(name, np.sort(neurons), times, ids, (begin, end)))
    return found


def checked_window(run: Recorded, window: Any) -> Window:
    """Begin and end in ms of what is looked at: all that is held of the run if not given.

    Raises:
        ModelError: these are not two times, one before the other, what came then is not held any more, or the run ends
            before.
    """
    if window is None:
        return run.held_ms, run.duration_ms
    given = tuple(window) if isinstance(window, (tuple, list, np.ndarray)) else ()
    pair = [in_ms(ms, "window") for ms in given]
    if len(pair) != 2 or not all(is_number(ms) and math.isfinite(ms) for ms in pair) or not 0 <= pair[0] < pair[1]:
        raise ModelError(f"window = {shown(window)}: expected (begin, end) in ms with 0 <= begin < end")
    if pair[0] < run.held_ms:
        message = f"window = {shown(window)}: what was recorded up to {run.held_ms:g} ms is not held any more"
        raise ModelError(f"{message}: expected a begin >= {run.held_ms:g} ms")
    if pair[1] > run.duration_ms * (1.0 + _SAME):
        last = f"{run.duration_ms:.12g} ms"
        raise ModelError(f"window = {shown(window)}: the run ends at {last}: expected an end <= {last}")
    return float(pair[0]), float(pair[1])


def up_to(times_ms: Floats, ms: float) -> int:
    """How many times are not after one; what differs in the last digits only is the same."""
    return int(np.searchsorted(times_ms, ms * (1.0 + _SAME), side="right"))


@dataclass(frozen=True, slots=True, eq=False)
class DataFrames:
    """Data frames of a run.

    Attributes:
        spikes: a row a spike by time: `time_ms`, `population` (a category), `neuron`.
        populations: a row for each population whose spikes were kept, by its name: `neurons`, `spikes`, `rate_hz`.
        traces: of each state that a probe recorded a column for each neuron or synapse, by `time_ms`; of synapses at
            pre spikes a row each: `time_ms`, `pre`, `post` and the state. `attrs` has `of`, `state` and `unit`.
        weights: of each projection a row a synapse: `pre`, `post`, `weight`; of a grid a row a weight of its kernels:
            `map`, `channel`, `row`, `column`, `weight`.
    """

    spikes: DataFrame
    populations: DataFrame
    traces: dict[str, DataFrame]
    weights: dict[str, DataFrame]


def to_pandas(run: object) -> DataFrames:
    """Spikes, rates, traces and weights as data frames.

    Args:
        run: a simulation or results. Static weights above a million synapses of a simulation, which follow from its
            network and seed, are left out, as `neuro run` leaves them out.

    Raises:
        ModelError: the package pandas is not installed.
    """
    pandas = needed("pandas", "pandas", "to_pandas: the package pandas is not installed")
    source = recorded(run)
    every = trains(source) if source.kept else []
    times = np.concatenate([np.zeros(0), *(train.times_ms for train in every)])
    ids = np.concatenate([np.zeros(0, np.int64), *(train.ids for train in every)])
    codes = np.repeat(np.arange(len(every)), [train.times_ms.size for train in every])
    order = np.argsort(times, kind="stable")
    names = [train.population for train in every]
    whose = pandas.Categorical.from_codes(codes[order], categories=names)
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
            of = pandas.Index(trace.columns, name=trace.noun) if trace.noun else pandas.Index([trace.state])
            frame = pandas.DataFrame(trace.values, index=pandas.Index(trace.times_ms, name="time_ms"), columns=of)
        frame.attrs |= {"of": trace.of, "state": trace.state, "unit": trace.unit}
        traces[name] = frame
    for name in source.weighed:
        part = source.weights(name)
        if part.pre is not None:
            columns = {"pre": part.pre, "post": part.post, "weight": part.weight}
        else:
            axes = np.indices(part.weight.shape).reshape(part.weight.ndim, -1)
            columns = dict(zip(("map", "channel", "row", "column"), axes, strict=True)) | {
                "weight": part.weight.ravel()
            }
        weights[name] = pandas.DataFrame(columns)
    spikes = pandas.DataFrame({"time_ms": times[order], "population": whose, "neuron": ids[order]})
    return DataFrames(spikes, pandas.DataFrame(rows, index=pandas.Index(names, name="population")), traces, weights)


_EVEN = 1e-9


def to_neo(run: object) -> neo.Block:
    """A block with one segment, the run, and a group for each population.

    The segment has a `SpikeTrain` for each neuron of each population whose spikes were kept, silent ones too, in ms
    from 0 to the end of the run, annotated with `source_population`, `source_id` (the neuron, counted from 0) and
    `source_index` (likewise); and for each state that a probe recorded an `AnalogSignal` of shape (times, neurons or
    synapses) in the unit of the state, named after it, annotated with `probe` and `source_population` or
    `source_projection`, with the neurons or synapses as the array annotation `channel_index`. The block is annotated
    with `simulator`, `backend`, `seed` and `resolution_ms`. Weights at the end, and what pre spikes leave in synapses,
    are not in it: Neo has no place for them. Annotations have the names that PyNN gives them.

    Neo: Garcia et al., Front. Neuroinform. 8:10, 2014.

    Args:
        run: a simulation or results.

    Raises:
        ModelError: the package neo is not installed.
    """
    neo = needed("neo", "neo", "to_neo: the package neo is not installed")
    source = recorded(run)
    about = {
        "simulator": "neuro",
        "backend": source.backend,
        "seed": source.seed,
        "resolution_ms": source.resolution_ms,
    }
    block, segment = neo.Block(name=source.network, **about), neo.Segment(name=source.network)
    block.segments.append(segment)
    parts: dict[str, list[Any]] = {}
    for train in trains(source) if source.kept else []:
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


def _signal(name: str, trace: StateTrace, run: Recorded) -> Any:
    """A signal; of one that has gaps, as parts of a run that were forgotten leave them, one with its times."""
    import neo

    unit = trace.unit or "dimensionless"
    about: dict[str, Any] = {
        "name": trace.state,
        "array_annotations": {"channel_index": trace.columns},
        "probe": name,
        "source_projection" if trace.noun == "synapse" else "source_population": trace.of,
    }
    every = np.diff(trace.times_ms)
    if every.size and np.ptp(every) > _EVEN * trace.times_ms[-1]:
        return neo.IrregularlySampledSignal(trace.times_ms, trace.values, units=unit, time_units="ms", **about)
    import quantities

    period = float(trace.times_ms[-1] - trace.times_ms[0]) / every.size if every.size else run.resolution_ms
    period, start = period * quantities.ms, trace.times_ms[0] * quantities.ms
    return neo.AnalogSignal(trace.values, units=unit, t_start=start, sampling_period=period, **about)
