"""Codes of several spikes a value. Times have one more axis than the values; a row ends in, or skips, NaN."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from neuro.coding.arguments import Floats, finite, positive, share, whole
from neuro.core.errors import ModelError
from neuro.core.keyed_random import generator

MOST_SPIKES = 2**28
"""Numbers that a table of spike times may have."""
_ROUNDING = 1e-9  # a product that is a whole number but for rounding is that number


def poisson(r: npt.ArrayLike, window: float, seed: int = 0) -> Floats:
    """Poisson trains: the number of spikes has the law ``(lambda T)^k exp(-lambda T) / k!``, their times are uniform.

    Mean and variance of the number are lambda T. One spike at most in a step h would not keep both: with the
    probability lambda h the variance is (1 - lambda h) times the mean, with 1 - exp(-lambda h) the rate is too small.

    Args:
        r: rates, Hz, at least 0, any shape.
        window: length of the trains, ms.
        seed: of the draws.

    Returns:
        Spike times in ms in [0, window), the shape of ``r`` and one more axis, each row in ascending order.

    Raises:
        ModelError: what is no finite number, a rate below 0, ``window`` not positive, or too many spikes.

    Source: thesis eq. 13, line 676, which lacks the T of its own words.
    """
    length = positive(window, "window")
    rates = finite(r, "r")
    if (rates < 0).any():
        raise ModelError(f"r has the value {rates[rates < 0][0]}, expected rates >= 0 Hz", path=("r",))
    mean = rates * (length / 1000.0)
    if mean.size and mean.max() * mean.size > MOST_SPIKES:
        told = f"up to {mean.max():g} spikes of each of {mean.size} trains"
        raise ModelError(f"{told}, expected a table of at most {MOST_SPIKES} times", path=("window",))
    rng = generator(whole(seed, "seed", 0, 2**64 - 1), "code", "poisson")
    counts = np.asarray(rng.poisson(mean))
    most = int(counts.max(initial=0))
    times = rng.random((*mean.shape, most)) * length
    times[np.arange(most) >= counts[..., None]] = np.nan
    times.sort(axis=-1)
    return times


def phase(r: npt.ArrayLike, r_min: float, r_max: float, window: float, bits: int = 8) -> Floats:
    """Phase code: the k-th phase of a window has a spike where the k-th binary digit is 1, and weighs 2^-(k+1).

    The share ``P = (r - r_min) / (r_max - r_min)`` is rounded to the nearest multiple of 2^-bits, so that the spikes'
    weights sum to P within 2^-(bits+1); above the largest sum, 1 - 2^-bits, all phases spike.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value without a spike.
        r_max: the value whose phases all spike.
        window: length of all phases together (ms).
        bits: how many phases there are, 1 to 52.

    Returns:
        Spike times, the shape of ``r`` and an axis of phases, most significant first: ``window k / bits`` or NaN.

    Raises:
        ModelError: what is no number, not ``r_min < r_max``, ``window`` not positive, ``bits`` out of bounds, or a
            value outside of the range.

    Source: Kim, Kim, Huh, Lee & Choi, Neurocomputing 311 (2018), "Deep neural networks with weighted spikes".
    """
    n = whole(bits, "bits", 1, 52)
    length = positive(window, "window")
    levels = np.minimum(np.rint(share(r, r_min, r_max) * 2.0**n), 2.0**n - 1).astype(np.int64)
    ones = levels[..., None] >> np.arange(n - 1, -1, -1) & 1
    return np.where(ones == 1, length * np.arange(n) / n, np.nan)


def burst(
    r: npt.ArrayLike, r_min: float, r_max: float, n_max: int = 5, t_max: float = 20.0, t_min: float = 2.0
) -> Floats:
    """Burst code: a larger value has more spikes, nearer to each other.

    With ``P = (r - r_min) / (r_max - r_min)``: ``ceil(n_max P)`` spikes, the first at 0, at intervals of
    ``ceil(t_max - (t_max - t_min) P)``.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value without a spike.
        r_max: the value with most spikes.
        n_max: the most spikes of a burst.
        t_max: the longest interval (ms).
        t_min: the shortest interval, above 0 and at most ``t_max`` (ms).

    Returns:
        Spike times, the shape of ``r`` and an axis of ``n_max`` spikes, NaN where a burst has ended.

    Raises:
        ModelError: what is no number, not ``r_min < r_max``, not ``0 < t_min <= t_max``, ``n_max`` no whole number,
            or a value outside of the range.

    Source: Guo, Fouda, Eltawil & Salama, Front. Neurosci. 15 (2021), "Neural coding in spiking neural networks: a
        comparative study".
    """
    most = whole(n_max, "n_max", 1, 1000)
    shortest, longest = positive(t_min, "t_min"), positive(t_max, "t_max")
    if shortest > longest:
        raise ModelError(f"t_min is {t_min} and t_max {t_max}, expected t_min <= t_max", path=("t_min",))
    p = share(r, r_min, r_max)[..., None]
    interval = np.ceil(longest - (longest - shortest) * p - _ROUNDING)
    spikes = np.arange(most)
    return np.where(spikes < np.ceil(most * p - _ROUNDING), spikes * interval, np.nan)
