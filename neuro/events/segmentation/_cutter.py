"""What all methods share: a cutter sees the times of events and says where segments end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events._events import Events
from neuro.events.parts import together

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
        """The cuts that are known once no more events come; as `cuts`."""
        ...


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
