"""One labelled recording of a data set, wherever it lies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

from neuro.events._events import Events

UNKNOWN = -1
"""Label of a recording whose class is not known."""


class Sample(Protocol):
    """One recording.

    Attributes:
        name: of the recording within its data set.
        path: the data set with the name behind it, for messages.
        label: index of its class, `UNKNOWN` where nothing tells it.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def label(self) -> int: ...
    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""

    def read(self) -> bytes:
        """What a fingerprint is made of: the bytes of the file or, inside another file, of the events.

        Raises:
            EventFileError: they cannot be read.
        """

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, px, and whether the file or its format tells them; if not, they are those that hold all.

        Raises:
            EventFileError: the file is damaged.
        """


@dataclass(frozen=True, slots=True)
class Kept:
    """A sample whose events are kept when they were loaded."""

    sample: Sample
    _events: dict[Any, Events] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        return self.sample.name

    @property
    def path(self) -> str:
        return self.sample.path

    @property
    def label(self) -> int:
        return self.sample.label

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""
        key = sensor_size, sort, strict
        if key not in self._events:
            self._events[key] = self.sample.load(sensor_size=sensor_size, sort=sort, strict=strict)
        return self._events[key]

    def read(self) -> bytes:
        """The bytes; see `Sample`."""
        return self.sample.read()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, and whether they are told; see `Sample`."""
        return self.sample.sensor()
