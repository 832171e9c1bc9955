"""Seeing a recording grow: events go in part after part, and what they show comes out whenever it is asked for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from neuro.events import Events
from neuro_recognise.shown import Evidence


class Observer(ABC):
    """Sees one recording grow."""

    @abstractmethod
    def add(self, events: Events) -> None:
        """Take in the next events."""

    @abstractmethod
    def evidence(self) -> Evidence:
        """What `Method.observe` gives of all events so far, to the bit.

        Raises:
            ModelError: they do not fit the method.
        """


class Whole(Observer):
    """Keeps the events and observes all of them anew: right for every method.

    Args:
        observe: `Method.observe`.
        size: of the field, for a recording without events.
    """

    def __init__(self, observe: Callable[[Events], Evidence], size: tuple[int, int]) -> None:
        self._observe, self._size = observe, size
        self._parts: list[Events] = []

    def add(self, events: Events) -> None:
        """Keep the next events."""
        if len(events):
            self._parts.append(events)

    def evidence(self) -> Evidence:
        """Observe what was kept."""
        seen = _joined(self._parts, self._size)
        self._parts = [seen] if len(seen) else []
        return self._observe(seen)


class Field(Protocol):
    """A part of the sensor that is looked at: every `Method`."""

    def within(self, events: Events) -> Events:
        """The events inside of it."""

    def check_outside(self, outside: int, total: int) -> None:
        """Refuse a recording of which too much lies outside."""


class Grows(Protocol):
    """A description that grows event by event."""

    def add(self, events: Events) -> None:
        """Take in the next events."""

    def histograms(self) -> npt.NDArray[np.floating]:
        """The description of all events so far."""


class Growing(Observer):
    """Sees by a description that grows, so that a moment costs what came since the last, not all that came.

    Args:
        field: what is looked at.
        description: without events yet; its values are the evidence "vector".
    """

    def __init__(self, field: Field, description: Grows) -> None:
        self._field, self._description = field, description
        self._outside = self._total = 0

    def add(self, events: Events) -> None:
        """Describe the next events."""
        within = self._field.within(events)
        self._total += len(events)
        self._outside += len(events) - len(within)
        self._description.add(within)

    def evidence(self) -> Evidence:
        """The description as a vector."""
        self._field.check_outside(self._outside, self._total)
        return {"vector": self._description.histograms().ravel().astype(np.float32)}


def _joined(parts: list[Events], size: tuple[int, int]) -> Events:
    """Parts of one recording as one; of none an empty one of this size."""
    if len(parts) == 1:
        return parts[0]
    kinds = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}
    empty = {name: np.zeros(0, kind) for name, kind in kinds.items()}
    arrays = [np.concatenate([empty[name], *(getattr(part, name) for part in parts)]) for name in kinds]
    return Events(arrays[0], arrays[1], arrays[2], arrays[3], parts[0].sensor_size if parts else size)
