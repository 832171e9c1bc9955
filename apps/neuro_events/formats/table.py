"""Text with one event per line, CSV or TXT, with columns in any order. Both are detected by their content.

A line ends with LF, CR LF or CR. Numbers are separated by commas, semicolons, spaces or tabs. Empty lines and lines
that begin with ``#`` or ``%`` are skipped. ``%geometry:WIDTH,HEIGHT`` or ``# sensor WIDTHxHEIGHT`` among the first
lines, or a first line with only two whole numbers, states the sensor. A line of names (also as the last comment) states
the columns and may state the unit of time, as in `_columns`. Polarities may also be True and False.

A comma is a decimal point if semicolons separate the columns, or if spaces or tabs separate numbers with commas.

Without names the first 64 KiB decide the order of the columns. An order is possible if coordinates are whole,
polarities are 0 or 1 (or -1 and 1), and x precedes y. The most likely of the possible orders is used, t x y p before
all others. `_columns.order_of` states what happens if time runs back or is constant in this order.

Times are us if all of them are whole in the first 64 KiB. Times with a fraction are seconds (as in the RPG's
``events.txt``), and so are times with a decimal point or an exponent if the coordinates have none. Seconds are rounded
to the nearest us. In a file with times in us, a later time with a fraction is an error.

The user may state order and unit after a colon in the name of the format. This text is called the place: ``csv:xytp``
states the order of the four columns, ``csv:s`` the unit of time (s, ms, us, ns), ``csv:xytp:ms`` both.

The writers produce a comment with the sensor, the names, and lines ``t,x,y,p`` in us. In TXT the names are a comment,
and spaces separate the columns, so that ``numpy.loadtxt`` reads the file. Metadata are not stored.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import LazyModule
from neuro_events._events import Events, empty_columns
from neuro_events.formats._columns import SECONDS, UNITS, US, Ambiguous, find_names, in_seconds, order_of, unit_of
from neuro_events.formats._format import Damage, Format, Piece, Size
from neuro_events.formats._reading import growing
from neuro_events.source import Bytes, Source

kernels = LazyModule("neuro_events.formats._table_kernel")

SHORT_UNITS = ("s", "ms", "us", "ns")
"""Units of time in a place and in `metadata`."""
SAMPLE = 1 << 16
"""Number of bytes at the beginning that determine columns and unit."""
LINE_LIMIT = 1 << 16
"""Largest length of a line, bytes."""
SHORTEST_ROW = 8
"""Size of the shortest line with an event, bytes: ``0,0,0,0`` and its end."""
ROW_LIMIT = 35
"""Size of the longest line that is written, bytes: 20 + 5 + 5 + 1 digits and 4 separators."""

_SENSOR = re.compile(r"[#%] *(?:geometry *: *(\d+) *, *(\d+)|sensor +(\d+)x(\d+))", re.ASCII)
_LINE_END = re.compile(rb"\r\n|\r|\n")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?\d+(?:,\d+)?(?:[eE][+-]?\d+)?", re.ASCII)
_TRUTH = {"true": 1.0, "false": 0.0}
_BOM = b"\xef\xbb\xbf"
"""Byte order mark of UTF-8, which some programs write before text."""


class _AmbiguousOrder(Damage):
    """Raised if the columns may have several orders."""


@dataclass(slots=True)
class _Layout:
    """Layout of a file, from its beginning.

    Attributes:
        start: byte of the first event.
        line: line number of the first event.
        columns: number of columns.
        where: column of each of t, x, y and p.
        unit: exponent of the unit of time, see `_columns.UNITS`.
        size: width and height of the sensor, px, or None.
        commas: numbers have decimal commas.
    """

    start: int
    line: int
    columns: int
    where: dict[str, int]
    unit: int
    size: Size | None
    commas: bool


class Table:
    """A reader of text files. ``metadata`` has the order of the ``columns`` and the ``time_unit``.

    Args:
        source: the file.
        place: order and unit from the user, such as ``xytp:ms``; "": determined from the file.
    """

    def __init__(self, source: Source, place: str = "") -> None:
        self._source = source
        self._layout = layout = _layout(source.head(SAMPLE), *_options(place))
        self.sensor_size: Size | None = layout.size
        order = " ".join(sorted(layout.where, key=lambda name: layout.where[name]))
        unit = next(name for name, power in UNITS.items() if power == layout.unit)
        self.metadata: Mapping[str, Any] = {"columns": order, "time_unit": unit}

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events; see `Reader`."""
        line, at = self._layout.line, self._layout.start
        leftover = np.zeros(0, np.uint8)
        for _, data in self._source.blocks(at, max(block, LINE_LIMIT)):
            data = np.concatenate([leftover, data]) if leftover.size else data
            end = _end_of_last_line(data)
            leftover = data[end:]
            if end:
                line, at = yield from self._lines(data[:end], line, at)
            if leftover.size > LINE_LIMIT:
                raise Damage(f"line {line + 1} is longer than {LINE_LIMIT} bytes", at)
        if leftover.size or at == self._layout.start:
            yield from self._lines(leftover, line, at)

    def _lines(self, data: Bytes, line: int, at: int) -> Generator[Piece, None, tuple[int, int]]:
        """Yield the events of complete lines, and return the line number and the byte after them."""
        layout = self._layout
        t, x, y, p = empty_columns(data.size // SHORTEST_ROW + 1)
        columns = np.array([layout.where[name] for name in "txyp"], np.int64)
        if layout.commas and (commas := data == ord(",")).any():
            data = np.where(commas, np.uint8(ord(".")), data)
        n, end, lines, fault, column = kernels.parse(data, layout.columns, columns, layout.unit, t, x, y, p)

        def begin(event: int) -> tuple[int, int]:
            place = np.zeros(2, np.int64)
            kernels.rows(data, event, place)
            return int(place[0]), int(place[1])

        yield Piece(
            t[:n], x[:n], y[:n], p[:n],
            place=lambda event: at + begin(event)[0], line=lambda event: line + 1 + begin(event)[1],
        )  # fmt: skip
        if fault:
            text = _LINE_END.split(data[end : end + LINE_LIMIT].tobytes(), 1)[0].decode("utf-8", "replace")
            raise Damage(f"line {line + lines + 1}: {self._fault_text(fault, column, text)}", at + int(end))
        return line + int(lines), at + int(end)

    def _fault_text(self, fault: int, column: int, text: str) -> str:
        """Describe the fault of a column in a line."""
        layout = self._layout
        values = _values(text.strip())
        if _has_decimal_commas(text) and not layout.commas:
            return f"{text[:40]!r} has decimal commas, unlike the lines before: expected decimal points"
        if fault in (kernels.TOO_FEW, kernels.TOO_MANY):
            return f"has {len(values)} columns, expected {layout.columns}"
        name = next(name for name, place in layout.where.items() if place == column)
        value = values[column] if column < len(values) else ""
        message = f"{name} is {value[:40]!r}"
        if fault == kernels.NOT_A_NUMBER:
            return f"{message}, expected a number"
        if name == "t":
            unit = "whole us, as before; --from csv:s or format='csv:s' reads seconds, csv:ms and csv:ns ms and ns"
            return f"{message}, expected {unit if fault == kernels.NOT_WHOLE else 'less than 2^63 us'}"
        expected = "1 for ON, and 0 or -1 for OFF" if name == "p" else "a whole number from 0 to 65535"
        return f"{message}, expected {expected}"


def _end_of_last_line(data: Bytes) -> int:
    """Return the end of the last complete line. A CR at the end of `data` may be the first half of a CR LF."""
    for begin in (max(0, data.size - LINE_LIMIT), 0):
        part = data[begin:]
        ends = np.flatnonzero((part == ord("\n")) | (part == ord("\r")))
        if ends.size and part[-1] == ord("\r"):
            ends = ends[:-1]
        if ends.size:
            return begin + int(ends[-1]) + 1
    return 0


def _options(place: str) -> tuple[str | None, int | None]:
    """Return the order of columns and the exponent of the unit of time in a place such as ``xytp:ms``.

    An order or a unit that the place does not state is None.
    """
    order = unit = None
    for word in place.split(":") if place else ():
        if word in SHORT_UNITS and unit is None:
            unit = UNITS[word]
        elif sorted(word) == sorted("txyp") and order is None:
            order = word
        else:
            expected = (
                "an order of t, x, y and p as in csv:xytp, a unit of time as in csv:ms, or both as in csv:xytp:ms"
            )
            raise Damage(
                f"columns are given as {place!r:.40}, expected {expected}; units are {', '.join(SHORT_UNITS)}", None
            )
    return order, unit


def _layout(head: bytes, order: str | None = None, unit: int | None = None) -> _Layout:
    """Determine the layout of a file from its first bytes. `order` and `unit` are the user's, if any."""
    if len(head) == SAMPLE:
        head = head[: max(head.rfind(b"\n"), head.rfind(b"\r", 0, -1)) + 1] or head
    size: Size | None = None
    names: list[str] | None = None
    at = len(_BOM) if head.startswith(_BOM) else 0
    for number, raw in enumerate(head[at:].splitlines(keepends=True)):
        text = raw.decode("utf-8", "replace").strip()
        values = _values(text)
        if text.startswith(("#", "%")):
            if match := _SENSOR.match(text):
                size = _sensor([int(value) for value in match.groups() if value], number, at)
            comment_names = _values(text.lstrip("#% "))
            names = comment_names if find_names(comment_names) else names
        elif len(values) == 2 and names is None and all(value.isdecimal() for value in values):
            size = _sensor([int(value) for value in values], number, at)
        elif find_names(values):
            names = values
        elif values and (names is not None or not any(np.isnan(_float(value)) for value in values)):
            return _layout_of_rows(head[at:], at, number, names, len(values), size, order, unit)
        elif values:
            raise Damage(f"line {number + 1}: {text[:60]!r}, expected names or numbers of t, x, y and p", at)
        at += len(raw)
    return _layout_of_rows(b"", at, len(_LINE_END.findall(head)), names, len(names or "txyp"), size, order, unit)


def _values(text: str) -> list[str]:
    """Split a line at semicolons, else at commas, else at tabs, else at spaces."""
    text = text.rstrip(",; \t")
    if _has_decimal_commas(text):
        text = text.replace(",", ".")
    if "," in text or ";" in text:
        parts = re.split("[,;]", text)
    else:
        parts = text.split("\t") if "\t" in text else text.split()
    return [part.strip("\"' \t") for part in parts] if text else []


def _has_decimal_commas(text: str) -> bool:
    """Return whether the commas of a line are decimal, because semicolons or spaces separate the columns."""
    if "," not in text or not (";" in text or " " in text or "\t" in text):
        return False
    return ";" in text or all(map(_WITH_COMMA.fullmatch, text.split()))


def _sensor(size: list[int], number: int, at: int) -> Size:
    if not all(1 <= value <= 65536 for value in size):
        raise Damage(f"line {number + 1}: the sensor is {size[0]}x{size[1]}, expected 1x1 to 65536x65536", at)
    return size[0], size[1]


def _layout_of_rows(
    rows: bytes, at: int, number: int, names: list[str] | None, columns: int, size: Size | None,
    order: str | None, unit: int | None,
) -> _Layout:  # fmt: skip
    """Determine the layout of a file whose events begin at byte `at`, from the names and the first rows."""
    header = find_names(names) if names else None
    texts = [line.decode("utf-8", "replace").strip() for line in rows.splitlines()]
    first = texts[0].rstrip(",; \t") if texts else ""
    commas = ("," not in first or _has_decimal_commas(first)) and (
        ";" in first or any(_has_decimal_commas(text) and text[0] not in "#%" for text in texts)
    )
    lines = [line for line in map(_values, texts) if len(line) == columns]
    if order is not None and columns == len(order):
        where = {name: place for place, name in enumerate(order)}
    elif order is None and names and header and len(names) == columns:
        where = {name: names.index(getattr(header, name)) for name in "txyp"}
        unit = header.unit if unit is None else unit
    elif order is None and columns == 4:
        where = {name: place for place, name in enumerate(_order_of_rows(lines, at))}
    else:
        raise Damage(f"line {number + 1}: has {columns} columns, expected {len(order or names or 'txyp')}", at)
    return _Layout(at, number, columns, where, _unit_of_rows(lines, where) if unit is None else unit, size, commas)


def _order_of_rows(lines: list[list[str]], at: int) -> str:
    """Return the order of four columns from the first rows.

    Raises:
        Damage: several orders are possible; the message says how to specify one.
    """
    try:
        rows = np.array([[_float(value) for value in line] for line in lines], np.float64).reshape(-1, 4)
        return order_of(rows, _have_points(lines, range(4)))
    except Ambiguous as ambiguity:
        first, *alternatives = ambiguity.orders
        text = f"columns without names may be {first}, where {ambiguity.why}, or {' or '.join(alternatives)}"
        word = first.replace(" ", "")
        raise _AmbiguousOrder(f"{text}: expected the order, as --from csv:{word} or format='csv:{word}'", at) from None


def _unit_of_rows(lines: list[list[str]], where: Mapping[str, int]) -> int:
    """Return the exponent of the unit of time from the first rows.

    Times with a fraction are seconds, and so are whole times with a decimal point if the coordinates have none.
    """
    times = np.array([_float(line[where["t"]]) for line in lines], np.float64)
    if unit_of(times[np.isfinite(times)]) == SECONDS:
        return SECONDS
    has_points = _have_points(lines, [where[name] for name in "txyp"])
    return SECONDS if in_seconds(has_points, "txyp") else US


def _have_points(lines: list[list[str]], columns: Sequence[int]) -> list[bool]:
    """Return for each column whether any of its numbers has a decimal point or an exponent."""
    texts = ([line[column] for line in lines] for column in columns)
    return [any(not text.lstrip("+-").isdecimal() and _NUMBER.fullmatch(text) for text in cells) for cells in texts]


def _float(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text) else _TRUTH.get(text.lower(), float("nan"))


def _knows(head: bytes) -> bool:
    """Return whether a file begins with lines of names or numbers."""
    end = max(head.rfind(b"\n"), head.rfind(b"\r")) + 1
    if b"\0" in head or not head.isascii() or not end:
        return False
    try:
        layout = _layout(head[:end])
    except _AmbiguousOrder:
        return True
    except Damage:
        return False
    return layout.start < len(head)


def write(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as CSV."""
    _write(parts, path, "# sensor %dx%d\nt,x,y,p\n", ",")


def write_txt(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as TXT."""
    _write(parts, path, "# sensor %dx%d\n# t x y p\n", " ")


def _write(parts: Iterator[Events], path: Path, head: str, separator: str) -> None:
    with growing(path.open("wb")) as append:
        for k, events in enumerate(parts):
            if not k:
                append((head % events.sensor_size).encode("ascii"))
            for begin in range(0, len(events), 1 << 18):
                part = events[begin : begin + (1 << 18)]
                out = np.empty(ROW_LIMIT * len(part), np.uint8)
                append(out[: kernels.form(part.t, part.x, part.y, part.p, ord(separator), out)].data)


TABLE = Format("csv", "CSV", (".csv",), _knows, Table, write, grows=True, inside=Table, guesses=True)
"""CSV, read and written. TXT that is detected by its content is read as CSV."""
TXT = Format("txt", "TXT", (".txt",), lambda head: False, Table, write_txt, grows=True, inside=Table)
"""TXT, read and written."""
