"""What is done to events before anything looks at them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from neuro.apps import Part, Registry, setting
from neuro.events import Events, filters


@dataclass(frozen=True)
class Cleaner(Part):
    """Base of the cleaners."""

    kind = "cleaner"

    @abstractmethod
    def begun(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """A function that takes a recording part after part and gives what is left of each part."""

    def clean(self, events: Events) -> Events:
        """The events of a recording that are left."""
        return self.begun(events.sensor_size)(events)


@dataclass(frozen=True)
class Plain(Cleaner):
    """All events stay."""

    source = "what all methods but those with a filter do"

    def begun(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Each part as it is."""
        return lambda events: events


@dataclass(frozen=True)
class Tar(Cleaner):
    """Events of temporal active regions stay."""

    source = "thesis appendix B, algorithm 14"

    tau: float = setting(0.08, "s", "decay of activity", "thesis figure 85", above=0)
    theta: float = setting(2.4, "events", "activity that must be exceeded", "thesis figure 85", above=0)
    radius: int = setting(1, "px", "of the neighbourhood", "thesis figure 85", at_least=0)

    def begun(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Those whose surroundings were active shortly before."""
        return filters.TAR(sensor_size, tau=self.tau, theta=self.theta, radius=self.radius)


Cleaner.known = Registry("cleaner", (Plain, Tar))
