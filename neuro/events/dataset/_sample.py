"""One labelled recording of a data set, wherever it lies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

from neuro.events._events import Events


class Sample(Protocol):
    """One labelled recording.

    Attributes:
        name: of the recording within its data set.
        path: the data set with the name behind it, for messages.
        label: index of its class.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def label(self) -> int: ...
    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""


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
