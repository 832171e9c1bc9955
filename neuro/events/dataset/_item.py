"""A recording as a layout finds it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Item:
    """A recording in a folder or zip.

    Attributes:
        name: of the recording.
        file: in which it lies.
        label: name of its class.
        span_us: its first us and the one after its last; None: the whole file.
        part: to which it belongs, in lower case, where a list tells it.
    """

    name: str
    file: str
    label: str
    span_us: tuple[int, int] | None = None
    part: str = ""
