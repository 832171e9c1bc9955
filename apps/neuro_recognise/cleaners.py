"""What is done to events before anything looks at them."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from neuro.apps import Registry
from neuro.events import Events, filters
from neuro_recognise.settings import Part, setting

__all__ = ["Cleaner", "Plain", "Tar"]


@dataclass(frozen=True)
class Cleaner(Part):
    """Base of the cleaners."""

    kind = "cleaner"

    @abstractmethod
    def clean(self, events: Events) -> Events:
        """The events that are left."""


@dataclass(frozen=True)
class Plain(Cleaner):
    """All events stay."""

    source = "what all methods but those with a filter do"

    def clean(self, events: Events) -> Events:
        """The same."""
        return events


@dataclass(frozen=True)
class Tar(Cleaner):
    """Events of temporal active regions stay."""

    source = "thesis appendix B, algorithm 14"

    tau: float = setting(0.08, "s", "decay of activity", "thesis figure 85", above=0)
    theta: float = setting(2.4, "events", "activity that must be exceeded", "thesis figure 85", above=0)
    radius: int = setting(1, "px", "of the neighbourhood", "thesis figure 85", at_least=0)

    def clean(self, events: Events) -> Events:
        """Those whose surroundings were active shortly before."""
        sieve = filters.TAR(events.sensor_size, tau=self.tau, theta=self.theta, radius=self.radius)
        return sieve.apply(events)


Cleaner.known = Registry("cleaner", (Plain, Tar))
