"""DAT of Prophesee, versions 1 and 2 (N-CARS, Gen1 and 1 Mpx automotive data sets, exports of the vendor's tools).

A file has lines that begin with ``%``, a byte for the kind of event (0x00 or 0x0C: pixel events), a byte for its size
(8), then for each event a little-endian uint32 time in us and a uint32 address.
Version 2: x in bits 0-13, y in bits 14-27, polarity in bit 28 (1 = ON), the rest 0.
Version 1 (and files of kind 0x00 without a version): x in bits 0-8, y in bits 9-16, polarity in bit 17.

The sensor is the header's ``Width`` and ``Height``. N-CARS and older files have none; their sensor is the first of
304x240 (ATIS), 640x480 and 1280x720 that contains all events.

The clock wraps after 2^32 us (71.6 minutes). A fall of the time from the last sixteenth of the range to the first
counts as a wrap, and 2^32 us are added to all later times. Any other fall is a time that runs back. The writer refuses
times of 2^32 us and more, so files of the writer contain no wrap.

RAW files have the same kind of header, with lines ``% key value``; DAT and RAW differ in the data after the last line.
A RAW header ends with the line ``% end`` (not in older files), and states the coding as ``% evt 3.0`` or
``% format EVT3;height=720;width=1280``. The sensor is in that line, in ``% geometry 1280x720`` or, in DAT, in
``% Width`` and ``% Height``. Otherwise the name of the sensor decides (``% plugin_name hal_plugin_gen41_evk3``).

Source: Prophesee, "DAT file format", "RAW file format" and "Data encoding formats", docs.prophesee.ai; version 1:
Prophesee's Matlab reader ``load_atis_data``.
No file of version 1 was available: its reader follows the specification.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from neuro_events.formats._format import HEAD, Damage, Format, Limits, Size
from neuro_events.formats._words import (
    PERIOD,
    WRAPS,
    Field,
    Layout,
    Odd,
    SeekingReader,
    layout_writer,
)
from neuro_events.source import Bytes, Source

ATIS = (304, 240)
GEN3 = (640, 480)
GEN4 = (1280, 720)
LONGEST = 1 << 20
"""Largest size of a header, bytes."""

_LINE = re.compile(rb"%(?:[ \t][\t\x20-\x7e\x80-\xff]*)?\r?\n")
_BEGUN = re.compile(rb"%(?:[ \t][\t\x20-\x7e\x80-\xff]*)?\r?\Z")
_SENSORS = {"genx320": (320, 320), "gen3": GEN3, "gen4": GEN4, "imx636": GEN4, "imx646": GEN4}
_CODINGS = {"2.0": "EVT2", "2.1": "EVT21", "3.0": "EVT3"}


@dataclass(frozen=True, slots=True)
class Header:
    """The header of a DAT or RAW file.

    Attributes:
        fields: value of each key; keys in lower case.
        offsets: byte at which the line of each key begins.
        length: size of the header, bytes.
        cut: first byte of a line that the end of the file cuts, None without such a line.
    """

    fields: Mapping[str, str]
    offsets: Mapping[str, int]
    length: int
    cut: int | None = None

    @property
    def coding(self) -> str | None:
        """Coding that the header of a RAW file states, e.g. ``EVT3``, ``EVT2`` or ``EVT21``, or None."""
        if "format" in self.fields:
            return self.fields["format"].split(";")[0].strip().upper()
        version = self.fields.get("evt")
        return None if version is None else _CODINGS.get(version, f"EVT {version}")

    @property
    def options(self) -> dict[str, str]:
        """Options after the coding, e.g. ``height=720;width=1280``."""
        parts = self.fields.get("format", "").split(";")[1:]
        return {key.strip().lower(): value.strip() for key, _, value in (part.partition("=") for part in parts)}

    def damage(self, key: str, what: str) -> Damage:
        """Return the damage for the line of a key."""
        return Damage(f"header: {key} is {self.fields[key]!r}, expected {what}", self.offsets[key])

    def sensor_size(self) -> Size | None:
        """Return the width and height that the header or the name of the sensor states, or None.

        Raises:
            Damage: the header states an invalid size.
        """
        options = self.options
        sizes = (
            ("geometry", self.fields.get("geometry", "").lower().split("x")),
            ("format", [options[side] for side in ("width", "height") if side in options]),
            ("width", [self.fields[side] for side in ("width", "height") if side in self.fields]),
        )
        for key, values in sizes:
            if key in self.fields and values:
                if len(values) != 2 or not all(v.isdecimal() and 1 <= int(v) <= 1 << 16 for v in values):
                    raise self.damage(key, "a width and a height of 1 to 65536 px")
                return int(values[0]), int(values[1])
        names = f"{self.fields.get('plugin_name', '')} {self.fields.get('sensor_name', '')}".lower()
        return next((size for name, size in _SENSORS.items() if name in names), None)


def parse(data: bytes) -> Header:
    """Parse the header at the beginning of a file's bytes. Lines other than ``% key value`` are skipped."""
    fields: dict[str, str] = {}
    offsets: dict[str, int] = {}
    at = 0
    while line := _LINE.match(data, at):
        key, _, value = line.group()[1:].decode("latin-1").strip().partition(" ")
        if key:
            fields[key.lower()], offsets[key.lower()] = value.strip(), at
        at = line.end()
        if key.lower() == "end":
            return Header(fields, offsets, at)
    return Header(fields, offsets, at, at if _BEGUN.match(data, at) else None)


def read_header(source: Source) -> Header:
    """Read the header of a file. A file without a header gives a `Header` of length 0.

    Raises:
        Damage: the file ends within a line.
    """
    count = HEAD
    header = parse(data := source.head(count))
    while header.cut is not None and len(data) == count < LONGEST:
        count *= 4
        header = parse(data := source.head(count))
    if header.cut is not None:
        raise Damage("the file ends within a line of its header", header.cut)
    return header


def header_text(lines: Iterable[tuple[str, str]]) -> bytes:
    """Format the lines of a header."""
    return "".join(f"% {key} {value}".rstrip() + "\n" for key, value in lines).encode("ascii")


def raw_text(version: str, size: Size | None) -> bytes:
    """Return the header of a RAW file of version ``2.0`` or ``3.0``. The size is None for a recording without parts."""
    coding = _CODINGS[version]
    if size is None:
        return header_text([("evt", version), ("format", coding), ("end", "")])
    width, height = size
    return header_text(
        [
            ("evt", version),
            ("format", f"{coding};height={height};width={width}"),
            ("geometry", f"{width}x{height}"),
            ("end", ""),
        ]
    )


WORD = 8
KINDS = (0x00, 0x0C)
"""Kinds of pixel events."""

LIMITS = Limits(PERIOD, 1 << 14)


def _layout(x: Field, y: Field, p: Field, none: int) -> Layout:
    return Layout(WORD, Field(0, 32), x, y, p, Odd(none, byte=4), none=none, rule=WRAPS, group=1024)


_LAYOUTS = {
    1: _layout(Field(0, 9, 4), Field(9, 8, 4), Field(17, 1, 4), none=0),
    2: _layout(Field(0, 14, 4), Field(14, 14, 4), Field(28, 1, 4), none=0xE0000000),
}


class Dat(SeekingReader):
    """A reader of DAT files. ``metadata`` has ``version``, ``event_type`` and the lines of the ``header``."""

    word_noun = "events"

    def __init__(self, source: Source) -> None:
        self.source = source
        header = read_header(source)
        kind = source.head(header.length + 2)[header.length :]
        if not header.length:
            raise Damage(f"begins with {source.head(12)!r}, expected a header of lines that begin with '%'", 0)
        if header.coding is not None:
            raise header.damage(
                "format" if "format" in header.fields else "evt", "none in a DAT file; RAW files have one"
            )
        if len(kind) < 2:
            raise Damage("the file ends before the kind and the size of its events", header.length)
        if kind[0] not in KINDS or kind[1] != WORD:
            expected = "expected kind 0x00 or 0x0c (pixel events) and 8 bytes"
            raise Damage(f"events of kind 0x{kind[0]:02x} and {kind[1]} bytes, {expected}", header.length)
        self.start = header.length + 2
        version = _version(header, kind[0])
        self.layout = _LAYOUTS[version]
        self.sensor_size = header.sensor_size()
        self.metadata = {"version": version, "event_type": kind[0], "header": dict(header.fields)}

    def clocks(self, step: int) -> Iterator[tuple[int, int]]:
        """Return the first byte and a time of each block; see `SeekingReader`."""
        samples = self.source.samples(self.start, step, 4)
        return ((place, int(data.view("<u4")[0])) for place, data in samples if data.size == 4)

    def stop_reason(self, rest: Bytes) -> str:
        """Return the fault at which the decoder stopped; see `WordReader`."""
        address = int(rest[4:8].view("<u4")[0])
        return f"address 0x{address:08x} has bits above the polarity, expected none"


def _version(header: Header, kind: int) -> int:
    version = header.fields.get("version")
    if version is None:
        return 2 if kind == 0x0C else 1
    if version not in ("0", "1", "2"):
        raise header.damage("version", "0, 1 or 2")
    return max(int(version), 1)


def _text(size: tuple[int, int] | None) -> bytes:
    sides = [] if size is None else [("Height", str(size[1])), ("Width", str(size[0]))]
    return header_text([("Data", "file containing CD events."), ("Version", "2"), *sides]) + bytes([0x0C, WORD])


def _knows(head: bytes) -> bool:
    header = parse(head)
    return header.coding is None and ("version" in header.fields or "file containing" in header.fields.get("data", ""))


DAT = Format(
    "dat", "Prophesee DAT", (".dat",), _knows, Dat, layout_writer(_text, _LAYOUTS[2], LIMITS),
    holds=LIMITS.holds, grows=True, usual=ATIS, larger=(GEN3, GEN4),
)  # fmt: skip
"""DAT, read and written. Files are written as version 2, kind 0x0C, with the sensor in the header, without metadata."""
