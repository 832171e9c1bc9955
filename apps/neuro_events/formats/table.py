"""Text with one event a line, CSV or TXT, in any order of columns; both are known by their lines.

A line ends with LF, CR LF or CR. Numbers are parted by commas, semicolons, spaces or tabs. Lines that begin with ``#``
or ``%`` and empty ones are left out; ``%geometry:WIDTH,HEIGHT`` or ``# sensor WIDTHxHEIGHT`` among the first, or a
first line with two whole numbers only, tells the sensor. A line of names (also as the last comment) tells the columns
and may tell the unit of time, as in `_columns`. Polarities may also be True and False.

Where semicolons part the columns, or spaces or tabs part numbers with commas, a comma is a decimal point.

Without names the first 64 KiB decide about the columns: coordinates are whole, polarities 0 or 1 (or -1 and 1), x
stands before y, and of several possible orders the likeliest is taken, t x y p first. If time runs back or stands still
in that one, see `_columns.order_of`.

Times that are all whole in the first 64 KiB are us; times with a fraction are seconds (as in the RPG's
``events.txt``), and so are times with a decimal point or an exponent where the coordinates have none; they are rounded
to the nearest us. A fraction after whole us is an error.

A place in the file's format tells what the file does not: ``csv:xytp`` the order of the four columns, ``csv:s`` the
unit of time (s, ms, us, ns), ``csv:xytp:ms`` both.

Written are a comment with the sensor, the names and lines ``t,x,y,p`` in us; in TXT the names are a comment, too, and
spaces part the columns, so that ``numpy.loadtxt`` reads it. Metadata are not kept.
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
"""Units that a place may name, and `metadata` has."""
SAMPLE = 1 << 16
"""Bytes by which columns and unit are found."""
LINE_LIMIT = 1 << 16
"""No line is longer."""
SHORTEST_ROW = 8
"""Bytes of the shortest line with an event: ``0,0,0,0`` and its end."""
ROW_LIMIT = 35
"""Bytes of the longest line that is written: 20 + 5 + 5 + 1 digits and four signs between."""

_SENSOR = re.compile(r"[#%] *(?:geometry *: *(\d+) *, *(\d+)|sensor +(\d+)x(\d+))", re.ASCII)
_LINE_END = re.compile(rb"\r\n|\r|\n")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?\d+(?:,\d+)?(?:[eE][+-]?\d+)?", re.ASCII)
_TRUTH = {"true": 1.0, "false": 0.0}
_BOM = b"\xef\xbb\xbf"
"""What some programs write before text."""


class _Unclear(Damage):
    """Raised where columns may be in several orders."""


@dataclass(slots=True)
class _Layout:
    """What the beginning of a file states: first byte and line of the events, columns, order, unit and sensor.

    Attributes:
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
    """An open text file; ``metadata`` has ``columns``, their order, and ``time_unit``.

    Args:
        source: the file.
        place: order and unit that the user gives, as ``xytp:ms``; "" where the file tells them.
    """

    def __init__(self, source: Source, place: str = "") -> None:
        self._source = source
        self._layout = layout = _layout(source.head(SAMPLE), *_options(place))
        self.sensor_size: Size | None = layout.size
        order = " ".join(sorted(layout.where, key=lambda name: layout.where[name]))
        unit = next(name for name, power in UNITS.items() if power == layout.unit)
        self.metadata: Mapping[str, Any] = {"columns": order, "time_unit": unit}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        line, at = self._layout.line, self._layout.start
        rest = np.zeros(0, np.uint8)
        for _, data in self._source.blocks(at, max(block, LINE_LIMIT)):
            data = np.concatenate([rest, data]) if rest.size else data
            whole = _whole_lines(data)
            rest = data[whole:]
            if whole:
                line, at = yield from self._lines(data[:whole], line, at)
            if rest.size > LINE_LIMIT:
                raise Damage(f"line {line + 1} is longer than {LINE_LIMIT} bytes", at)
        if rest.size or at == self._layout.start:
            yield from self._lines(rest, line, at)

    def _lines(self, data: Bytes, line: int, at: int) -> Generator[Piece, None, tuple[int, int]]:
        """The events of whole lines; gives the line and the byte after them."""
        layout = self._layout
        t, x, y, p = empty_columns(data.size // SHORTEST_ROW + 1)
        where = np.array([layout.where[name] for name in "txyp"], np.int64)
        if layout.commas and (commas := data == ord(",")).any():
            data = np.where(commas, np.uint8(ord(".")), data)
        n, end, lines, wrong, column = kernels.parse(data, layout.columns, where, layout.unit, t, x, y, p)

        def begin(event: int) -> tuple[int, int]:
            found = np.zeros(2, np.int64)
            kernels.rows(data, event, found)
            return int(found[0]), int(found[1])

        yield Piece(
            t[:n], x[:n], y[:n], p[:n],
            place=lambda event: at + begin(event)[0], line=lambda event: line + 1 + begin(event)[1],
        )  # fmt: skip
        if wrong:
            text = _LINE_END.split(data[end : end + LINE_LIMIT].tobytes(), 1)[0].decode("utf-8", "replace")
            raise Damage(f"line {line + lines + 1}: {self._fault(wrong, column, text)}", at + int(end))
        return line + int(lines), at + int(end)

    def _fault(self, wrong: int, column: int, text: str) -> str:
        """What is wrong with a column of a line."""
        layout = self._layout
        values = _values(text.strip())
        if _has_decimal_commas(text) and not layout.commas:
            return f"{text[:40]!r} has decimal commas, unlike the lines before: expected decimal points"
        if wrong in (kernels.TOO_FEW, kernels.TOO_MANY):
            return f"has {len(values)} columns, expected {layout.columns}"
        name = next(name for name, place in layout.where.items() if place == column)
        value = values[column] if column < len(values) else ""
        message = f"{name} is {value[:40]!r}"
        if wrong == kernels.NOT_A_NUMBER:
            return f"{message}, expected a number"
        if name == "t":
            whole = "whole us, as before; --from csv:s or format='csv:s' reads seconds, csv:ms and csv:ns likewise"
            return f"{message}, expected {whole if wrong == kernels.NOT_WHOLE else 'less than 2^63 us'}"
        expected = "1 for ON, and 0 or -1 for OFF" if name == "p" else "a whole number from 0 to 65535"
        return f"{message}, expected {expected}"


def _whole_lines(data: Bytes) -> int:
    """Where the last line that ends in `data` ends. A CR at the very end may be the first half of a CR LF."""
    for begin in (max(0, data.size - LINE_LIMIT), 0):
        part = data[begin:]
        ends = np.flatnonzero((part == ord("\n")) | (part == ord("\r")))
        if ends.size and part[-1] == ord("\r"):
            ends = ends[:-1]
        if ends.size:
            return begin + int(ends[-1]) + 1
    return 0


def _options(place: str) -> tuple[str | None, int | None]:
    """The order of columns and the unit of time that a place such as ``xytp:ms`` gives, None where it does not."""
    order = unit = None
    for word in place.split(":") if place else ():
        if word in SHORT_UNITS and unit is None:
            unit = UNITS[word]
        elif sorted(word) == sorted("txyp") and order is None:
            order = word
        else:
            known = "an order of t, x, y and p as in csv:xytp, a unit of time as in csv:ms, or both as in csv:xytp:ms"
            raise Damage(
                f"columns are given as {place!r:.40}, expected {known}; units are {', '.join(SHORT_UNITS)}", None
            )
    return order, unit


def _layout(head: bytes, order: str | None = None, unit: int | None = None) -> _Layout:
    """What the first bytes of a file tell; `order` and `unit` as the user gives them."""
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
            commented = _values(text.lstrip("#% "))
            names = commented if find_names(commented) else names
        elif len(values) == 2 and names is None and all(value.isdecimal() for value in values):
            size = _sensor([int(value) for value in values], number, at)
        elif find_names(values):
            names = values
        elif values and (names is not None or not any(np.isnan(_float(value)) for value in values)):
            return _of_rows(head[at:], at, number, names, len(values), size, order, unit)
        elif values:
            raise Damage(f"line {number + 1}: {text[:60]!r}, expected names or numbers of t, x, y and p", at)
        at += len(raw)
    return _of_rows(b"", at, len(_LINE_END.findall(head)), names, len(names or "txyp"), size, order, unit)


def _values(text: str) -> list[str]:
    """Names or numbers of a line: parted by semicolons, else by commas, else by tabs, else by spaces."""
    text = text.rstrip(",; \t")
    if _has_decimal_commas(text):
        text = text.replace(",", ".")
    if "," in text or ";" in text:
        parts = re.split("[,;]", text)
    else:
        parts = text.split("\t") if "\t" in text else text.split()
    return [part.strip("\"' \t") for part in parts] if text else []


def _has_decimal_commas(text: str) -> bool:
    """Whether the commas of a line are decimal: semicolons, or spaces between numbers, part the columns."""
    if "," not in text or not (";" in text or " " in text or "\t" in text):
        return False
    return ";" in text or all(map(_WITH_COMMA.fullmatch, text.split()))


def _sensor(size: list[int], number: int, at: int) -> Size:
    if not all(1 <= value <= 65536 for value in size):
        raise Damage(f"line {number + 1}: the sensor is {size[0]}x{size[1]}, expected 1x1 to 65536x65536", at)
    return size[0], size[1]


def _of_rows(
    rows: bytes, at: int, number: int, names: list[str] | None, columns: int, size: Size | None,
    order: str | None, unit: int | None,
) -> _Layout:  # fmt: skip
    """The layout of a file whose events begin at a byte."""
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
        where = {name: place for place, name in enumerate(_found_order(lines, at))}
    else:
        raise Damage(f"line {number + 1}: has {columns} columns, expected {len(order or names or 'txyp')}", at)
    return _Layout(at, number, columns, where, _found_unit(lines, where) if unit is None else unit, size, commas)


def _found_order(lines: list[list[str]], at: int) -> str:
    """The order of four columns by the first rows.

    Raises:
        Damage: it may be one of several; says how to give it.
    """
    try:
        rows = np.array([[_float(value) for value in line] for line in lines], np.float64).reshape(-1, 4)
        return order_of(rows, _pointed(lines, range(4)))
    except Ambiguous as several:
        first, *others = several.orders
        what = f"columns without names may be {first}, where {several.why}, or {' or '.join(others)}"
        word = first.replace(" ", "")
        raise _Unclear(f"{what}: expected the order, as --from csv:{word} or format='csv:{word}'", at) from None


def _found_unit(lines: list[list[str]], where: Mapping[str, int]) -> int:
    """The unit of time by the first rows: a decimal point that coordinates lack tells seconds, also of whole times."""
    times = np.array([_float(line[where["t"]]) for line in lines], np.float64)
    if unit_of(times[np.isfinite(times)]) == SECONDS:
        return SECONDS
    pointed = _pointed(lines, [where[name] for name in "txyp"])
    return SECONDS if in_seconds(pointed, "txyp") else US


def _pointed(lines: list[list[str]], columns: Sequence[int]) -> list[bool]:
    """Return of each column whether some number has a decimal point or an exponent."""
    texts = ([line[column] for line in lines] for column in columns)
    return [any(not text.lstrip("+-").isdecimal() and _NUMBER.fullmatch(text) for text in each) for each in texts]


def _float(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text) else _TRUTH.get(text.lower(), float("nan"))


def _knows(head: bytes) -> bool:
    """Whether a file begins with lines of names or numbers, by what a few bytes tell."""
    whole = max(head.rfind(b"\n"), head.rfind(b"\r")) + 1
    if b"\0" in head or not head.isascii() or not whole:
        return False
    try:
        layout = _layout(head[:whole])
    except _Unclear:
        return True
    except Damage:
        return False
    return layout.start < len(head)


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as CSV."""
    _write(parts, path, "# sensor %dx%d\nt,x,y,p\n", ",")


def write_txt(parts: Iterator[Events], path: Path) -> None:
    """Encode as TXT."""
    _write(parts, path, "# sensor %dx%d\n# t x y p\n", " ")


def _write(parts: Iterator[Events], path: Path, head: str, between: str) -> None:
    with growing(path.open("wb")) as append:
        for k, events in enumerate(parts):
            if not k:
                append((head % events.sensor_size).encode("ascii"))
            for begin in range(0, len(events), 1 << 18):
                part = events[begin : begin + (1 << 18)]
                out = np.empty(ROW_LIMIT * len(part), np.uint8)
                append(out[: kernels.form(part.t, part.x, part.y, part.p, ord(between), out)].data)


TABLE = Format("csv", "CSV", (".csv",), _knows, Table, write, grows=True, inside=Table, guesses=True)
"""Read and written; TXT that is known by its lines is read as this."""
TXT = Format("txt", "TXT", (".txt",), lambda head: False, Table, write_txt, grows=True, inside=Table)
"""Read and written."""
