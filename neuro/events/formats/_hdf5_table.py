"""Tables in HDF5: (n, 4) numbers without names, of which the order of columns has to be found.

Known by place and type: v2e's ``/events`` (or ``/event``) of uint32 is t x y p, t in us; MVSEC's
``/davis/<side>/events`` of floating point is x y t p, t in s. Another table is t x y p, x y t p or x y p t: the one
that its first rows allow, with whole coordinates, polarities -1, 0 or 1, and times that do not run back. So is a table
in a known place that does not hold what it should. Where more than one order is left, the file is refused.

Source: v2e's ``emulator.py`` (``dvs_h5``: uint32, times 10^6, -1 written as 0); the page and readers of MVSEC.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from neuro.events.formats._columns import SECONDS, US, fits
from neuro.events.formats._format import Damage
from neuro.events.formats._hdf5_chunks import FAILURES, believable, chunks_whole, one_line, place, unpackable

ORDERS = ("txyp", "xytp", "xypt")
"""Of columns in the tables that are known; see `order`."""
ROWS = 1 << 16
"""Rows by which the order is found."""

_V2E = re.compile(r"/events?")
_MVSEC = re.compile(r"/davis/[^/]+/events")


def is_table(node: Any) -> bool:
    """Whether an open h5py dataset has four columns of numbers."""
    shape = getattr(node, "shape", None) or ()
    return list(shape[1:]) == [4] and node.dtype.kind in "iuf"


def order(table: Any) -> str:
    """The order of the columns of a table, as one of `ORDERS`.

    Args:
        table: an open h5py dataset that `is_table`.

    Raises:
        Damage: no order fits or several do, or the table cannot be read.
    """
    rows, likely = _first(table), _known(table)
    possible = [one for one in ORDERS if fits(rows, one, in_time=False)]
    certain = [one for one in possible if fits(rows, one, in_time=True)] or possible
    if likely in certain:
        return likely
    if len(certain) == 1 or not len(rows):
        return certain[0]
    if not certain:
        what = "expected t x y p, x y t p or x y p t, with whole coordinates and polarities -1, 0 or 1"
        raise Damage(f"{table.name} has rows such as {rows[0].tolist()}, {what}", None)
    told = " and ".join(" ".join(one) for one in certain)
    name = f"hdf5:{table.name}:{certain[0]}"
    hint = f"name the order, as in format={name!r} or --from {name}"
    raise Damage(f"the rows of {table.name} can be {told}: {hint}", None)


def unit(table: Any) -> int | None:
    """The power of ten by which the times of a table become us, None where they have to be looked at."""
    if table.dtype.kind != "f":
        return US
    return SECONDS if _MVSEC.fullmatch(table.name) else None


def _known(table: Any) -> str:
    """The order that place and type of a table tell, "" where they tell none."""
    if table.dtype == np.uint32 and _V2E.fullmatch(table.name):
        return "txyp"
    return "xytp" if table.dtype.kind == "f" and _MVSEC.fullmatch(table.name) else ""


def _first(table: Any) -> Any:
    """The first rows; those of the first chunk, where the ones behind it cannot be read."""
    unpackable(table)
    believable(table)
    counts = [ROWS, min(ROWS, (table.chunks or (ROWS,))[0])]
    for count in counts:
        try:
            chunks_whole(table, 0, min(count, len(table)))
            return table[:count]
        except FAILURES as error:
            fault = error
    raise Damage(f"event 0 on cannot be read: {one_line(fault)}", place(table, 0))
