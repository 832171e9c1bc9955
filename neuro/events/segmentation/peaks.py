"""Cut where a neuron that all events reach is most excited: the motion symbol detector of EDHMAX."""

from __future__ import annotations

from math import exp, log

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events._arguments import positive
from neuro.events.segmentation._cutter import Times, bounds


class Peaks:
    """Segments that end at the peaks of a leaky integration neuron, which is never reset.

    Every event adds a postsynaptic potential K(s) = v0 (exp(-s / tau) - exp(-s / rise)), whose maximum is 1; with
    ``rise_us=0``, K(s) = exp(-s / tau). The sum V is looked at when events arrive. Event i is a peak if V_i is above
    the threshold, above V of all events in the `search_us` before it, and not below V of all events in the
    `search_us` after it. So a peak is known when an event later than that arrives, or the recording ends.

    Args:
        search_us: how far a peak is the highest on both sides, us.
        tau_us: decay time constant, us.
        rise_us: rise time constant, us, below `tau_us`; None: a quarter of it.
        threshold: a peak is above it, so that noise makes none; in single events' potentials.

    Raises:
        ModelError: a time constant or `search_us` is not positive, `rise_us` is not from 0 to below `tau_us`,
            or the threshold is negative.

    Source: Zhao et al., IEEE TNNLS 26:1963, 2015, section III-B; tau of 20 ms and rise of tau / 4 are those of the
        authors' programs, where the search is made over a number of events (its time divided by the mean interval).
    """

    def __init__(
        self, search_us: float, *, tau_us: float = 20_000.0, rise_us: float | None = None, threshold: float = 0.0
    ) -> None:
        self._search = positive("search_us", search_us, "us")
        self._tau = positive("tau_us", tau_us, "us")
        self._rise = self._tau / 4 if rise_us is None else float(rise_us)
        if not 0 <= self._rise < self._tau:
            raise ModelError(f"rise_us is {self._rise:g} us, expected 0 to below tau_us = {self._tau:g}")
        if not threshold >= 0:
            raise ModelError(f"threshold is {threshold}, expected 0 or more")
        self._threshold = float(threshold)
        self._v0 = 1 / _peak(self._tau, self._rise)
        self._seen = 0
        self._last = 0
        self._state = np.zeros(2)  # slow and fast part of the potential
        self._candidate = np.array([-1, 0], np.int64)  # its number and time
        self._recent = (np.zeros(0, np.int64), np.zeros(0))  # times and potentials that may still be the highest

    def cuts(self, t: Times) -> Times:
        """The ends of segments, each after its peak; see `Cutter`."""
        from neuro.events.segmentation._kernel import peaks

        if not t.size:
            return np.zeros(0, np.int64)
        last = self._last if self._seen else int(t[0])
        held = self._recent[0].size
        queue_t = np.concatenate([self._recent[0], np.empty(t.size, np.int64)])
        queue_v = np.concatenate([self._recent[1], np.empty(t.size)])
        found = np.empty(t.size + 1, np.int64)
        constants = (self._tau, self._rise, self._v0, self._search, self._threshold)
        n, head, tail = peaks(
            t, last, self._seen, constants, self._state, self._candidate, queue_t, queue_v, held, found
        )
        self._recent = (queue_t[head:tail].copy(), queue_v[head:tail].copy())
        self._last, self._seen = int(t[-1]), self._seen + t.size
        return found[:n]

    def end(self) -> Times:
        """The last peak, if no event was late enough to confirm it."""
        number = int(self._candidate[0])
        self._candidate[0] = -1
        return np.array([number + 1] if number >= 0 else [], np.int64)


def _peak(tau: float, rise: float) -> float:
    """The maximum of exp(-s / tau) - exp(-s / rise) over s >= 0."""
    if not rise:
        return 1.0
    s = tau * rise / (tau - rise) * log(tau / rise)
    return exp(-s / tau) - exp(-s / rise)


def peak_segments(
    t: npt.NDArray[np.integer],
    search_us: float,
    *,
    tau_us: float = 20_000.0,
    rise_us: float | None = None,
    threshold: float = 0.0,
    rest: bool = False,
) -> Times:
    """Segment events at the peaks of a leaky integration neuron's potential; `Peaks` says which these are.

    Args:
        t: (n,) times, us, non-decreasing.
        search_us: how far a peak is the highest on both sides, us.
        tau_us: decay time constant, us.
        rise_us: rise time constant, us; None: a quarter of `tau_us`; 0: potentials jump.
        threshold: a peak is above it; in single events' potentials.
        rest: whether events after the last peak are one more segment.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``, the last of which is the peak.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """
    return bounds(Peaks(search_us, tau_us=tau_us, rise_us=rise_us, threshold=threshold), t, rest)
