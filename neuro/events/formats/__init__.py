"""The event file formats: one module each, and the table that lists them.

A new format is a module with a `Format` and its name in `FORMATS`; nothing else changes.
"""

from __future__ import annotations

from neuro.events.formats._format import HEAD, Damage, Format, Piece, Reader, Unsavable
from neuro.events.formats.aedat2 import AEDAT2
from neuro.events.formats.aedat3 import AEDAT3
from neuro.events.formats.aedat4 import AEDAT4
from neuro.events.formats.event_stream import EVENT_STREAM
from neuro.events.formats.nmnist import NMNIST
from neuro.events.formats.npz import NPZ

FORMATS: tuple[Format, ...] = (NPZ, AEDAT4, AEDAT2, AEDAT3, EVENT_STREAM, NMNIST)
"""All formats, those with a signature in the file first."""

__all__ = ["FORMATS", "HEAD", "Damage", "Format", "Piece", "Reader", "Unsavable"]
