"""Encoders: numbers to the latency of one spike, to rates, or to trains of several spikes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro.coding.work import on_numbers
from neuro.core.checks import argument, finite, numbers
from neuro.core.errors import ModelError
from neuro.core.keyed_random import generator

Floats: TypeAlias = npt.NDArray[np.float64]


def intensity_to_latency(r: npt.ArrayLike, r_min: float, r_max: float, window: float) -> Floats:
    """Linear intensity-to-latency code (I2L): the largest value spikes at 0, the smallest at ``window``.

    ``t = window (r_max - r) / (r_max - r_min)``

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value that spikes last.
        r_max: the value that spikes first.
        window: length of the code, in the unit of the returned times (ms).

    Returns:
        Spike times, shape of ``r``, in [0, window].

    Raises:
        ModelError: a value is not a number or outside of the range, ``r_min`` is not below ``r_max``, or ``window`` is
            not positive.

    Source: thesis eq. 14, line 689, with its misprint corrected: the printed equation gives late spikes to
        high values, which contradicts the sentence before it.
    """
    check_bounds(r_min, r_max)
    length, values = argument("window", window, above=0), numbers(r, "r")
    check_inside(values, r_min, r_max)
    latency: Floats = length * (r_max - values) / (r_max - r_min)
    return latency


def log_intensity_to_latency(r: npt.ArrayLike, r_min: float, r_max: float, window: float) -> Floats:
    """Logarithmic intensity-to-latency code (log I2L): equal ratios of values give equal delays.

    ``t = window (ln r_max - ln r) / (ln r_max - ln r_min)``

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit. A value of at most 0 has no logarithm, so it has
            no spike.
        r_min: the value that spikes last; more than 0.
        r_max: the value that spikes first.
        window: length of the code, in the unit of the returned times (ms).

    Returns:
        Spike times, shape of ``r``, in [0, window]; NaN stands for no spike.

    Raises:
        ModelError: a value is not a number, a value above 0 is outside of the range, ``0 < r_min < r_max`` does not
            hold, or ``window`` is not positive.

    Source: thesis eq. 15, line 693.
    """
    check_bounds(r_min, r_max)
    argument("r_min", r_min, above=0)
    length, values = argument("window", window, above=0), numbers(r, "r")
    spiking = ~((values <= 0) & np.isfinite(values))
    check_inside(values[spiking], r_min, r_max)
    logarithm = np.log(values, where=spiking, out=np.full(values.shape, np.nan))
    latency: Floats = length * (np.log(r_max) - logarithm) / (np.log(r_max) - np.log(r_min))
    return latency


def rank(r: npt.ArrayLike, ties: Literal["order", "dense"] = "order", window: float | None = None) -> Floats:
    """Rank code: values spike in descending order; only their ranks matter.

    Args:
        r: values, any shape and unit; all are ranked together.
        ties: "order": equal values spike one after the other, in C order; "dense": equal values share a rank, and the
            next smaller value has the next rank.
        window: length of the code; by default the ranks are the times (ms).

    Returns:
        Spike times, shape of ``r``: the ranks 1 to n, or ``window rank / n`` for n values.

    Raises:
        ModelError: a value is not finite, ``ties`` is another word, or ``window`` is not positive.

    Source: thesis section 2.3.2, line 697.
    """
    dense = argument("ties", ties, words=("order", "dense")) == "dense"
    scale = argument("window", window, above=0, optional=True)
    values = finite(r, "r")
    flat = values.ravel()
    ranks = np.empty(flat.size)
    if dense:
        ranks[:] = np.unique(-flat, return_inverse=True)[1].reshape(-1) + 1
    else:
        ranks[np.argsort(-flat, kind="stable")] = np.arange(1, flat.size + 1)
    times = ranks if scale is None else scale * ranks / max(flat.size, 1)
    return times.reshape(values.shape)


_WIDTHS = 1.5  # Bohte's beta: the width of a field is the distance of fields divided by beta


def rate(r: npt.ArrayLike, r_min: float, r_max: float, max_rate: float, min_rate: float = 0.0) -> Floats:
    """Rate code: rates in proportion to values.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value with the lowest rate.
        r_max: the value with the highest rate.
        max_rate: the highest rate, Hz.
        min_rate: the lowest rate, at least 0 and below ``max_rate``, Hz.

    Returns:
        Rates in Hz, shape of ``r``.

    Raises:
        ModelError: a value is not a number or outside of the range, ``r_min`` is not below ``r_max``, or
            ``0 <= min_rate < max_rate`` does not hold.

    Source: thesis eq. 12, line 672: a rate is a number of spikes over a time.
    """
    low, high = argument("min_rate", min_rate), argument("max_rate", max_rate)
    if not 0 <= low < high:
        message = f"min_rate is {min_rate} and max_rate {max_rate}"
        raise ModelError(f"{message}, expected 0 <= min_rate < max_rate", path=("max_rate",))
    rates: Floats = low + (high - low) * share(r, r_min, r_max)
    return rates


def population(
    r: npt.ArrayLike,
    n: int,
    r_min: float,
    r_max: float,
    max_rate: float,
    fields: Literal["gaussian", "cosine"] = "gaussian",
) -> Floats:
    """Population code: each value excites n neurons, most strongly the neurons whose field is near the value.

    Gaussian fields lie on a line: with the distance ``d = (r_max - r_min) / (n - 2)`` the centre of neuron i, from 0,
    is ``r_min + (i - 1/2) d``, and the standard deviation is d / 1.5. Cosine fields lie on a circle, on which
    ``r_min`` and ``r_max`` are one direction: neuron i prefers the angle ``2 pi i / n`` from that direction, and its
    rate is the cosine of the angle between value and preference, or 0 if the cosine is negative.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        n: number of neurons for each value, at least 3.
        r_min: the smallest value.
        r_max: the largest value.
        max_rate: rate of a neuron at the centre of its field, Hz.
        fields: "gaussian" on a line or "cosine" on a circle.

    Returns:
        Rates in Hz, shape of ``r`` with one more axis of n neurons.

    Raises:
        ModelError: a value is not a number or outside of the range, ``r_min`` is not below ``r_max``, ``n`` or
            ``max_rate`` is out of bounds, or ``fields`` is another word.

    Source: gaussian: Bohte, La Poutre & Kok, IEEE Trans. Neural Networks 13 (2002); cosine: Georgopoulos,
        Schwartz & Kettner, Science 233 (1986).
    """
    neurons = np.arange(argument("n", n, kind="integer", at_least=3, at_most=2**20))
    peak: float = argument("max_rate", max_rate, above=0)
    circle = argument("fields", fields, words=("gaussian", "cosine")) == "cosine"
    check_bounds(r_min, r_max)
    values = numbers(r, "r")
    check_inside(values, r_min, r_max)
    if circle:
        angle = 2.0 * np.pi * ((values[..., None] - r_min) / (r_max - r_min) - neurons / neurons.size)
        return peak * np.maximum(np.cos(angle), 0.0)
    distance = (r_max - r_min) / (neurons.size - 2)
    offsets = (values[..., None] - r_min) / distance - (neurons - 0.5)
    activity: Floats = peak * np.exp(-0.5 * (_WIDTHS * offsets) ** 2)
    return activity


MOST_SPIKES = 2**28
"""Largest number of spike times in a table."""
_ROUNDING = 1e-9  # a product this close to a whole number counts as that number


def poisson(r: npt.ArrayLike, window: float, seed: int = 0) -> Floats:
    """Poisson trains: the number of spikes follows ``(lambda T)^k exp(-lambda T) / k!``, and spike times are uniform.

    Mean and variance of the number are lambda T. At most one spike in each step h would change the mean or the
    variance: with the probability lambda h the variance is (1 - lambda h) times the mean, and with 1 - exp(-lambda h)
    the mean is too small.

    Args:
        r: rates, Hz, at least 0, any shape.
        window: length of the trains, ms.
        seed: seed of the draws.

    Returns:
        Spike times in ms in [0, window), shape of ``r`` with one more axis, each row in ascending order.

    Raises:
        ModelError: a value is not finite, a rate is below 0, ``window`` is not positive, or there are too many
            spikes.

    Source: thesis eq. 13, line 676, with the factor T that the printed equation lacks.
    """
    length: float = argument("window", window, above=0)
    rates = finite(r, "r", unit="Hz", at_least=0)
    mean = rates * (length / 1000.0)
    if mean.size and mean.max() * mean.size > MOST_SPIKES:
        message = f"up to {mean.max():g} spikes of each of {mean.size} trains"
        raise ModelError(f"{message}, expected a table of at most {MOST_SPIKES} times", path=("window",))
    rng = generator(argument("seed", seed, kind="integer", at_least=0, at_most=2**64 - 1), "code", "poisson")
    counts = np.asarray(rng.poisson(mean))
    longest_train = int(counts.max(initial=0))
    times = rng.random((*mean.shape, longest_train)) * length
    times[np.arange(longest_train) >= counts[..., None]] = np.nan
    times.sort(axis=-1)
    return times


def phase(r: npt.ArrayLike, r_min: float, r_max: float, window: float, bits: int = 8) -> Floats:
    """Phase code: the k-th phase of a window has a spike of weight 2^-(k+1) if the k-th binary digit is 1.

    The share ``P = (r - r_min) / (r_max - r_min)`` is rounded to the nearest multiple of 2^-bits, so the weights of
    the spikes sum to P within 2^-(bits+1). All phases spike for a share above the largest sum, 1 - 2^-bits.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value without a spike.
        r_max: the value with a spike in every phase.
        window: length of all phases together (ms).
        bits: number of phases, 1 to 52.

    Returns:
        Spike times, the shape of ``r`` and an axis of phases, most significant first: ``window k / bits`` or NaN.

    Raises:
        ModelError: a value is not a number or outside of the range, ``r_min`` is not below ``r_max``, ``window`` is not
            positive, or ``bits`` is out of bounds.

    Source: Kim, Kim, Huh, Lee & Choi, Neurocomputing 311 (2018), "Deep neural networks with weighted spikes".
    """
    n = argument("bits", bits, kind="integer", at_least=1, at_most=52)
    length: float = argument("window", window, above=0)
    levels = np.minimum(np.rint(share(r, r_min, r_max) * 2.0**n), 2.0**n - 1).astype(np.int64)
    digits = levels[..., None] >> np.arange(n - 1, -1, -1) & 1
    return np.where(digits == 1, length * np.arange(n) / n, np.nan)


def burst(
    r: npt.ArrayLike, r_min: float, r_max: float, n_max: int = 5, t_max: float = 20.0, t_min: float = 2.0
) -> Floats:
    """Burst code: a larger value has more spikes at shorter intervals.

    With ``P = (r - r_min) / (r_max - r_min)``: ``ceil(n_max P)`` spikes, the first at 0, at intervals of
    ``ceil(t_max - (t_max - t_min) P)``.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value without a spike.
        r_max: the value with most spikes.
        n_max: largest number of spikes of a burst.
        t_max: the longest interval (ms).
        t_min: the shortest interval, above 0 and at most ``t_max`` (ms).

    Returns:
        Spike times, the shape of ``r`` and an axis of ``n_max`` spikes, NaN after the end of a burst.

    Raises:
        ModelError: a value is not a number or outside of the range, ``r_min`` is not below ``r_max``,
            ``0 < t_min <= t_max`` does not hold, or ``n_max`` is not a whole number.

    Source: Guo, Fouda, Eltawil & Salama, Front. Neurosci. 15 (2021), "Neural coding in spiking neural networks: a
        comparative study".
    """
    most_spikes = argument("n_max", n_max, kind="integer", at_least=1, at_most=1000)
    shortest, longest = argument("t_min", t_min, above=0), argument("t_max", t_max, above=0)
    if shortest > longest:
        raise ModelError(f"t_min is {t_min} and t_max {t_max}, expected t_min <= t_max", path=("t_min",))
    p = share(r, r_min, r_max)[..., None]
    interval = np.ceil(longest - (longest - shortest) * p - _ROUNDING)
    spikes = np.arange(most_spikes)
    return np.where(spikes < np.ceil(most_spikes * p - _ROUNDING), spikes * interval, np.nan)


def check_bounds(r_min: float, r_max: float) -> None:
    """Raise an error if a bound is NaN, or ``r_min`` is not below ``r_max``."""
    argument("r_min", r_min)
    argument("r_max", r_max)
    if not r_min < r_max:
        raise ModelError(f"r_min is {r_min} and r_max {r_max}, expected r_min < r_max", path=("r_max",))


def check_inside(values: Floats, r_min: float, r_max: float) -> None:
    """Raise an error if a value is NaN or outside of the bounds."""
    outside = ~((values >= r_min) & (values <= r_max))
    if outside.any():
        raise ModelError(f"value {values[outside][0]} is outside of [{r_min}, {r_max}]", path=("r",))


def share(r: npt.ArrayLike, r_min: float, r_max: float) -> Floats:
    """Return the positions of values between their bounds: 0 at ``r_min``, 1 at ``r_max``.

    Raises:
        ModelError: ``r_min`` is not below ``r_max``, or a value is NaN or outside of the bounds.
    """
    check_bounds(r_min, r_max)
    values = numbers(r, "r")
    check_inside(values, r_min, r_max)
    return (values - r_min) / (r_max - r_min)


Ints = npt.NDArray[np.int64]


def check_pixels(shape: Sequence[int | str]) -> None:
    """Raise an error if the shape of a population is not a shape of pixels.

    Raises:
        ModelError: the shape is neither (2, rows, columns) nor (rows, columns).
    """
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[0] != 2):
        raise ModelError(f"shape {list(shape)}: expected [2, rows, columns], OFF then ON, or [rows, columns]")


PIXEL_SPIKE = on_numbers(6, 6)
"""Work of `pixel_spikes` per event: a difference, a division and a rounding of ticks, two limits, one spike."""


def pixel_spikes(
    events: Any, shape: Sequence[int], step: float, *, steps: int | None = None, scale: int = 1, start: float = 0.0
) -> tuple[Ints, Ints]:
    """Return the steps and neurons of the spikes of a recording, one for each event, in the order of the events.

    Args:
        events: `neuro.events.Events`, or an object with the attributes `t` (us), `x`, `y` (px) and `p`.
        shape: shape of the population: (2, rows, columns), OFF then ON, or (rows, columns) for both together.
        step: step of the network, ms.
        steps: number of steps; later events are left out. By default no event is left out at the end.
        scale: side of the square of pixels that share a neuron, px.
        start: time from the first event to the first step, ms; earlier events are left out.

    Returns:
        Steps from 0 on, and neurons, both (spikes,).

    Raises:
        ModelError: the shape is not a shape of pixels, an event lies outside, or the step is no whole number of us.
    """
    check_pixels(shape)
    if abs(step * 1000.0 - round(step * 1000.0)) > 1e-6:
        raise ModelError(f"steps of {step:g} ms: expected whole microseconds, the unit of events")
    rows, columns = shape[-2:]
    times_us = events.t - (events.t[0] if len(events.t) else 0) - round(start * 1000.0)
    step_of_event = np.floor_divide(times_us, round(step * 1000.0)).astype(np.int64)
    is_inside = (step_of_event >= 0) if steps is None else (step_of_event >= 0) & (step_of_event < steps)
    x, y = (np.asarray(positions, dtype=np.int64)[is_inside] // scale for positions in (events.x, events.y))
    for k in np.flatnonzero((x >= columns) | (y >= rows))[:1]:
        message = f"an event at x = {x[k] * scale}, y = {y[k] * scale} px"
        raise ModelError(f"{message}: expected within the shape {list(shape)} at scale {scale}")
    neuron = y * columns + x
    if len(shape) == 3:
        neuron = neuron + np.asarray(events.p, dtype=np.int64)[is_inside] * (rows * columns)
    return step_of_event[is_inside], neuron
