"""All findings about a network."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from neuro.core.english import some
from neuro.core.tables import Table, as_html
from neuro.diagnosis.findings import SEVERITIES, Finding
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.page import page

MOST_ALIKE = 4
"""Findings of one name that are printed in full."""
COLUMNS = ("severity", "finding", "of", "place", "found", "remedy")


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """All findings about a network, faults first; iterable.

    Attributes:
        network: its name.
        findings: what was found.
        about: how the short run went, in a sentence.
        observation: what was seen of the run, None where nothing ran.
    """

    network: str
    findings: tuple[Finding, ...]
    about: str
    observation: Observation | None = None

    def __iter__(self) -> Iterator[Finding]:
        return iter(self.findings)

    def __len__(self) -> int:
        return len(self.findings)

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The findings that are faults."""
        return tuple(each for each in self.findings if each.severity == "fault")

    @property
    def verdict(self) -> str:
        """How many findings of each severity, in a line."""
        counts = [(sum(each.severity == word for each in self.findings), word) for word in SEVERITIES]
        return f"{self.network}: {', '.join(some(n, word) for n, word in counts if n) or 'nothing is wrong'}"

    def __str__(self) -> str:
        return "\n".join([*self._lines(), self.about, self.verdict])

    def _lines(self) -> Iterator[str]:
        """The first findings of each name, and of which parts there are more."""
        by_name: dict[tuple[str, str], list[Finding]] = {}
        for each in self.findings:
            by_name.setdefault((each.severity, each.name), []).append(each)
        for alike in by_name.values():
            yield from map(str, alike[:MOST_ALIKE])
            if more := alike[MOST_ALIKE:]:
                names = ", ".join(each.what for each in more[:MOST_ALIKE])
                yield f"  likewise {names}{', ...' * (len(more) > MOST_ALIKE)} ({len(more)} more)"

    def _repr_html_(self) -> str:
        rows = tuple((e.severity, e.name, e.what, str(e.where or ""), e.evidence, e.remedy) for e in self)
        return as_html(self.verdict, [Table(self.about, COLUMNS, rows)])

    def as_dict(self) -> dict[str, Any]:
        """The diagnosis for JSON."""
        return {
            "network": self.network,
            "about": self.about,
            "faults": len(self.faults),
            "findings": [each.as_dict() for each in self.findings],
        }

    def page(self) -> str:
        """A page with the findings and the spikes that are their evidence, as HTML text."""
        return page(self.network, f"{self.verdict}. {self.about}", self.findings, self.observation)


def ordered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings by severity, else as they come; of those of one name about one part the first."""
    first: dict[tuple[str, str], Finding] = {}
    for each in findings:
        first.setdefault((each.name, each.what), each)
    return tuple(sorted(first.values(), key=lambda each: SEVERITIES.index(each.severity)))
