"""What the file formats of Prophesee share: a header of lines that begin with ``%``, and what a file can hold.

A line reads ``% key value``; DAT and RAW differ in what follows the last one. A RAW header ends with the line ``% end``
(older ones without it), and tells the coding as ``% evt 3.0`` or ``% format EVT3;height=720;width=1280``; the sensor
may stand there, in ``% geometry 1280x720`` or, in DAT, in ``% Width`` and ``% Height``. Where none does, the name of
the sensor is looked for (``% plugin_name hal_plugin_gen41_evk3``).

Source: Prophesee, "RAW file format", "DAT file format" and "Data encoding formats", docs.prophesee.ai.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from neuro.events._events import Events
from neuro.events.formats._format import HEAD, Damage, Size, refuse
from neuro.events.source import Source

ATIS = (304, 240)
GEN3 = (640, 480)
GEN4 = (1280, 720)
LONGEST = 1 << 20
"""Bytes in which a header ends; longer text is none."""

_LINE = re.compile(rb"%(?:[ \t][\t\x20-\x7e\x80-\xff]*)?\r?\n")
_BEGUN = re.compile(rb"%(?:[ \t][\t\x20-\x7e\x80-\xff]*)?\r?\Z")
_SENSORS = {"genx320": (320, 320), "gen3": GEN3, "gen4": GEN4, "imx636": GEN4, "imx646": GEN4}
_CODINGS = {"2.0": "EVT2", "2.1": "EVT21", "3.0": "EVT3"}


@dataclass(frozen=True, slots=True)
class Header:
    """The lines before the words.

    Attributes:
        fields: value of each key; keys in lower case.
        offsets: byte at which the line of each key begins.
        length: byte at which what follows begins.
        cut: byte of a line that the end of the file cuts, None where there is none.
    """

    fields: Mapping[str, str]
    offsets: Mapping[str, int]
    length: int
    cut: int | None = None

    @property
    def coding(self) -> str | None:
        """``EVT3``, ``EVT2``, ``EVT21`` or another word that the file has in its place; None in no RAW header."""
        if "format" in self.fields:
            return self.fields["format"].split(";")[0].strip().upper()
        version = self.fields.get("evt")
        return None if version is None else _CODINGS.get(version, f"EVT {version}")

    @property
    def options(self) -> dict[str, str]:
        """What follows the coding: ``height=720;width=1280``."""
        parts = self.fields.get("format", "").split(";")[1:]
        return {key.strip().lower(): value.strip() for key, _, value in (part.partition("=") for part in parts)}

    def damage(self, key: str, what: str) -> Damage:
        """Of the line of a key."""
        return Damage(f"header: {key} is {self.fields[key]!r}, expected {what}", self.offsets[key])

    def sensor_size(self) -> Size | None:
        """Width and height that the header tells or its sensor has, None where neither is there.

        Raises:
            Damage: the header tells a size that is none.
        """
        options = self.options
        told = (
            ("geometry", self.fields.get("geometry", "").lower().split("x")),
            ("format", [options[side] for side in ("width", "height") if side in options]),
            ("width", [self.fields[side] for side in ("width", "height") if side in self.fields]),
        )
        for key, values in told:
            if key in self.fields and values:
                if len(values) != 2 or not all(v.isdecimal() and 1 <= int(v) <= 1 << 16 for v in values):
                    raise self.damage(key, "a width and a height of 1 to 65536 px")
                return int(values[0]), int(values[1])
        names = f"{self.fields.get('plugin_name', '')} {self.fields.get('sensor_name', '')}".lower()
        return next((size for name, size in _SENSORS.items() if name in names), None)


def parse(data: bytes) -> Header:
    """The header at the beginning of a file's bytes; lines that are no ``% key value`` are skipped."""
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
    """The header of a file; its length is 0 where there is none.

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
    """Lines of a header as a file has them."""
    return "".join(f"% {key} {value}".rstrip() + "\n" for key, value in lines).encode("ascii")


def raw_text(version: str, size: Size | None) -> bytes:
    """The header of a RAW file of version ``2.0`` or ``3.0``; without a size where no event tells one."""
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


def check_room(events: Events, done: int, times: int, side: int) -> None:
    """See that a format has room for a part of a recording.

    Args:
        events: the part.
        done: number of events before it.
        times: times from 0 up to this, us, not included, can be held.
        side: columns and rows from 0 up to this, not included, can be held.

    Raises:
        Unsavable: there is an event that cannot.
    """
    outside = (events.x >= side) | (events.y >= side)
    bad = (events.t < 0) | (events.t >= times) | outside
    refuse(events, bad, done, f"t 0 to {times - 1} us, x and y 0 to {side - 1}", outside)
