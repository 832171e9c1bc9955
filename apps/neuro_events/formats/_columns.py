"""Columns of events in tables of any kind: identification by name or content, and conversion to events.

Names are compared without case, punctuation and the word "event": ``t``, ``ts``, ``timeStamp``, ``ev_x``, ``pol`` and
more. A name may state the unit of time: ``t_ns``, ``timestamp [us]``, ``t (s)``. Otherwise whole times are us, and
times with a fraction are seconds. Times finer than 1 us are rounded to the nearest us. Polarity 1 is ON, 0 and -1 are
OFF. Columns and unit are determined once, at the beginning of a file, so that all parts are decoded in the same way.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_events._events import EVENT
from neuro_events.formats._format import Piece

Array = npt.NDArray[Any]

NAMES = {
    "t": ("t", "ts", "time", "times", "timestamp", "timestamps", "timestep"),
    "x": ("x", "xs", "col", "column"),
    "y": ("y", "ys", "row"),
    "p": ("p", "ps", "pol", "pols", "polarity", "polarities", "on"),
}
UNITS = {"s": 6, "sec": 6, "seconds": 6, "ms": 3, "us": 0, "usec": 0, "microseconds": 0, "ns": -3, "nsec": -3}
"""Exponents e of the units: a time times 10^e is in us."""

US, SECONDS = 0, 6
ORDERS = ("txyp", "xypt", "xytp", "xtyp", "ptxy", "pxyt", "tpxy", "txpy", "xtpy", "xpty", "xpyt", "pxty")
"""Orders of columns without names, the most likely first. x always precedes y."""

MANY = 16
"""Number of rises that identify a time: 17 distinct coordinates in random order all rise in 1 of 10^14 cases."""

_LIMIT = 2.0**63


class Ambiguous(ValueError):
    """Raised if columns without names may have several orders.

    Attributes:
        orders: the possible orders, the most likely first.
        why: reason against the most likely order.
    """

    def __init__(self, first: str, others: Sequence[str], why: str) -> None:
        super().__init__(first, others, why)
        self.orders = [" ".join(order) for order in (first, *others)]
        self.why = why


@dataclass(frozen=True, slots=True)
class Names:
    """Names of the columns in a table.

    Attributes:
        t, x, y, p: the names in the table.
        unit: exponent of the unit of time (see `UNITS`), None if the name states none.
    """

    t: str
    x: str
    y: str
    p: str
    unit: int | None


def find_names(names: Iterable[str]) -> Names | None:
    """Return the first columns of t, x, y and p among a table's names, or None if a column is missing."""
    matches: dict[str, str] = {}
    unit = None
    for name in names:
        parts = [word for word in re.findall("[a-zµ]+", name.lower().replace("µ", "u")) if not word.startswith("ev")]
        field = next((key for key, aliases in NAMES.items() if parts and parts[0] in aliases), None)
        if field is None or field in matches or (len(parts) > 1 and not (field == "t" and parts[-1] in UNITS)):
            continue
        matches[field] = name
        if len(parts) > 1:
            unit = UNITS[parts[-1]]
    return Names(**matches, unit=unit) if len(matches) == len(NAMES) else None


def unit_of(t: Array) -> int:
    """Return the exponent of the unit of times whose column states no unit: s if one has a fraction, otherwise us."""
    return SECONDS if t.dtype.kind == "f" and bool(np.any(np.isfinite(t) & (t != np.rint(t)))) else US


def order_of(columns: Array, has_points: Sequence[bool] = (False,) * 4) -> str:
    """Return the order of four columns without names: the most likely one with valid coordinates and polarities.

    An order is preferred if the times have decimal points and the coordinates have none. If time runs back in the most
    likely order, another order is chosen only if its times rise `MANY` times and never fall.
    Example: the rows (5, 1, 2, 1) and (3, 1, 2, 0) are t x y p, with a time that runs back.

    Args:
        columns: (n, 4) the first rows.
        has_points: for each column, True if its numbers have decimal points.

    Returns:
        One of `ORDERS`; the first if no order is possible.

    Raises:
        Ambiguous: time runs back in the most likely order, and only fewer than `MANY` rises support another order. Or
            time is constant in the most likely order, and another column may be the time.
    """
    possible_orders = [order for order in ORDERS if fits(columns, order, in_time=False)] or [ORDERS[0]]
    with_seconds = [order for order in possible_orders if in_seconds(has_points, order)]
    first = (with_seconds or possible_orders)[0]
    t = columns[:, first.index("t")]
    if len(t) < 2 or not np.isfinite(t).all():
        return first
    if fits(columns, first, in_time=True):
        likelier = possible_orders[: possible_orders.index(first)] if with_seconds else possible_orders
        other_orders = [] if _rises(columns, first) else [order for order in likelier if _may_be_time(columns, order)]
        why = f"stands still at {t[0]:.15g}"
    else:
        other_orders = [
            order for order in possible_orders if fits(columns, order, in_time=True) and _rises(columns, order)
        ]
        certain_orders = [order for order in other_orders if _rises(columns, order) >= MANY]
        if len(certain_orders) == 1:
            return certain_orders[0]
        k = int(np.argmax(t[1:] < t[:-1]))
        why = f"runs back from {t[k]:.15g} to {t[k + 1]:.15g}"
    if not other_orders:
        return first
    raise Ambiguous(first, other_orders, f"time {why}{'' if with_seconds or unit_of(t) else ' us'}")


def in_seconds(has_points: Sequence[bool], order: str) -> bool:
    """Return whether times have decimal points and coordinates have none, as times in seconds have."""
    t, x, y = (has_points[order.index(name)] for name in "txy")
    return t and not (x or y)


def _rises(columns: Array, order: str) -> int:
    t = columns[:, order.index("t")]
    return int(np.count_nonzero(t[1:] > t[:-1]))


def _may_be_time(columns: Array, order: str) -> bool:
    """Return whether a column may be a time: it never falls, and rises in at least every second row.

    With fewer than `MANY` rows a change suffices. In the output of a simulator that lists the events of one time row by
    row of the sensor, y rises less often.
    """
    steps = np.diff(columns[:, order.index("t")])
    if len(steps) < MANY:
        return bool(steps.any())
    return bool((steps >= 0).all() and 2 * np.count_nonzero(steps) >= len(steps))


def fits(columns: Array, order: str, *, in_time: bool) -> bool:
    """Return whether four columns can have an order: whole coordinates, and polarities from -1 to 1.

    Args:
        columns: (n, 4) numbers.
        order: an order such as "txyp".
        in_time: also require that time never runs back.
    """
    t, x, y, p = (columns[:, order.index(name)] for name in "txyp")
    if any(_first_outside(c, 0, 65535) is not None for c in (x, y)) or _first_outside(p, -1, 1) is not None:
        return False
    return not in_time or bool(np.all(np.isfinite(t)) and np.all(t[1:] >= t[:-1]))


def to_piece(columns: Mapping[str, Array], unit: int, first: int, place: int | None) -> tuple[Piece, str | None]:
    """Convert columns to events.

    Args:
        columns: t, x, y and p, of equal length.
        unit: exponent of the unit of time, see `UNITS`.
        first: number of the first event, for messages.
        place: byte of the file at which the columns are stored.

    Returns:
        The events before the first invalid event, and the fault of this event (None: all events are valid).
    """
    faults = [
        fault
        for fault in (
            _time_fault(columns["t"], unit),
            *(_position_fault(columns, n) for n in "xy"),
            _polarity_fault(columns),
        )
        if fault
    ]
    end, message = min(faults, default=(len(columns["t"]), None))
    empty = np.zeros(0, np.uint8)  # a column of text cannot be converted to numbers, even if empty
    t, x, y, p = (columns[name][:end] if end else empty for name in "txyp")
    sign = p.astype(np.int8, copy=False) if p.dtype.kind != "u" else p
    piece = Piece(
        _microseconds(t, unit),
        np.ascontiguousarray(x, EVENT["x"]),
        np.ascontiguousarray(y, EVENT["y"]),
        np.ascontiguousarray(sign if sign.dtype.kind == "u" else sign > 0, EVENT["p"]),
        place=lambda event: place,
    )
    return piece, None if message is None else f"event {first + end}: {message}"


def _microseconds(t: Array, unit: int) -> npt.NDArray[np.int64]:
    if t.dtype.kind == "f":
        t = np.rint(t * 10.0**unit)
    elif unit < 0:
        half = 10**-unit // 2
        t = (t.astype(np.int64) + half) // 10**-unit
    elif unit:
        t = t.astype(np.int64) * 10**unit
    return np.ascontiguousarray(t, EVENT["t"])


Fault = tuple[int, str]


def _time_fault(t: Array, unit: int) -> Fault | None:
    limit = _LIMIT / 10.0 ** max(unit, 0)
    if t.dtype.kind == "f":
        is_bad = ~(np.abs(t) < limit) | ((t != np.rint(t)) & (unit == US))
    elif t.dtype.kind in "iu":
        if unit <= 0 and np.can_cast(t.dtype, np.int64):
            return None
        is_bad = (t >= int(limit)) | (t <= -int(limit) if t.dtype.kind == "i" else False)
    else:
        return (0, f"t has type {t.dtype}, expected numbers") if t.size else None
    if not is_bad.any():
        return None
    k = int(is_bad.argmax())
    return k, f"t is {t[k]}, expected {'a whole number of us' if unit == US else 'a time'} below 2^63 us"


def _position_fault(columns: Mapping[str, Array], name: str) -> Fault | None:
    values = columns[name]
    k = None if values.dtype in (np.uint16, np.uint8) else _first_outside(values, 0, 65535)
    return None if k is None else (k, f"{name} is {values[k]}, expected a whole number from 0 to 65535")


def _polarity_fault(columns: Mapping[str, Array]) -> Fault | None:
    values = columns["p"]
    k = _first_outside(values, -1, 1)
    return None if k is None else (k, f"p is {values[k]}, expected 1 for ON, and 0 or -1 for OFF")


def _first_outside(values: Array, low: int, high: int) -> int | None:
    """Return the index of the first value that is not a whole number from `low` to `high`, None if all are."""
    if values.dtype.kind == "b" or not values.size:
        return None
    if values.dtype.kind not in "iuf":
        return 0
    if values.dtype.kind != "f" and low <= int(values.min()) and int(values.max()) <= high:
        return None
    is_bad = ~((values >= low) & (values <= high))
    if values.dtype.kind == "f":
        is_bad |= values != np.rint(values)
    return int(is_bad.argmax()) if is_bad.any() else None
