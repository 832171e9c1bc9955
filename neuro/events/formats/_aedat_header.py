"""The lines of text with which AEDAT files begin."""

from __future__ import annotations

import re

from neuro.events.formats._format import Damage
from neuro.events.source import Source

STEP = 1 << 16
"""Bytes first looked at; doubled until the header ends."""

_LINE = re.compile(rb"#[\t\x20-\x7e\x80-\xff]*\r?\n")
_BEGUN = re.compile(rb"(#[\t\x20-\x7e\x80-\xff]*\r?)?")


def header(source: Source, magic: bytes, last: bytes) -> tuple[bytes, bool]:
    """All lines before the data.

    Data may begin with the byte of ``#``, but a line of text has no control bytes.

    Args:
        source: the file.
        magic: how the first line begins.
        last: how the line begins that ends the header.

    Returns:
        The lines, and whether the one that ends the header was there.

    Raises:
        Damage: the first line is another or does not end.
    """
    begins = source.head(len(magic))
    if begins != magic:
        raise Damage(f"begins with {begins!r}, expected the line {magic.decode()}", 0)
    count = STEP
    while True:
        text = source.head(count)
        ended, length = _lines(text, last)
        if ended or len(text) < count or not _BEGUN.fullmatch(text, length):
            break
        count *= 2
    if length == 0:
        raise Damage("the first line does not end", len(magic))
    return text[:length], ended


def _lines(text: bytes, last: bytes) -> tuple[bool, int]:
    begin = 0
    while line := _LINE.match(text, begin):
        begin = line.end()
        if line.group().startswith(last):
            return True, begin
    return False, begin
