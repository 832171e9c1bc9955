"""Findings of a diagnosis, each with its evidence and a remedy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from neuro.apps import Where
from neuro.extend import Population, Program, Projection, Signal, Trials

SEVERITIES = ("fault", "warning", "note")
"""Severities: a fault keeps the network from its purpose, a warning is probably a mistake, a note is information."""

_FIELDS = ("name", "severity", "what", "where", "evidence", "remedy")


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem of a network.

    Attributes:
        name: short name of the symptom, e.g. "silent".
        severity: one of `SEVERITIES`.
        what: the part of the network, e.g. "population 'exc'".
        where: position of the part in the description, if known.
        evidence: the observation, with numbers and units.
        remedy: the action that mends the problem.
        shows: names of the populations whose spikes are evidence.
    """

    name: str
    severity: str
    what: str
    where: Where | None
    evidence: str
    remedy: str
    shows: tuple[str, ...] = ()

    def __str__(self) -> str:
        position = f"{self.where}: " if self.where else ""
        return f"{self.severity} {self.name}: {position}{self.what}\n  found: {self.evidence}\n  remedy: {self.remedy}"

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as plain data for JSON; an unknown place is None."""
        place = str(self.where) if self.where else None
        return {word: place if word == "where" else getattr(self, word) for word in _FIELDS}


Of = Population | Projection | Signal | Trials | Program
"""Parts of a network that a finding can be about."""


def figure(value: float) -> str:
    """Format a number > 0 with two digits for remedies, e.g. 0.034 or 1,200."""
    return f"{value:,.0f}" if 100.0 <= value < 1e6 else f"{value:.2g}"


def fault(name: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """Return a finding of severity "fault", see `finding`."""
    return finding(name, "fault", of, evidence, remedy, *shows)


def warning(name: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """Return a finding of severity "warning", see `finding`."""
    return finding(name, "warning", of, evidence, remedy, *shows)


def note(name: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """Return a finding of severity "note", see `finding`."""
    return finding(name, "note", of, evidence, remedy, *shows)


def finding(name: str, severity: str, of: Of, evidence: str, remedy: str, *shows: str) -> Finding:
    """Return a finding about a part of a program; `shows` names the populations whose spikes are evidence."""
    word = type(of).__name__.lower()
    subject = word if isinstance(of, Trials) else f"{'network' if isinstance(of, Program) else word} '{of.name}'"
    return Finding(name, severity, subject, getattr(of, "origin", None), evidence, remedy, shows)
