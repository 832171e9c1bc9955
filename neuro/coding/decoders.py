"""Decoders of spikes: numbers and decisions from counts and spike times."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.coding.encoders import Floats, rank
from neuro.core.checks import argument, finite, numbers
from neuro.core.errors import ModelError

Ids = npt.NDArray[np.int64]
ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""Largest rounding error of the length of a vector sum, as a share of the sum of lengths. Angles are rounded, too."""


def highest_rate(counts: npt.ArrayLike) -> Ids:
    """Return the neurons with the highest firing rate (HFR).

    Args:
        counts: (n,) number of spikes of each neuron in the same time, e.g. ``np.bincount(ids, minlength=n)``, or rates.

    Returns:
        Ids of all neurons with the highest rate, ascending; empty if no neuron fired.

    Raises:
        ModelError: `counts` is not a list of finite numbers, or a number is below 0.

    Source: thesis section 2.5, line 759.
    """
    rates = _list(finite(counts, "counts", at_least=0), "counts")
    return np.flatnonzero((rates > 0) & (rates == rates.max(initial=0.0)))


def first_to_fire(times: npt.ArrayLike) -> Ids:
    """Return the neurons that fire first (F2F).

    Args:
        times: (n,) time of the first spike of each neuron, or (n, spikes) times of all spikes, in any unit; NaN stands
            for no spike.

    Returns:
        Ids of all neurons with the first time, ascending; empty if no neuron fired.

    Raises:
        ModelError: a time is infinite, or `times` has another shape.

    Source: thesis section 2.5, line 760.
    """
    checked = _times(times)
    if checked.ndim not in (1, 2):
        raise ModelError(f"times has the shape {list(checked.shape)}, expected [neurons] or [neurons, spikes]")
    trains = checked if checked.ndim == 2 else checked[:, None]
    first_times = np.where(np.isnan(trains), np.inf, trains).min(axis=1, initial=np.inf)
    return np.flatnonzero((first_times < np.inf) & (first_times == first_times.min(initial=np.inf)))


def rank_order(
    times: npt.ArrayLike,
    weights: npt.ArrayLike,
    modulation: float = 0.8,
    ties: Literal["order", "dense"] = "order",
) -> Floats:
    """Return the activation of neurons that weigh spikes by rank: the sum of ``modulation^k w`` over ranks k from 0.

    The activation is largest if the inputs fire in the order of descending weights.

    Args:
        times: (n,) time of the spike of each input, in any unit; NaN stands for no spike and adds 0.
        weights: (..., n) weights of each neuron's inputs.
        modulation: factor from one rank to the next, in (0, 1].
        ties: see `rank`.

    Returns:
        Activations, shape of ``weights`` without the last axis.

    Raises:
        ModelError: a value is not a number, ``modulation`` is out of bounds, or the numbers of weights and inputs
            differ.

    Source: Thorpe & Gautrais, "Rank order coding", Computational Neuroscience: Trends in Research (1998).
    """
    argument("modulation", modulation, above=0, at_most=1)
    spikes, w = _list(_times(times), "times"), finite(weights, "weights")
    if w.shape[-1:] != spikes.shape:
        raise ModelError(f"weights has the shape {list(w.shape)}, expected [..., {spikes.size}], one for each time")
    spiked = np.flatnonzero(~np.isnan(spikes))
    factors = np.zeros(spikes.size)
    factors[spiked] = modulation ** (rank(-spikes[spiked], ties) - 1.0)
    return np.asarray(w @ factors)


def population_vector(activity: npt.ArrayLike, directions: npt.ArrayLike) -> Floats:
    """Return the direction that a population encodes: the angle of ``sum of c exp(i theta)``.

    Args:
        activity: (..., n) counts or rates of neurons, at least 0.
        directions: (n,) preferred direction of each neuron, rad.

    Returns:
        Angles in [-pi, pi], rad, the shape of ``activity`` without its last axis; NaN if no neuron fired, or if
        the activities cancel except for rounding.

    Raises:
        ModelError: a value is infinite, NaN or below 0, or the numbers of directions and neurons differ.

    Source: Georgopoulos, Schwartz & Kettner, Science 233 (1986).
    """
    c, theta = finite(activity, "activity", at_least=0), _list(finite(directions, "directions"), "directions")
    if c.shape[-1:] != theta.shape:
        message = f"activity has the shape {list(c.shape)}, expected [..., {theta.size}]"
        raise ModelError(f"{message}, one for each direction", path=("activity",))
    vector = c @ np.exp(1j * theta)
    return np.where(np.abs(vector) <= ROUNDING * c.sum(axis=-1), np.nan, np.angle(vector))


def van_rossum(times: npt.ArrayLike, tau: float, at: npt.ArrayLike) -> Floats:
    """Return a spike train as a function of time: ``f(t) = sum of exp(-(t - t_f) / tau)`` over the spikes up to t.

    The integral of ``(f - g)^2 / tau`` is the squared distance of two trains: 1/2 for one missing spike,
    ``1 - exp(-d / tau)`` for a spike moved by d.

    Args:
        times: (n,) spike times of one train in any order, ms; NaN is ignored.
        tau: time constant, ms.
        at: times t at which f is computed, any shape, ms.

    Returns:
        Values of f, shape of ``at``.

    Raises:
        ModelError: a value is not a number, or ``tau`` is not positive.

    Source: van Rossum, Neural Computation 13 (2001), "A novel spike distance".
    """
    scale, t = argument("tau", tau, above=0), finite(at, "at")
    train = _list(_times(times), "times")
    spikes = np.sort(train[~np.isnan(train)])
    if not spikes.size:
        return np.zeros(t.shape)
    decays = np.exp([(a - b) / scale for a, b in pairwise(spikes)])
    level = np.array(list(accumulate(decays, lambda x, fall: x * fall + 1.0, initial=1.0)))
    index = np.searchsorted(spikes, t, side="right") - 1
    f: Floats = np.where(index < 0, 0.0, level[index] * np.exp(-np.maximum(t - spikes[index], 0.0) / scale))
    return f


def _times(values: npt.ArrayLike) -> Floats:
    """Return checked spike times; NaN stands for no spike."""
    times = numbers(values, "times")
    if np.isinf(times).any():
        raise ModelError("times has an infinite value, expected times, or NaN for no spike", path=("times",))
    return times


def _list(values: Floats, name: str) -> Floats:
    if values.ndim != 1:
        raise ModelError(f"{name} has the shape {list(values.shape)}, expected one axis", path=(name,))
    return values
