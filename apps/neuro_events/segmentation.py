"""Where a recording is cut into parts: by the clock, by count, or where the motion is.

| method | a segment ends | thesis |
| --- | --- | --- |
| `time_segments`, `TimeWindows` | after a fixed time | hard segmentation (HES) |
| `count_segments`, `Counts` | after a fixed number of events | hard segmentation (HES) |
| `msd_segments`, `MSD` | when a leaky neuron reaches its threshold | soft segmentation (SES), ReMuS |
| `peak_segments`, `Peaks` | where a leaky neuron's potential peaks | soft segmentation (SES), EDHMAX |

The functions give the bounds of a whole recording: segment i is ``events[bounds[i]:bounds[i + 1]]``. The classes
are the same with a memory: `segmented` cuts a recording with them that comes in parts, and gives the same segments.

Source: thesis sections 3.3 (lines 875-890) and 6.1.1 (lines 2165-2176).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import exp, log
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import LazyModule, Registry, argument
from neuro_events._events import Events
from neuro_events.parts import together

kernels = LazyModule("neuro_events._kernels")

Times = npt.NDArray[np.int64]
NONE = np.zeros(0, np.int64)
"""No cuts."""


class Cutter(Protocol):
    """Says where segments end, while the events come in."""

    def cuts(self, t: Times) -> Times:
        """See the next events.

        Args:
            t: (n,) int64, us, non-decreasing, not before the events seen so far.

        Returns:
            (cuts,) int64, non-decreasing: how many events of the recording, from its very first, lie before the
            end of each segment that is now known to be complete.
        """
        ...

    def end(self) -> Times:
        """The cuts that are known once no more events come; as `cuts`. None where what is not complete is left over."""
        return NONE


def bounds(cutter: Cutter, t: npt.NDArray[Any], rest: bool) -> Times:
    """All bounds of one recording.

    Args:
        cutter: a fresh one.
        t: (n,) times, us.
        rest: whether events after the last complete segment are one more.

    Returns:
        (segments + 1,) int64, from 0.

    Raises:
        ModelError: `t` is not (n,) whole numbers in order.
    """
    times = _checked(t)
    found = np.concatenate([np.zeros(1, np.int64), cutter.cuts(times), cutter.end()])
    return np.append(found, times.size) if rest and found[-1] < times.size else found


def segmented(parts: Events | Iterable[Events], cutter: Cutter, *, rest: bool = False) -> Iterator[Events]:
    """Cut a recording that comes in parts; only the segment that is under way is held.

    Args:
        parts: one recording, whole or in parts as `neuro.events.stream` gives them.
        cutter: a fresh `TimeWindows`, `Counts`, `MSD` or `Peaks`.
        rest: whether events after the last complete segment are one more.

    Yields:
        the segments, the same for any cutting into parts.
    """
    held: list[Events] = []
    begin = 0
    for part in [parts] if isinstance(parts, Events) else parts:
        held.append(part)
        cuts = cutter.cuts(part.t)
        if cuts.size:
            whole = together(held)
            yield from _between(whole, begin, cuts)
            held, begin = [whole[int(cuts[-1]) - begin :]], int(cuts[-1])
    if not held:
        return
    whole, cuts = together(held), cutter.end()
    yield from _between(whole, begin, cuts)
    left = whole[int(cuts[-1]) - begin :] if cuts.size else whole
    if rest and len(left):
        yield left


def _between(whole: Events, begin: int, cuts: Times) -> Iterator[Events]:
    first = 0
    for cut in cuts.tolist():
        yield whole[first : cut - begin]
        first = cut - begin


def _checked(t: npt.NDArray[Any]) -> Times:
    given = np.asarray(t)
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise ModelError(f"t is {given.dtype} of shape {given.shape}, expected whole numbers (n,) of us")
    times = np.ascontiguousarray(given, np.int64)
    back = times[1:] < times[:-1]
    if back.any():
        k = int(back.argmax()) + 1
        raise ModelError(f"event {k}: time runs back from {times[k - 1]} to {times[k]} us")
    return times


MOST = 10**8
"""More windows at once than this are a mistake in the unit or in a time: their bounds alone would take 1 GB."""


class TimeWindows(Cutter):
    """Segments of equal length, each with its first us and without its last; one without events is empty.

    A window is complete when an event at or after its end is seen.

    Args:
        window_us: length, us.
        start_us: where the first begins, us; None: at the first event.

    Raises:
        ModelError: the length is not a whole number of at least 1, or the start not a whole number.
    """

    def __init__(self, window_us: int, start_us: int | None = None) -> None:
        self._window: int = argument("window_us", window_us, kind="microseconds", at_least=1)
        self._begin = argument("start_us", start_us, kind="microseconds", optional=True)
        self._seen = 0

    def cuts(self, t: Times) -> Times:
        """The ends of windows; see `Cutter`.

        Raises:
            ModelError: an event lies before the first window, or there are more than 10^8 windows.
        """
        if not t.size:
            return NONE
        begin = int(t[0]) if self._begin is None else self._begin
        if t[0] < begin:
            raise ModelError(
                f"event {self._seen} is at {t[0]} us, before start_us = {begin}",
                hint="leave earlier events out with events.between(start_us, stop_us)",
            )
        n = (int(t[-1]) - begin) // self._window
        if n > MOST:
            raise ModelError(
                f"window_us is {self._window}: {n} windows from {begin} to {t[-1]} us, expected at most {MOST}",
                hint="is the window in us, and are the times those of one recording?",
            )
        found = self._seen + np.searchsorted(t, begin + self._window * np.arange(1, n + 1)).astype(np.int64)
        self._begin = begin + n * self._window
        self._seen += t.size
        return found


class Counts(Cutter):
    """Segments of equally many events.

    The thesis' remark holds: this is a leaky neuron without leak.

    Args:
        count: events of a segment.

    Raises:
        ModelError: the count is not a whole number of at least 1.
    """

    def __init__(self, count: int) -> None:
        self._count = int(argument("count", count, whole=True, at_least=1))
        self._seen = 0

    def cuts(self, t: Times) -> Times:
        """The ends of segments; see `Cutter`."""
        first = (self._seen // self._count + 1) * self._count
        self._seen += t.size
        return np.arange(first, self._seen + 1, self._count, dtype=np.int64)


def time_segments(
    t: npt.NDArray[np.integer], window_us: int, *, start_us: int | None = None, rest: bool = False
) -> Times:
    """Cut by the clock.

    Args:
        t: (n,) times, us, non-decreasing.
        window_us: length of a segment, us.
        start_us: where the first begins, us, not after the first event; None: at the first event.
        rest: whether the last window counts although no event ends it.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``, with times from
        ``start + i * window_us`` to before ``start + (i + 1) * window_us``.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """
    return bounds(TimeWindows(window_us, start_us), t, rest)


def count_segments(t: npt.NDArray[np.integer], count: int, *, rest: bool = False) -> Times:
    """Cut after every so many events.

    Args:
        t: (n,) times, us, non-decreasing.
        count: events of a segment.
        rest: whether a last segment may have fewer.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """
    return bounds(Counts(count), t, rest)


class MSD(Cutter):
    """A motion symbol detector: a leaky integrate-and-fire neuron that all events reach.

    It adds 1 at every event and decays exponentially in between. When it reaches the threshold, the events since
    the last segment are one segment and the neuron begins at 0.

    Args:
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.

    Raises:
        ModelError: `tau` or `threshold` is not positive.
    """

    def __init__(self, tau: float = 0.02, threshold: float = 150.0) -> None:
        self._tau_us = 1e6 * argument("tau", tau, unit="s", above=0, infinite=True)
        self._threshold = argument("threshold", threshold, unit="events", above=0, infinite=True)
        self._v, self._last, self._seen = 0.0, 0, 0

    def cuts(self, t: Times) -> Times:
        """The ends of segments; see `Cutter`."""
        if not self._seen and t.size:
            self._last = int(t[0])
        found = np.empty(t.size, np.int64)
        n, self._v, self._last = kernels.msd(t, self._tau_us, self._threshold, self._v, self._last, found)
        self._seen += t.size
        return found[:n] + (self._seen - t.size)


def msd_segments(
    t: npt.NDArray[np.integer], *, tau: float = 0.02, threshold: float = 150.0, rest: bool = False
) -> Times:
    """Segment events with a motion symbol detector.

    A leaky integrate-and-fire neuron adds 1 at every event and decays in between. When it reaches
    the threshold, the events since the last segment are one segment and the neuron begins at 0.

    Args:
        t: (n,) times, us, non-decreasing.
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.
        rest: whether events after the last complete segment are one more.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``. Without `rest`, events after the last
        complete segment belong to none.

    Raises:
        ModelError: `tau` or `threshold` is not positive, or `t` is not in order.

    Source: thesis section 6.2.1, lines 2321-2334, with tau in s (table 3 prints ms; figure 43 has 0.02);
        Zhao et al., IEEE TNNLS 26:1963, 2015.
    """
    return bounds(MSD(tau, threshold), t, rest)


class Peaks(Cutter):
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
        self._search = argument("search_us", search_us, unit="us", above=0, infinite=True)
        self._tau = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._rise = self._tau / 4 if rise_us is None else float(rise_us)
        if not 0 <= self._rise < self._tau:
            raise ModelError(f"rise_us is {self._rise:g} us, expected 0 to below tau_us = {self._tau:g}")
        self._threshold = argument("threshold", threshold, at_least=0, infinite=True)
        self._v0 = 1 / _peak(self._tau, self._rise)
        self._seen = 0
        self._last = 0
        self._state = np.zeros(2)  # slow and fast part of the potential
        self._candidate = np.array([-1, 0], np.int64)  # its number and time
        self._recent = (np.zeros(0, np.int64), np.zeros(0))  # times and potentials that may still be the highest

    def cuts(self, t: Times) -> Times:
        """The ends of segments, each after its peak; see `Cutter`."""
        if not t.size:
            return NONE
        last = self._last if self._seen else int(t[0])
        held = self._recent[0].size
        queue_t = np.concatenate([self._recent[0], np.empty(t.size, np.int64)])
        queue_v = np.concatenate([self._recent[1], np.empty(t.size)])
        found = np.empty(t.size + 1, np.int64)
        constants = (self._tau, self._rise, self._v0, self._search, self._threshold)
        n, head, tail = kernels.peaks(
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


SEGMENTERS: Registry[Callable[..., Times]] = Registry(
    "segmenter",
    (time_segments, count_segments, msd_segments, peak_segments),
    group="neuro.segmenters",
)
"""All segmenters by name: functions of times, us, and named parameters that give the bounds of segments."""

__all__ = [
    "MSD",
    "SEGMENTERS",
    "Counts",
    "Cutter",
    "Peaks",
    "TimeWindows",
    "count_segments",
    "msd_segments",
    "peak_segments",
    "segmented",
    "time_segments",
]
