"""Columns of events as tables of all kinds hold them: which is which, and their values as events.

Names are compared without case, signs and the word "event": ``t``, ``ts``, ``timeStamp``, ``ev_x``, ``pol`` and more.
A name may tell the unit of time: ``t_ns``, ``timestamp [us]``, ``t (s)``. Else times that are all whole are us, and
times with a fraction are seconds. Times finer than a us are rounded to the nearest. Of polarities 1 is ON, 0 and -1 are
OFF. A file is asked once, at its beginning, so that all its parts are read alike.
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
"""Powers of ten by which a time becomes us."""

US, SECONDS = 0, 6
ORDERS = ("txyp", "xypt", "xytp", "xtyp", "ptxy", "pxyt", "tpxy", "txpy", "xtpy", "xpty", "xpyt", "pxty")
"""Orders of columns without names, the likelier first; x stands before y."""

MANY = 16
"""Rising times that are no coincidence: of 17 distinct coordinates in random order 1 in 10^14 rises throughout."""

_LIMIT = 2.0**63


class Ambiguous(ValueError):
    """Raised where columns without names may be in several orders.

    Attributes:
        orders: the orders, the likeliest first.
        why: why the likeliest one was not taken.
    """

    def __init__(self, first: str, others: Sequence[str], why: str) -> None:
        super().__init__(first, others, why)
        self.orders = [" ".join(order) for order in (first, *others)]
        self.why = why


@dataclass(frozen=True, slots=True)
class Names:
    """Which columns of a table hold what.

    Attributes:
        t, x, y, p: names as the table has them.
        unit: power of ten by which a time becomes us, None where the name has none.
    """

    t: str
    x: str
    y: str
    p: str
    unit: int | None


def find_names(names: Iterable[str]) -> Names | None:
    """The columns among the names of a table, None where one is missing; of several the first counts."""
    found: dict[str, str] = {}
    unit = None
    for name in names:
        words = [word for word in re.findall("[a-zµ]+", name.lower().replace("µ", "u")) if not word.startswith("ev")]
        known = next((key for key, all_ in NAMES.items() if words and words[0] in all_), None)
        if known is None or known in found or (len(words) > 1 and not (known == "t" and words[-1] in UNITS)):
            continue
        found[known] = name
        if len(words) > 1:
            unit = UNITS[words[-1]]
    return Names(**found, unit=unit) if len(found) == len(NAMES) else None


def unit_of(t: Array) -> int:
    """The power of ten by which times without a named unit become us, from some of them."""
    return SECONDS if t.dtype.kind == "f" and bool(np.any(np.isfinite(t) & (t != np.rint(t)))) else US


def order_of(columns: Array, pointed: Sequence[bool] = (False,) * 4) -> str:
    """Return the order of four columns without names: the likeliest whose coordinates and polarities are possible.

    An order in which times have decimal points and coordinates have none is likelier than the others.

    If time runs back in that order, another one counts only where its times rise `MANY` times and never fall. E.g. the
    rows (5, 1, 2, 1) and (3, 1, 2, 0) are t x y p whose time runs back.

    Args:
        columns: (n, 4) the first rows.
        pointed: of each column, whether its numbers have decimal points.

    Returns:
        one of `ORDERS`; the first where none is possible.

    Raises:
        Ambiguous: time runs back in the likeliest order and rises in another, too seldom to decide for it; or time
            stands still in the likeliest order, and another column may be time.
    """
    possible = [order for order in ORDERS if fits(columns, order, in_time=False)] or [ORDERS[0]]
    told = [order for order in possible if in_seconds(pointed, order)]
    first = (told or possible)[0]
    t = columns[:, first.index("t")]
    if len(t) < 2 or not np.isfinite(t).all():
        return first
    if fits(columns, first, in_time=True):
        likelier = possible[: possible.index(first)] if told else possible
        others = [] if _rises(columns, first) else [order for order in likelier if _may_be_time(columns, order)]
        why = f"stands still at {t[0]:.15g}"
    else:
        others = [order for order in possible if fits(columns, order, in_time=True) and _rises(columns, order)]
        certain = [order for order in others if _rises(columns, order) >= MANY]
        if len(certain) == 1:
            return certain[0]
        k = int(np.argmax(t[1:] < t[:-1]))
        why = f"runs back from {t[k]:.15g} to {t[k + 1]:.15g}"
    if not others:
        return first
    raise Ambiguous(first, others, f"time {why}{'' if told or unit_of(t) else ' us'}")


def in_seconds(pointed: Sequence[bool], order: str) -> bool:
    """Return whether times have decimal points that coordinates lack, as seconds of whole numbers have."""
    t, x, y = (pointed[order.index(name)] for name in "txy")
    return t and not (x or y)


def _rises(columns: Array, order: str) -> int:
    t = columns[:, order.index("t")]
    return int(np.count_nonzero(t[1:] > t[:-1]))


def _may_be_time(columns: Array, order: str) -> bool:
    """Return whether a column changes, of few rows, or rises in every second of many rows and never falls.

    Of events that a simulator gives at one time, row by row of the sensor, y rises more seldom.
    """
    steps = np.diff(columns[:, order.index("t")])
    if len(steps) < MANY:
        return bool(steps.any())
    return bool((steps >= 0).all() and 2 * np.count_nonzero(steps) >= len(steps))


def fits(columns: Array, order: str, *, in_time: bool) -> bool:
    """Whether four columns can be in an order: whole coordinates, polarities from -1 to 1.

    Args:
        columns: (n, 4) numbers.
        order: such as "txyp".
        in_time: whether time must not run back, either.
    """
    t, x, y, p = (columns[:, order.index(name)] for name in "txyp")
    if any(_wrong(c, 0, 65535) is not None for c in (x, y)) or _wrong(p, -1, 1) is not None:
        return False
    return not in_time or bool(np.all(np.isfinite(t)) and np.all(t[1:] >= t[:-1]))


def to_piece(columns: Mapping[str, Array], unit: int, first: int, place: int | None) -> tuple[Piece, str | None]:
    """Columns as events.

    Args:
        columns: t, x, y and p, equally long.
        unit: power of ten by which a time becomes us.
        first: number of the first event, for messages.
        place: byte of the file where they lie.

    Returns:
        the events up to the first that cannot be, and what is wrong with that one (None: all are right).
    """
    faults = [
        fault for fault in (_time(columns["t"], unit), *(_place(columns, n) for n in "xy"), _sign(columns)) if fault
    ]
    end, what = min(faults, default=(len(columns["t"]), None))
    none = np.zeros(0, np.uint8)  # a column of a type that is not numeric cannot be converted, even where it is empty
    t, x, y, p = (columns[name][:end] if end else none for name in "txyp")
    sign = p.astype(np.int8, copy=False) if p.dtype.kind != "u" else p
    piece = Piece(
        _microseconds(t, unit),
        np.ascontiguousarray(x, EVENT["x"]),
        np.ascontiguousarray(y, EVENT["y"]),
        np.ascontiguousarray(sign if sign.dtype.kind == "u" else sign > 0, EVENT["p"]),
        place=lambda event: place,
    )
    return piece, None if what is None else f"event {first + end}: {what}"


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


def _time(t: Array, unit: int) -> Fault | None:
    limit = _LIMIT / 10.0 ** max(unit, 0)
    if t.dtype.kind == "f":
        bad = ~(np.abs(t) < limit) | ((t != np.rint(t)) & (unit == US))
    elif t.dtype.kind in "iu":
        if unit <= 0 and np.can_cast(t.dtype, np.int64):
            return None
        bad = (t >= int(limit)) | (t <= -int(limit) if t.dtype.kind == "i" else False)
    else:
        return (0, f"t has type {t.dtype}, expected numbers") if t.size else None
    if not bad.any():
        return None
    k = int(bad.argmax())
    return k, f"t is {t[k]}, expected {'a whole number of us' if unit == US else 'a time'} below 2^63 us"


def _place(columns: Mapping[str, Array], name: str) -> Fault | None:
    values = columns[name]
    k = None if values.dtype in (np.uint16, np.uint8) else _wrong(values, 0, 65535)
    return None if k is None else (k, f"{name} is {values[k]}, expected a whole number from 0 to 65535")


def _sign(columns: Mapping[str, Array]) -> Fault | None:
    values = columns["p"]
    k = _wrong(values, -1, 1)
    return None if k is None else (k, f"p is {values[k]}, expected 1 for ON, and 0 or -1 for OFF")


def _wrong(values: Array, low: int, high: int) -> int | None:
    """The first value that is no whole number in a range."""
    if values.dtype.kind == "b" or not values.size:
        return None
    if values.dtype.kind not in "iuf":
        return 0
    if values.dtype.kind != "f" and low <= int(values.min()) and int(values.max()) <= high:
        return None
    bad = ~((values >= low) & (values <= high))
    if values.dtype.kind == "f":
        bad |= values != np.rint(values)
    return int(bad.argmax()) if bad.any() else None
