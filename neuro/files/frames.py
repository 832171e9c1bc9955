"""What was recorded as data frames of pandas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.core.extras import needed
from neuro.files.recorded import Recorded, Synapses, recorded, trains

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
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


def to_pandas(run: object) -> Frames:
    """Spikes, rates, traces and weights as data frames.

    Args:
        run: a simulation or results. Static weights above a million synapses of a simulation, which follow from its
            network and seed, are left out, as `neuro run` leaves them out.

    Raises:
        ModelError: the package pandas is not installed.
    """
    pandas = needed("pandas", "pandas", "to_pandas: the package pandas is not installed")
    told = recorded(run)
    return Frames(
        *_of_spikes(pandas, told),
        {name: _of_trace(pandas, told, name) for name in told.probes},
        {name: _of_weights(pandas, told.weights(name)) for name in told.weighed},
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


def _of_weights(pandas: Any, found: Synapses) -> Any:
    if found.pre is not None:
        return pandas.DataFrame({"pre": found.pre, "post": found.post, "weight": found.weight})
    axes = np.indices(found.weight.shape).reshape(found.weight.ndim, -1)
    places = dict(zip(("map", "channel", "row", "column"), axes, strict=True))
    return pandas.DataFrame({**places, "weight": found.weight.ravel()})
