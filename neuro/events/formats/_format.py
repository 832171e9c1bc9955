"""What a file format is to the rest of the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events


class Damage(ValueError):
    """Raised by a reader: ``what`` is wrong at byte ``offset`` of the data."""

    def __init__(self, what: str, offset: int) -> None:
        super().__init__(what, offset)
        self.what = what
        self.offset = offset


class Unsavable(ValueError):
    """Raised by a writer: the format has no room for event ``event``, because of ``what``."""

    def __init__(self, what: str, event: int) -> None:
        super().__init__(what, event)
        self.what = what
        self.event = event


@dataclass(frozen=True, slots=True)
class Decoded:
    """What a reader found, not yet checked against the sensor.

    Attributes:
        t: (n,) int64, us, in the file's order.
        x: (n,) column, px.
        y: (n,) row, px.
        p: (n,) 1 = ON.
        sensor_size: width and height, px.
        offsets: (n,) int64, the byte at which each event begins.
        metadata: what the file says of itself.
    """

    t: npt.NDArray[np.int64]
    x: npt.NDArray[Any]
    y: npt.NDArray[Any]
    p: npt.NDArray[Any]
    sensor_size: tuple[int, int]
    offsets: npt.NDArray[np.int64]
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Format:
    """A file format.

    Attributes:
        name: the word that ``load(..., format=name)`` takes.
        title: what to call it in a message.
        suffixes: endings of file names, lower case, with the dot.
        magic: how such a file begins; empty where it has no signature.
        read: from a file's bytes and the sensor size that the user asked for, or None; raises `Damage`.
        write: to a file's bytes; raises `Unsavable`. None where the format is only read.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    magic: bytes
    read: Callable[[bytes, tuple[int, int] | None], Decoded]
    write: Callable[[Events], bytes] | None = None
