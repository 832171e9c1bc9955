"""Statistics of the microcircuit by the rules of its benchmark: distributions over neurons, and their distances.

Source: INM-6/microcircuit-PD14-model, PyNEST/reference_data (Dasbach et al., Front. Neurosci. 15:757790, 2021). Each
population has three distributions: mean rates of all neurons; coefficients of variation of the intervals of neurons
with three spikes or more; correlation coefficients of counts in 2 ms of all pairs of 250 neurons. Two distributions are
compared by the statistic of Kolmogorov and Smirnov.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from spike_statistics import Figure, Recording, Train, irregularities, over

Floats = NDArray[np.float64]
Distributions = Mapping[str, Mapping[str, Floats]]
"""Values of one network, by measure and population."""

BIN_MS = 2.0
SAMPLE = 250
"""Number of neurons of a population whose pairs are correlated."""
LEAST_SPIKES = 3
MEASURES = {"rates": "rate, Hz", "spike_cvs": "CV of intervals", "spike_ccs": "correlation of counts in 2 ms"}
"""Titles of the measures, by their names in the files of the reference."""


def rates(train: Train, begin: float, end: float) -> Floats:
    """Return the rate of each neuron in Hz."""
    return np.bincount(train.neurons, minlength=train.size) / (end - begin) * 1e3


def correlations(train: Train, begin: float, end: float, seed: int = 12345) -> Floats:
    """Draw `SAMPLE` neurons by `seed`. Return the correlation coefficients of all pairs of those that fire."""
    chosen = np.sort(np.random.default_rng(seed).permutation(train.size)[:SAMPLE])
    row = np.searchsorted(chosen, train.neurons)
    kept = chosen[np.minimum(row, chosen.size - 1)] == train.neurons
    bins = round((end - begin) / BIN_MS)
    column = np.ceil(np.round((train.times[kept] - begin) / BIN_MS, 6)).astype(np.int64) - 1
    counts = coo_array((np.ones(column.size), (row[kept], column)), shape=(chosen.size, bins)).tocsr()
    mean = np.asarray(counts.sum(axis=1)).ravel() / bins
    shared = (counts @ counts.T).toarray() / bins - np.outer(mean, mean)
    fires = np.flatnonzero(np.diag(shared) > 0.0)
    deviation = np.sqrt(np.diag(shared)[fires])
    found: Floats = (shared[np.ix_(fires, fires)] / np.outer(deviation, deviation))[np.triu_indices(fires.size, 1)]
    return found


def distributions(recording: Recording) -> dict[str, dict[str, Floats]]:
    """Return all measures of all populations."""
    begin, end = recording.begin, recording.end
    trains = recording.trains.items()
    return {
        "rates": {name: rates(train, begin, end) for name, train in trains},
        "spike_cvs": {name: irregularities(train, LEAST_SPIKES) for name, train in trains},
        "spike_ccs": {name: correlations(train, begin, end) for name, train in trains},
    }


def distance(one: Floats, other: Floats) -> float:
    """Return the statistic of Kolmogorov and Smirnov, from 0 to 1, or NaN if a distribution has no values.

    It is the largest difference of the shares of values up to any number. SciPy's function would also compute how
    likely it is, which warns for few values.
    """
    if not (one.size and other.size):
        return float("nan")
    at = np.concatenate((one, other))
    shares = [np.searchsorted(np.sort(values), at, "right") / values.size for values in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())


def within(networks: Sequence[Distributions], measure: str, population: str) -> Figure:
    """Return mean and standard deviation of the distances of all pairs of networks of one simulator."""
    return _spread(distance(a[measure][population], b[measure][population]) for a, b in combinations(networks, 2))


def between(ones: Sequence[Distributions], others: Sequence[Distributions], measure: str, population: str) -> Figure:
    """Return mean and standard deviation of the distances of all pairs of a network of each simulator."""
    return _spread(distance(a[measure][population], b[measure][population]) for a, b in product(ones, others))


def mean(networks: Sequence[Distributions], measure: str, population: str) -> Figure:
    """Return the mean over neurons or pairs, and over networks, with its standard error."""
    return over(np.array([np.mean(each[measure][population]) for each in networks if each[measure][population].size]))


def _spread(distances: Iterable[float]) -> Figure:
    found = np.array(list(distances))
    if found.size == 0:
        return Figure(float("nan"), float("nan"))
    return Figure(float(found.mean()), float(found.std()) if found.size > 1 else float("nan"))
