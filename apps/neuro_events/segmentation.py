"""Segmentation of a recording: by time, by number of events, or by the motion in the recording.

| method | a segment ends | thesis |
| --- | --- | --- |
| `time_segments`, `TimeWindows` | after a fixed time | hard segmentation (HES) |
| `count_segments`, `Counts` | after a fixed number of events | hard segmentation (HES) |
| `msd_segments`, `MSD` | when a leaky neuron reaches its threshold | soft segmentation (SES), ReMuS |
| `peak_segments`, `Peaks` | where a leaky neuron's potential peaks | soft segmentation (SES), EDHMAX |

The functions return the bounds of a complete recording: segment i is ``events[bounds[i]:bounds[i + 1]]``. The classes
implement the same methods with state, so that `segmented` can cut a recording that comes in parts. The function and the
class of a method yield the same segments.

Source: thesis sections 3.3 (lines 870-880) and 6.1.1 (lines 2165-2176).
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
from neuro_events.parts import joined_parts

kernels = LazyModule("neuro_events._kernels")

Times = npt.NDArray[np.int64]
NONE = np.zeros(0, np.int64)
"""No cuts."""


class Cutter(Protocol):
    """A segmentation method that finds the ends of segments while events arrive."""

    def cuts(self, t: Times) -> Times:
        """Process the next events and return the ends of the segments that these events complete.

        Example: a cutter that needs two events per segment returns [2] for the first three events, and [4] for the
        fourth.

        Args:
            t: (n,) int64, us, non-decreasing, not before the events so far.

        Returns:
            (cuts,) int64, non-decreasing: for each newly completed segment, the number of events of the recording up to
            its end, counted from the first event of the recording.
        """
        ...

    def end(self) -> Times:
        """Return the cuts that become known at the end of the recording, as `cuts` does. Default: no cuts."""
        return NONE


def bounds(cutter: Cutter, t: npt.NDArray[Any], rest: bool) -> Times:
    """Return all bounds of one recording.

    Args:
        cutter: a new cutter.
        t: (n,) times, us.
        rest: count the events after the last complete segment as one more segment.

    Returns:
        (segments + 1,) int64, from 0.

    Raises:
        ModelError: `t` is not (n,) whole numbers in order.
    """
    times = _checked(t)
    edges = np.concatenate([np.zeros(1, np.int64), cutter.cuts(times), cutter.end()])
    return np.append(edges, times.size) if rest and edges[-1] < times.size else edges


def segmented(parts: Events | Iterable[Events], cutter: Cutter, *, rest: bool = False) -> Iterator[Events]:
    """Cut a recording that comes in parts. Only the events of the current segment are held in memory.

    Args:
        parts: one recording, or its parts in order, as from `neuro.events.stream`.
        cutter: a new `TimeWindows`, `Counts`, `MSD` or `Peaks`.
        rest: yield the events after the last complete segment as one more segment.

    Yields:
        The segments. They do not depend on how the recording is divided into parts.
    """
    pending: list[Events] = []
    begin = 0
    for part in [parts] if isinstance(parts, Events) else parts:
        pending.append(part)
        cuts = cutter.cuts(part.t)
        if cuts.size:
            events = joined_parts(pending)
            yield from _between(events, begin, cuts)
            pending, begin = [events[int(cuts[-1]) - begin :]], int(cuts[-1])
    if not pending:
        return
    events, cuts = joined_parts(pending), cutter.end()
    yield from _between(events, begin, cuts)
    remainder = events[int(cuts[-1]) - begin :] if cuts.size else events
    if rest and len(remainder):
        yield remainder


def _between(events: Events, n_before: int, cuts: Times) -> Iterator[Events]:
    """Yield the segments up to the cuts. `events` starts `n_before` events after the start of the recording."""
    first = 0
    for cut in cuts.tolist():
        yield events[first : cut - n_before]
        first = cut - n_before


def _checked(t: npt.NDArray[Any]) -> Times:
    array = np.asarray(t)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ModelError(f"t is {array.dtype} of shape {array.shape}, expected whole numbers (n,) of us")
    times = np.ascontiguousarray(array, np.int64)
    runs_back = times[1:] < times[:-1]
    if runs_back.any():
        k = int(runs_back.argmax()) + 1
        raise ModelError(f"event {k}: time runs back from {times[k - 1]} to {times[k]} us")
    return times


MOST = 10**8
"""Largest number of windows at a time. A larger number suggests a wrong unit or time, and needs 1 GB for the bounds."""


class TimeWindows(Cutter):
    """Segments of equal duration. A window includes the time of its start and excludes its end. Windows can be empty.

    A window is complete at the first event at or after its end.

    Args:
        window_us: length of a window, us.
        start_us: start of the first window, us. None: at the first event.

    Raises:
        ModelError: the length is not a whole number of at least 1, or the start is not a whole number.
    """

    def __init__(self, window_us: int, start_us: int | None = None) -> None:
        self._window: int = argument("window_us", window_us, kind="microseconds", at_least=1)
        self._begin = argument("start_us", start_us, kind="microseconds", optional=True)
        self._n_events = 0

    def cuts(self, t: Times) -> Times:
        """Return the ends of completed windows; see `Cutter`.

        Raises:
            ModelError: an event lies before the first window, or there are more than 10^8 windows.
        """
        if not t.size:
            return NONE
        begin = int(t[0]) if self._begin is None else self._begin
        if t[0] < begin:
            raise ModelError(
                f"event {self._n_events} is at {t[0]} us, before start_us = {begin}",
                hint="drop earlier events with events.between(start_us, stop_us)",
            )
        n = (int(t[-1]) - begin) // self._window
        if n > MOST:
            raise ModelError(
                f"window_us is {self._window}: {n} windows from {begin} to {t[-1]} us, expected at most {MOST}",
                hint="check that the window is in us, and that all times are from one recording",
            )
        ends = self._n_events + np.searchsorted(t, begin + self._window * np.arange(1, n + 1)).astype(np.int64)
        self._begin = begin + n * self._window
        self._n_events += t.size
        return ends


class Counts(Cutter):
    """Segments with equal numbers of events.

    As the thesis remarks, the method equals a leaky integrate-and-fire neuron without leak.

    Args:
        count: events per segment.

    Raises:
        ModelError: the count is not a whole number of at least 1.
    """

    def __init__(self, count: int) -> None:
        self._count = int(argument("count", count, whole=True, at_least=1))
        self._n_events = 0

    def cuts(self, t: Times) -> Times:
        """Return the ends of completed segments; see `Cutter`."""
        first = (self._n_events // self._count + 1) * self._count
        self._n_events += t.size
        return np.arange(first, self._n_events + 1, self._count, dtype=np.int64)


def time_segments(
    t: npt.NDArray[np.integer], window_us: int, *, start_us: int | None = None, rest: bool = False
) -> Times:
    """Cut a recording into windows of equal duration.

    Args:
        t: (n,) times, us, non-decreasing.
        window_us: length of a segment, us.
        start_us: start of the first segment, us, not after the first event. None: at the first event.
        rest: include the last window, which no later event completes.

    Returns:
        (segments + 1,) int64: segment i has the events ``[out[i], out[i + 1])``, with times from
        ``start + i * window_us`` to before ``start + (i + 1) * window_us``.

    Raises:
        ModelError: an argument is invalid; the message names it.
    """
    return bounds(TimeWindows(window_us, start_us), t, rest)


def count_segments(t: npt.NDArray[np.integer], count: int, *, rest: bool = False) -> Times:
    """Cut a recording into segments with equal numbers of events.

    Args:
        t: (n,) times, us, non-decreasing.
        count: events per segment.
        rest: include a shorter last segment.

    Returns:
        (segments + 1,) int64: segment i has the events ``[out[i], out[i + 1])``.

    Raises:
        ModelError: an argument is invalid; the message names it.
    """
    return bounds(Counts(count), t, rest)


class MSD(Cutter):
    """Motion symbol detector: a leaky integrate-and-fire neuron that receives all events.

    The potential increases by 1 at every event and decays exponentially in between. When the potential reaches the
    threshold, the events since the last segment form a segment, and the potential is reset to 0.

    Args:
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.

    Raises:
        ModelError: `tau` or `threshold` is not positive.
    """

    def __init__(self, tau: float = 0.02, threshold: float = 150.0) -> None:
        self._tau_us = 1e6 * argument("tau", tau, unit="s", above=0, infinite=True)
        self._threshold = argument("threshold", threshold, unit="events", above=0, infinite=True)
        self._v, self._last, self._n_events = 0.0, 0, 0

    def cuts(self, t: Times) -> Times:
        """Return the ends of completed segments; see `Cutter`."""
        if not self._n_events and t.size:
            self._last = int(t[0])
        ends = np.empty(t.size, np.int64)
        n, self._v, self._last = kernels.msd(t, self._tau_us, self._threshold, self._v, self._last, ends)
        self._n_events += t.size
        return ends[:n] + (self._n_events - t.size)


def msd_segments(
    t: npt.NDArray[np.integer], *, tau: float = 0.02, threshold: float = 150.0, rest: bool = False
) -> Times:
    """Segment events with a motion symbol detector.

    The potential of a leaky integrate-and-fire neuron increases by 1 at every event and decays in between. When the
    potential reaches the threshold, the events since the last segment form a segment, and the potential is reset to 0.

    Args:
        t: (n,) times, us, non-decreasing.
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.
        rest: count the events after the last complete segment as one more segment.

    Returns:
        (segments + 1,) int64: segment i has the events ``[out[i], out[i + 1])``. Without `rest`, events after the last
        complete segment belong to no segment.

    Raises:
        ModelError: `tau` or `threshold` is not positive, or `t` is not in order.

    Source: thesis section 6.2.1, lines 2321-2334, with tau in s (table 3 prints ms; figure 43 has 0.02);
        Zhao et al., IEEE TNNLS 26:1963, 2015.
    """
    return bounds(MSD(tau, threshold), t, rest)


class Peaks(Cutter):
    """Segments that end at the peaks of a leaky integration neuron, which is never reset.

    Every event adds a postsynaptic potential K(s) = v0 (exp(-s / tau) - exp(-s / rise)), whose maximum is 1; with
    ``rise_us=0``, K(s) = exp(-s / tau). The sum V is evaluated at the events only. Event i is a peak if V_i exceeds the
    threshold, exceeds V of all events in the `search_us` before, and is not below V of all events in the `search_us`
    after. A peak is therefore known at the first event more than `search_us` later, or at the end of the recording.

    Args:
        search_us: time before and after a peak in which no potential is higher, us.
        tau_us: decay time constant, us.
        rise_us: rise time constant, us, below `tau_us`. None: a quarter of `tau_us`.
        threshold: potential that a peak must exceed, in units of K's maximum. It prevents peaks caused by noise.

    Raises:
        ModelError: a time constant or `search_us` is not positive, `rise_us` is not from 0 to below `tau_us`,
            or the threshold is negative.

    Source: Zhao et al., IEEE TNNLS 26:1963, 2015, section III-B. The authors' programs have tau = 20 ms and
        rise = tau / 4. The programs search over a number of events, which is the search time divided by the mean
        interval between events.
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
        self._n_events = 0
        self._last = 0
        self._state = np.zeros(2)  # slow and fast part of the potential
        self._candidate = np.array([-1, 0], np.int64)  # number and time of an event that may be a peak, -1: none
        self._recent = (np.zeros(0, np.int64), np.zeros(0))  # times and potentials that may still be the highest

    def cuts(self, t: Times) -> Times:
        """Return the ends of completed segments, each after its peak; see `Cutter`."""
        if not t.size:
            return NONE
        last = self._last if self._n_events else int(t[0])
        n_recent = self._recent[0].size
        queue_t = np.concatenate([self._recent[0], np.empty(t.size, np.int64)])
        queue_v = np.concatenate([self._recent[1], np.empty(t.size)])
        ends = np.empty(t.size + 1, np.int64)
        constants = (self._tau, self._rise, self._v0, self._search, self._threshold)
        n, head, tail = kernels.peaks(
            t, last, self._n_events, constants, self._state, self._candidate, queue_t, queue_v, n_recent, ends
        )
        self._recent = (queue_t[head:tail].copy(), queue_v[head:tail].copy())
        self._last, self._n_events = int(t[-1]), self._n_events + t.size
        return ends[:n]

    def end(self) -> Times:
        """Return the last peak, if no event was late enough to confirm it."""
        number = int(self._candidate[0])
        self._candidate[0] = -1
        return np.array([number + 1] if number >= 0 else [], np.int64)


def _peak(tau: float, rise: float) -> float:
    """Return the maximum of exp(-s / tau) - exp(-s / rise) over s >= 0."""
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
    """Segment events at the peaks of a leaky integration neuron's potential, as defined at `Peaks`.

    Args:
        t: (n,) times, us, non-decreasing.
        search_us: time before and after a peak in which no potential is higher, us.
        tau_us: decay time constant, us.
        rise_us: rise time constant, us. None: a quarter of `tau_us`. 0: potentials jump.
        threshold: potential that a peak must exceed, in units of the maximum that one event adds.
        rest: count the events after the last peak as one more segment.

    Returns:
        (segments + 1,) int64: segment i has the events ``[out[i], out[i + 1])``. Its last event is the peak.

    Raises:
        ModelError: an argument is invalid; the message names it.
    """
    return bounds(Peaks(search_us, tau_us=tau_us, rise_us=rise_us, threshold=threshold), t, rest)


SEGMENTERS: Registry[Callable[..., Times]] = Registry(
    "segmenter",
    (time_segments, count_segments, msd_segments, peak_segments),
    group="neuro.segmenters",
)
"""Segmenters by name: functions from times (us) and keyword parameters to the bounds of segments."""

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
