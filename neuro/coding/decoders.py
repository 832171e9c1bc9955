"""Spikes to numbers and decisions."""

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
"""Of a vector's length, in shares of what it sums: angles up to pi are rounded, too."""


def highest_rate(counts: npt.ArrayLike) -> Ids:
    """The neurons with the highest firing rate (HFR).

    Args:
        counts: (n,) spikes of each neuron in the same time, e.g. ``np.bincount(ids, minlength=n)``, or rates.

    Returns:
        Ids of all that share the highest one, ascending; none if no neuron fired.

    Raises:
        ModelError: they are no list of finite numbers, or one is below 0.

    Source: thesis section 2.5, line 759.
    """
    found = _list(finite(counts, "counts", at_least=0), "counts")
    return np.flatnonzero((found > 0) & (found == found.max(initial=0.0)))


def first_to_fire(times: npt.ArrayLike) -> Ids:
    """The neurons that fire first (F2F).

    Args:
        times: (n,) first spike of each neuron, or (n, spikes) of all, in any unit; NaN is no spike.

    Returns:
        Ids of all that share the first time, ascending; none if no neuron fired.

    Raises:
        ModelError: they are NaN, or of another shape.

    Source: thesis section 2.5, line 760.
    """
    found = _times(times)
    if found.ndim not in (1, 2):
        raise ModelError(f"times has the shape {list(found.shape)}, expected [neurons] or [neurons, spikes]")
    trains = found if found.ndim == 2 else found[:, None]
    first = np.where(np.isnan(trains), np.inf, trains).min(axis=1, initial=np.inf)
    return np.flatnonzero((first < np.inf) & (first == first.min(initial=np.inf)))


def rank_order(
    times: npt.ArrayLike,
    weights: npt.ArrayLike,
    modulation: float = 0.8,
    ties: Literal["order", "dense"] = "order",
) -> Floats:
    """The activation of neurons that listen to the order of spikes alone: ``sum of modulation^k w`` for ranks k from 0.

    It is largest for the order in which the weights fall.

    Args:
        times: (n,) spike of each input, in any unit; NaN is no spike and adds nothing.
        weights: (..., n) weights of each neuron's inputs.
        modulation: factor from one rank to the next, in (0, 1].
        ties: as `rank` has them.

    Returns:
        Activations, the shape of ``weights`` without its last axis.

    Raises:
        ModelError: a value is not a number, ``modulation`` out of bounds, or weights of another number of inputs.

    Source: Thorpe & Gautrais, "Rank order coding", Computational Neuroscience: Trends in Research (1998).
    """
    argument("modulation", modulation, above=0, at_most=1)
    at, w = _list(_times(times), "times"), finite(weights, "weights")
    if w.shape[-1:] != at.shape:
        raise ModelError(f"weights has the shape {list(w.shape)}, expected [..., {at.size}], a weight for each time")
    spiked = np.flatnonzero(~np.isnan(at))
    factors = np.zeros(at.size)
    factors[spiked] = modulation ** (rank(-at[spiked], ties) - 1.0)
    return np.asarray(w @ factors)


def population_vector(activity: npt.ArrayLike, directions: npt.ArrayLike) -> Floats:
    """The direction that a population tells: the angle of ``sum of c exp(i theta)``.

    Args:
        activity: (..., n) counts or rates of neurons, at least 0.
        directions: (n,) what each prefers, rad.

    Returns:
        Angles in [-pi, pi], rad, the shape of ``activity`` without its last axis; NaN where no neuron fired, or
        activity cancels to what rounding leaves.

    Raises:
        ModelError: a value is not finite, below 0, or directions of another number of neurons.

    Source: Georgopoulos, Schwartz & Kettner, Science 233 (1986).
    """
    c, theta = finite(activity, "activity", at_least=0), _list(finite(directions, "directions"), "directions")
    if c.shape[-1:] != theta.shape:
        message = f"activity has the shape {list(c.shape)}, expected [..., {theta.size}]"
        raise ModelError(f"{message}, one for each direction", path=("activity",))
    vector = c @ np.exp(1j * theta)
    return np.where(np.abs(vector) <= ROUNDING * c.sum(axis=-1), np.nan, np.angle(vector))


def van_rossum(times: npt.ArrayLike, tau: float, at: npt.ArrayLike) -> Floats:
    """A spike train as a function of time: ``f(t) = sum of exp(-(t - t_f) / tau)`` over the spikes up to t.

    The integral of ``(f - g)^2 / tau`` is the squared distance of two trains: 1/2 for one spike that is missing,
    ``1 - exp(-d / tau)`` for one that is moved by d.

    Args:
        times: (n,) spikes of one train in any order, ms; NaN is none.
        tau: time constant, ms.
        at: times t at which f is wanted, any shape, ms.

    Returns:
        f, the shape of ``at``.

    Raises:
        ModelError: a value is not a number, or ``tau`` not positive.

    Source: van Rossum, Neural Computation 13 (2001), "A novel spike distance".
    """
    scale, t = argument("tau", tau, above=0), finite(at, "at")
    train = _list(_times(times), "times")
    spikes = np.sort(train[~np.isnan(train)])
    if not spikes.size:
        return np.zeros(t.shape)
    falls = np.exp([(a - b) / scale for a, b in pairwise(spikes)])
    level = np.array(list(accumulate(falls, lambda x, fall: x * fall + 1.0, initial=1.0)))
    last = np.searchsorted(spikes, t, side="right") - 1
    f: Floats = np.where(last < 0, 0.0, level[last] * np.exp(-np.maximum(t - spikes[last], 0.0) / scale))
    return f


def _times(values: npt.ArrayLike) -> Floats:
    """Spike times; NaN is none."""
    found = numbers(values, "times")
    if np.isinf(found).any():
        raise ModelError("times has an infinite value, expected times, or NaN for no spike", path=("times",))
    return found


def _list(values: Floats, name: str) -> Floats:
    if values.ndim != 1:
        raise ModelError(f"{name} has the shape {list(values.shape)}, expected one axis", path=(name,))
    return values
