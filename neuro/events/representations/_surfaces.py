"""Reading a surface at given times while events go in."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.representations._common import moments, real


class Surface(Protocol):
    """What takes events in and can be read at a time."""

    def add(self, events: Events) -> None:
        """Take in the next events."""
        ...

    def at(self, t_us: int, dtype: npt.DTypeLike = ...) -> npt.NDArray[np.floating]:
        """The surface at a time."""
        ...


def read(
    surface: Surface, events: Events, at_us: int | npt.ArrayLike | None, inclusive: bool, dtype: npt.DTypeLike
) -> npt.NDArray[np.floating]:
    """The surface at each time, in one pass over the events.

    Args:
        surface: a fresh one.
        events: the recording.
        at_us: one time, (n,) times, or None for the last event's.
        inclusive: whether events at the very time count.
        dtype: float32 or float64.

    Returns:
        one surface, or (n, ...) of them.

    Raises:
        ModelError: times or type are wrong.
    """
    if at_us is None:
        at_us = int(events.t[-1]) if len(events) else 0
    times = moments(at_us)
    stops = np.searchsorted(events.t, times, side="right" if inclusive else "left")
    found, begin = [], 0
    for when, stop in zip(times.tolist(), stops.tolist(), strict=True):
        surface.add(events[begin:stop])
        found.append(surface.at(when, dtype))
        begin = stop
    if np.ndim(at_us) == 0:
        return found[0]
    return np.stack(found) if found else np.zeros((0, *surface.at(0).shape), real(dtype))
