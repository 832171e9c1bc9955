"""What `neuro events info` tells of Event Stream files of the generic type: times with bytes, and no sensor."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from neuro.events.source import Given

SHOWN = 40
"""Bytes of the first event that are shown."""
HEAD = 16
"""Bytes that tell the type."""


def begins_generic(source: Given) -> bool:
    """Whether a path or standard input is such a file; what is looked at is not used up."""
    from neuro.events.formats.event_stream import is_generic

    if not isinstance(source, str | os.PathLike):
        peek = getattr(source, "peek", None)
        return peek is not None and is_generic(peek(HEAD)[:HEAD])
    try:
        with Path(source).open("rb") as file:
            return is_generic(file.read(HEAD))
    except OSError:
        return False


def of_generic(source: Given, name: str) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Counts, times and sizes, for JSON and as rows.

    Args:
        source: a path or standard input.
        name: what to call it.
    """
    from neuro.events.errors import EventFileWarning
    from neuro.events.formats.event_stream import generic

    with warnings.catch_warnings(record=True) as damage:
        warnings.simplefilter("always", EventFileWarning)
        events = generic(source, name=name, strict=False)
    sizes = [len(content) for _, content in events]
    start, stop = (events[0][0], events[-1][0]) if events else (None, None)
    told: dict[str, Any] = {
        "path": name, "format": "event_stream", "type": "generic", "events": len(events), "start_us": start,
        "stop_us": stop, "smallest_bytes": min(sizes, default=None), "largest_bytes": max(sizes, default=None),
        "total_bytes": sum(sizes), "damage": [str(one.message).removeprefix(f"{name}: ") for one in damage],
    }  # fmt: skip
    rows = [("file", name), ("format", "Event Stream, generic: times with bytes, no pixels")]
    rows.append(("events", f"{len(events):,}"))
    if events:
        seconds = f"{(events[-1][0] - events[0][0]) / 1e6:,.6f}".rstrip("0").rstrip(".")
        rows.append(("time", f"{start} to {stop} us, {seconds} s"))
        rows.append(("bytes", f"{min(sizes):,} to {max(sizes):,} an event, {sum(sizes):,} in all"))
        rows.append(("first", _shown(events[0][1])))
    return told, rows + [("damage", text) for text in told["damage"]]


def _shown(content: bytes) -> str:
    """Text where it is, else hexadecimal; the beginning of much."""
    more = " ..." if len(content) > SHOWN else ""
    text = content[:SHOWN].decode("utf-8", "replace")
    return (repr(text) if text.isprintable() and "\ufffd" not in text else content[:SHOWN].hex(" ")) + more
