"""Statistics of spikes: rates, irregularity and correlations of each population, with standard errors.

A `Recording` has the spikes of a stretch. `measured` returns its figures, `together` joins the figures of several
seeds, and `apart` returns the difference of two figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

BIN_MS = 2.0
BLOCKS = 10
LEAST_SPIKES = 10
"""Least number of spikes of a neuron for which its irregularity is computed."""


@dataclass(frozen=True)
class Train:
    """Spikes of one population.

    Attributes:
        size: number of neurons.
        times, neurons: time in ms, and id, of each spike, (spikes,).
    """

    size: int
    times: NDArray[np.float64]
    neurons: NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """Spikes of all populations after `begin` and up to `end`, ms."""

    begin: float
    end: float
    trains: Mapping[str, Train]

    def save(self, path: str | Path) -> None:
        """Write an .npz with `window`, and for each population `NAME_size`, `NAME_times` and `NAME_neurons`."""
        arrays: dict[str, Any] = {"window": [self.begin, self.end]}
        for name, train in self.trains.items():
            arrays |= {f"{name}_size": train.size, f"{name}_times": train.times}
            arrays[f"{name}_neurons"] = train.neurons.astype(np.int32)
        np.savez_compressed(path, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Recording:
        """Read a recording from the file of `save`."""
        with np.load(path) as file:
            names = [key.removesuffix("_size") for key in file if key.endswith("_size")]
            trains = {
                name: Train(int(file[f"{name}_size"]), file[f"{name}_times"], file[f"{name}_neurons"].astype(np.int64))
                for name in names
            }
            begin, end = file["window"].tolist()
        return cls(begin, end, trains)


@dataclass(frozen=True)
class Figure:
    """A mean and its standard error."""

    value: float
    error: float


def rate(train: Train, begin: float, end: float) -> Figure:
    """Return the mean rate of a neuron in Hz. Its error is the error of the mean over ten blocks of time."""
    block = np.minimum(((train.times - begin) / (end - begin) * BLOCKS).astype(np.int64), BLOCKS - 1)
    seconds = (end - begin) / BLOCKS / 1e3
    return over(np.bincount(block, minlength=BLOCKS) / train.size / seconds)


def irregularity(train: Train, least: int = LEAST_SPIKES) -> Figure:
    """Return the mean of `irregularities`, or NaN if there is none."""
    return over(irregularities(train, least))


def irregularities(train: Train, least: int = LEAST_SPIKES) -> NDArray[np.float64]:
    """Return the coefficient of variation of the intervals of each neuron with at least `least` spikes."""
    order = np.lexsort((train.times, train.neurons))
    times, neurons = train.times[order], train.neurons[order]
    inside = neurons[1:] == neurons[:-1]
    interval, of = np.diff(times)[inside], neurons[1:][inside]
    number = np.bincount(of, minlength=train.size)
    used = number >= least - 1
    mean = np.bincount(of, interval, train.size) / np.maximum(number, 1)
    variance = np.bincount(of, (interval - mean[of]) ** 2, train.size) / np.maximum(number, 1)
    found: NDArray[np.float64] = np.sqrt(variance[used]) / mean[used]
    return found


def correlation(train: Train, begin: float, end: float, bin_ms: float = BIN_MS) -> Figure:
    """Return the mean correlation coefficient of the counts of two neurons in bins, over all pairs that fired.

    The counts of each neuron are scaled to mean 0 and variance 1. The mean is then (<S^2> - n) / (n (n - 1)), where S
    is the sum over n neurons in a bin, so no pairs are computed. The error is the error of the mean over ten blocks of
    bins.
    """
    bins = round((end - begin) / bin_ms)
    place = np.ceil(np.round((train.times - begin) / bin_ms, 6)).astype(np.int64) - 1
    ids, who = np.unique(train.neurons, return_inverse=True)
    cells, count = np.unique(who * bins + place, return_counts=True)
    row, column = np.divmod(cells, bins)
    mean = np.bincount(row, count, ids.size) / bins
    variance = np.bincount(row, count * count, ids.size) / bins - mean**2
    varies = variance > 0.0
    n = int(varies.sum())
    if n < 2:
        return Figure(float("nan"), float("nan"))
    scale = np.zeros(ids.size)
    scale[varies] = 1.0 / np.sqrt(variance[varies])
    total = np.bincount(column, count * scale[row], bins) - float((mean * scale).sum())
    shared = (total**2 - n) / (n * (n - 1.0))
    found = over(np.array([part.mean() for part in np.array_split(shared, BLOCKS)]))
    return Figure(float(shared.mean()), found.error)


def over(values: NDArray[np.float64]) -> Figure:
    """Return the mean of independent values (of blocks of time, neurons or seeds), or NaN without values."""
    if values.size == 0:
        return Figure(float("nan"), float("nan"))
    error = float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else float("nan")
    return Figure(float(values.mean()), error)


MEASURES = ("rate", "irregularity", "correlation")


def measured(recording: Recording) -> dict[str, dict[str, Figure]]:
    """Return the figures of each population, by name and measure."""
    begin, end = recording.begin, recording.end
    return {
        name: {
            "rate": rate(train, begin, end),
            "irregularity": irregularity(train),
            "correlation": correlation(train, begin, end),
        }
        for name, train in recording.trains.items()
    }


def together(figures: Iterable[Figure]) -> Figure:
    """Return the mean of several seeds. Its error is the larger of the errors among the seeds and within them."""
    each: Sequence[Figure] = list(figures)
    if len(each) == 1:
        return each[0]
    found = over(np.array([figure.value for figure in each]))
    within = float(np.sqrt(sum(figure.error**2 for figure in each))) / len(each)
    return Figure(found.value, float(np.nanmax([found.error, within])))


def apart(one: Figure, other: Figure) -> tuple[float, float]:
    """Return the difference of `other` from `one`, as a share of `one`, and in standard errors of the difference."""
    difference = other.value - one.value
    return difference / one.value, difference / float(np.hypot(one.error, other.error))


def agree(one: Figure, other: Figure, share: float = 0.05, errors: float = 3.0) -> bool:
    """Return True if two figures differ by at most a share of the first, or by at most `errors` standard errors."""
    relative, standard = apart(one, other)
    return abs(relative) <= share or abs(standard) <= errors
