"""Base and registry of the sources of signals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.choice import Choice
from neuro.core.own_parts import check_method
from neuro.core.quantities import Value
from neuro.core.registry import Registry


@dataclass(frozen=True, kw_only=True, eq=False)
class Source(Choice):
    """Base of the sources that set a signal while a network runs."""

    kind: ClassVar[str] = "source"

    def stands_for(self) -> Value | Source:
        """Return an equivalent of the source: a number, an array, or a source of this package."""
        raise NotImplementedError


SOURCES: Registry[type[Source]] = Registry(
    "source",
    dict.fromkeys(("schedule", "computed", "population", "like"), "neuro.model.sources"),
    takes=lambda part: isinstance(part, type) and issubclass(part, Source),
    group="neuro.sources",
    complete=lambda part: check_method(part, Source, "stands_for", "returns an equivalent source"),
)
"""All sources of signals by name."""
