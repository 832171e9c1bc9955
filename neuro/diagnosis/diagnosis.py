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
        return "\n".join([*map(str, self.findings), self.about, self.verdict])

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
    """Findings by severity, else as they come."""
    return tuple(sorted(findings, key=lambda each: SEVERITIES.index(each.severity)))
