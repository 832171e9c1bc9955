"""What a diagnosis consists of: findings, each with its evidence and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from neuro.apps import Where
from neuro.extend import Population, Program, Projection, Signal, Trials

SEVERITIES = ("fault", "warning", "note")
"""A network with a fault cannot do what it is for; a warning is likely a mistake; a note is worth knowing."""

_FIELDS = ("name", "severity", "what", "where", "evidence", "remedy")


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong with a network.

    Attributes:
        name: which symptom, a short slug as `"silent"`.
        severity: one of `SEVERITIES`.
        what: the part, as "population 'exc'".
        where: its place in the description, if known.
        evidence: what was found, with numbers and units.
        remedy: what to do.
        shows: the populations whose spikes are evidence.
    """

    name: str
    severity: str
    what: str
    where: Where | None
    evidence: str
    remedy: str
    shows: tuple[str, ...] = ()

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return f"{self.severity} {self.name}: {place}{self.what}\n  found: {self.evidence}\n  remedy: {self.remedy}"

    def as_dict(self) -> dict[str, Any]:
        """The finding for JSON; `where` is null where it is not known."""
        where = str(self.where) if self.where else None
        return {word: where if word == "where" else getattr(self, word) for word in _FIELDS}


Of = Population | Projection | Signal | Trials | Program
"""What a finding may be about."""


def figure(value: float) -> str:
    """A number > 0 with two digits, for remedies."""
    return f"{value:,.0f}" if 100.0 <= value < 1e6 else f"{value:.2g}"


def fault(name: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """A finding without which a part cannot do what it is for."""
    return finding(name, "fault", of, evidence, remedy, *shows)


def warning(name: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """A finding that is likely a mistake."""
    return finding(name, "warning", of, evidence, remedy, *shows)


def note(name: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """A finding that is worth knowing."""
    return finding(name, "note", of, evidence, remedy, *shows)


def finding(name: str, severity: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """A finding about a part of a program; `shows` are the populations whose spikes are evidence."""
    word = type(of).__name__.lower()
    what = word if isinstance(of, Trials) else f"{'network' if isinstance(of, Program) else word} '{of.name}'"
    return Finding(name, severity, what, getattr(of, "origin", None), evidence, remedy, shows)
