"""What was recorded as data frames of pandas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.core.extras import needed
from neuro.files.recorded import Recorded, SpikeTrain, StateTrace, SynapseWeights, recorded, trains

if TYPE_CHECKING:
    import neo
    from pandas import DataFrame


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
    return DataFrames(
        *_of_spikes(pandas, source),
        {name: _of_trace(pandas, source, name) for name in source.probes},
        {name: _of_weights(pandas, source.weights(name)) for name in source.weighed},
    )


def _of_spikes(pandas: Any, run: Recorded) -> tuple[Any, Any]:
    found = trains(run) if run.kept else []
    times = np.concatenate([np.zeros(0), *(train.times_ms for train in found)])
    ids = np.concatenate([np.zeros(0, np.int64), *(train.ids for train in found)])
    codes = np.repeat(np.arange(len(found)), [train.times_ms.size for train in found])
    order = np.argsort(times, kind="stable")
    names = [train.population for train in found]
    whose = pandas.Categorical.from_codes(codes[order], categories=names)
    spikes = pandas.DataFrame({"time_ms": times[order], "population": whose, "neuron": ids[order]})
    rows = {
        "neurons": [train.neurons.size for train in found],
        "spikes": [train.times_ms.size for train in found],
        "rate_hz": [train.rate_hz for train in found],
    }
    return spikes, pandas.DataFrame(rows, index=pandas.Index(names, name="population"))


def _of_trace(pandas: Any, run: Recorded, name: str) -> Any:
    trace = run.trace(name)
    if trace.at_pre_spikes:
        columns = {"time_ms": trace.times_ms, "pre": trace.pre, "post": trace.post, trace.state: trace.values}
        frame = pandas.DataFrame(columns)
    else:
        whose = pandas.Index(trace.columns, name=trace.noun) if trace.noun else pandas.Index([trace.state])
        frame = pandas.DataFrame(trace.values, index=pandas.Index(trace.times_ms, name="time_ms"), columns=whose)
    frame.attrs |= {"of": trace.of, "state": trace.state, "unit": trace.unit}
    return frame


def _of_weights(pandas: Any, found: SynapseWeights) -> Any:
    if found.pre is not None:
        return pandas.DataFrame({"pre": found.pre, "post": found.post, "weight": found.weight})
    axes = np.indices(found.weight.shape).reshape(found.weight.ndim, -1)
    places = dict(zip(("map", "channel", "row", "column"), axes, strict=True))
    return pandas.DataFrame({**places, "weight": found.weight.ravel()})


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
