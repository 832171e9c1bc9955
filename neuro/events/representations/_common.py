"""What the representations share: choices, times, and torch."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.core.extras import needed
from neuro.events._events import Events

Polarity = Literal["separate", "signed", "ignored"]
Representation = npt.NDArray[Any] | Any
"""An array, or a torch tensor where it was asked for."""


def given(array: npt.NDArray[Any], as_torch: bool) -> Representation:
    """The array, or a tensor that shares its memory.

    Raises:
        ModelError: torch is asked for and missing.
    """
    if not as_torch:
        return array
    return needed("torch", "torch", "as_torch=True: torch is not installed").from_numpy(array)


def real(dtype: npt.DTypeLike) -> np.dtype[Any]:
    """float32 or float64.

    Raises:
        ModelError: it is another type.
    """
    kind = np.dtype(dtype)
    if kind not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise ModelError(f"dtype is {kind}, expected float32 or float64")
    return kind


def span(events: Events, start_us: int | None, stop_us: int | None) -> tuple[int, int]:
    """The first and last time that are looked at: those given, else of the first and last event.

    Raises:
        ModelError: the last is before the first.
    """
    first, last = (int(events.t[0]), int(events.t[-1])) if len(events) else (0, 0)
    start = first if start_us is None else argument("start_us", start_us, kind="microseconds")
    stop = max(start, last) if stop_us is None else argument("stop_us", stop_us, kind="microseconds")
    if stop < start:
        raise ModelError(f"stop_us is {stop} us, expected at least {start}, the start")
    return start, stop


def moments(at_us: int | npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Times at which a surface is read.

    Raises:
        ModelError: they are not whole, or run back.
    """
    at = np.atleast_1d(np.asarray(at_us))
    if at.ndim != 1 or (at.size and at.dtype.kind not in "iu"):
        raise ModelError(f"at_us is {at.dtype} of shape {at.shape}, expected a whole number of us, or (n,) of them")
    if np.any(at[1:] < at[:-1]):
        k = int((at[1:] < at[:-1]).argmax()) + 1
        raise ModelError(f"at_us runs back from {at[k - 1]} to {at[k]} us, expected an order of time")
    return at.astype(np.int64)


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
