"""What an output says of a recording: a score for each of its neurons, and the neuron that decides.

| decides by | score | of several equal ones | nothing |
| --- | --- | --- | --- |
| counts | spikes, of a graded output the sum of payloads | the first to fire, then the lowest | where none fires |
| first | ms of the first spike, NaN without one | the one that fires most, then the lowest | where none fires |
| potential | mean V_m over all steps, mV | the lowest | where all are equal |

That of `counts` is the rule of `neuro train`, that of `potential` the one of its loss.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from neuro.coding.decoders import first_to_fire, highest_rate

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SILENT = -1
"""The decision where there is nothing to decide by."""


def by_counts(times: Floats, ids: Ints, neurons: int, payloads: Ints | None = None) -> tuple[int, Floats]:
    """The neuron that fires most, and the spikes of each; of a graded output that of the largest sum, and the sums.

    Args:
        times: of spikes, ms.
        ids: which neuron emits each.
        neurons: of the output.
        payloads: of the spikes of a graded output.
    """
    counts, first = _counts_and_first(times, ids, neurons)
    if payloads is not None:
        sums = np.bincount(ids, payloads, minlength=neurons).astype(np.float64)
        return int(np.lexsort((first, -sums))[0]) if ids.size else SILENT, sums
    most = highest_rate(counts)
    return _first_of(most[first_to_fire(first[most])]), counts


def by_first(times: Floats, ids: Ints, neurons: int) -> tuple[int, Floats]:
    """The neuron that fires first, and the time of the first spike of each; arguments as of `by_counts`."""
    counts, first = _counts_and_first(times, ids, neurons)
    soonest = first_to_fire(first)
    return _first_of(soonest[highest_rate(counts[soonest])]), first


def by_potential(V_m: Floats) -> tuple[int, Floats]:
    """The neuron with the highest mean potential, and the mean of each.

    Args:
        V_m: (steps, neurons), mV.
    """
    mean = V_m.mean(axis=0)
    return (SILENT if (mean == mean[0]).all() else int(mean.argmax())), mean


def _counts_and_first(times: Floats, ids: Ints, neurons: int) -> tuple[Floats, Floats]:
    first = np.full(neurons, np.inf)
    np.minimum.at(first, ids, times)
    return np.bincount(ids, minlength=neurons).astype(np.float64), np.where(np.isinf(first), np.nan, first)


def _first_of(neurons: Ints) -> int:
    return int(neurons[0]) if neurons.size else SILENT
