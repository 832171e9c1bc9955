"""Event file formats: one module per format, and the registry of all formats."""

from __future__ import annotations

from collections.abc import Iterator

from neuro.apps import Registry
from neuro_events.formats._format import (
    HEAD,
    Damage,
    Format,
    Found,
    Piece,
    Reader,
    Seeker,
    Sized,
    Unsavable,
    called,
    complete,
    held,
    in_order,
    refuse,
)
from neuro_events.formats.aedat import AEDAT2, AEDAT3
from neuro_events.formats.aedat4 import AEDAT4
from neuro_events.formats.dat import DAT
from neuro_events.formats.event_stream import EVENT_STREAM, NMNIST
from neuro_events.formats.evt import EVT2, EVT3, EVT21, RAW
from neuro_events.formats.hdf5 import HDF5
from neuro_events.formats.mat import MAT
from neuro_events.formats.npz import NPZ
from neuro_events.formats.rosbag import ROS1, ROS2
from neuro_events.formats.table import TABLE, TXT

SIGNED = (ROS1, ROS2, MAT, HDF5, NPZ, AEDAT4, AEDAT2, AEDAT3, EVENT_STREAM, DAT)
"""Formats with a signature in the file. Detection tries these first."""
OTHERS = (RAW, EVT3, EVT2, EVT21, NMNIST, TABLE, TXT)

FORMATS: Registry[Format] = Registry(
    "event format",
    (*SIGNED, *OTHERS),
    takes=lambda part: isinstance(part, Format),
    group="neuro.formats",
    name=lambda part: str(part.name),
    complete=complete,
)
"""Formats by name."""


def written() -> Iterator[Format]:
    """Return the formats that can be written."""
    return (f for f in FORMATS.values() if f.write)


__all__ = [
    "FORMATS",
    "HEAD",
    "Damage",
    "Format",
    "Found",
    "Piece",
    "Reader",
    "Seeker",
    "Sized",
    "Unsavable",
    "called",
    "held",
    "in_order",
    "refuse",
    "written",
]
