"""A recording that is a file, or lies in one, of a folder or zip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from neuro.events._events import Events
from neuro.events.files import load
from neuro.events.opening import opened
from neuro.events.source import WHOLE


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording that can be loaded.

    Attributes:
        name: path inside the folder or zip, with ``/``; of a part of a file, with ``#`` and its number.
        path: the folder or zip with the name behind it, for messages.
        label: index of its class in `Recordings.classes`; `neuro.events.dataset.UNKNOWN`, -1, where nothing tells it.
        read: gives the bytes of the file.
        span_us: of a file with several recordings, the first us of this one and the one after its last.
        sensor_size: width and height that its data set is known for, px.
    """

    name: str
    path: str
    label: int
    read: Callable[[], bytes]
    span_us: tuple[int, int] | None = None
    sensor_size: tuple[int, int] | None = None

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""
        size = sensor_size or self.sensor_size
        events = load(self.read(), name=self.path, sensor_size=size, sort=sort, strict=strict)
        return events if self.span_us is None else events.between(*self.span_us)

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, px, and whether data set, file or format tell them; if not, they are those that hold all.

        Raises:
            EventFileError: the file is damaged.
        """
        if self.sensor_size is not None:
            return self.sensor_size, True
        with opened(self.read(), None, self.path) as file:
            if told := file.sensor_size:
                return told, True
            size = file.scanned(WHOLE)
            return size, size in (file.format.usual, *file.format.larger)
