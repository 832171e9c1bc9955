"""What writers share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.formats._format import Unsavable


def in_order(parts: Iterator[Events]) -> Iterator[tuple[int, Events]]:
    """The parts of one recording, each with the number of events before it.

    Args:
        parts: of one recording, in order.

    Raises:
        Unsavable: a part has another sensor than the first, or begins before the one before it ends.
    """
    done, last = 0, np.iinfo(np.int64).min
    size = None
    for part in parts:
        size = size or part.sensor_size
        if part.sensor_size != size:
            has, had = (f"{width}x{height}" for width, height in (part.sensor_size, size))
            raise Unsavable(f"its sensor is {has}, expected {had} as in the first part", done)
        if len(part):
            if part.t[0] < last:
                raise Unsavable(f"time runs back from {last} to {part.t[0]} us", done)
            last = int(part.t[-1])
        yield done, part
        done += len(part)


EARLIER = "the filter 'shift: {to_us: 0}' lets it begin at 0 us; what is longer fits in parts of 'neuro events split'"
SMALLER = "the filters 'crop: {x: [0, 128], y: [0, 128]}' and 'downsample: {factor: 2}' make the sensor smaller"


def refuse(
    events: Events, bad: npt.NDArray[np.bool_], done: int, limits: str, outside: npt.NDArray[np.bool_] | None = None
) -> None:
    """Refuse the first event of a part that is bad.

    Args:
        events: the part.
        bad: (n,) which events do not fit.
        done: number of events before the part.
        limits: what was expected.
        outside: (n,) which of them lie at a place for which there is no room; the others do so in time. None: not told.

    Raises:
        Unsavable: there is one.
    """
    if bad.any():
        k = int(bad.argmax())
        hint = "" if outside is None else SMALLER if outside[k] else EARLIER
        raise Unsavable(f"t {events.t[k]}, x {events.x[k]}, y {events.y[k]}; expected {limits}", done + k, hint)
