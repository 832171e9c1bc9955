"""The diagnosis of a network, as text and as a web page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import neuro
from neuro.apps import histograms, html, raster, sealed, some, tables
from neuro_doctor.findings import SEVERITIES, Finding
from neuro_doctor.observing import Observation
from neuro_doctor.wiring import has_threshold

PAGE = sealed("a page of 'neuro doctor'", '<meta name="generator" content="neuro doctor">', "<!-- digest {} -->")
WIDE, TALL, TOP, LEFT = 900, 110, 12, 110
"""Right, lower, upper and left edge of the curve in a drawing of potentials, px."""
_HEADS = ("severity", "finding", "of", "place")


def page(network: str, lead: str, findings: Sequence[Finding], run: Observation | None) -> str:
    """Return the page as HTML text.

    Args:
        network: name of the network.
        lead: summary of the findings and of the run.
        findings: the findings.
        run: record of the run, None if nothing ran.
    """
    parts = (
        html.tag("header", html.tag("h1", network), html.tag("p", lead, class_="lead")),
        html.table(_HEADS, [(e.severity, e.name, e.what, e.where or "-") for e in findings]) if findings else None,
        *(part for finding in findings for part in _finding(finding, run)),
        *(() if run is None else _run(run)),
        html.tag("footer", f"Written by neuro {neuro.__version__} (neuro doctor)."),
    )
    return html.page("neuro doctor", f"{network}: a diagnosis", parts, raster.script())


def _finding(finding: Finding, run: Observation | None) -> Iterator[html.Html]:
    yield html.tag("h2", f"{finding.severity.capitalize()}: {finding.name}")
    yield html.tag("p", html.tag("b", finding.what), f" {finding.where}" if finding.where else None)
    yield html.tag("p", finding.evidence)
    yield html.tag("p", html.tag("b", "Remedy: "), finding.remedy)
    if run is None or finding.severity == SEVERITIES[-1]:
        return
    evidence = [k for k, p in enumerate(run.program.populations) if p.name in finding.shows]
    yield from _raster(run, evidence)
    yield from (_potential(run, k) for k in evidence if has_threshold(run.program.populations[k]))
    for q, record in run.learning.items():
        name = run.program.projections[q].name
        if finding.what == f"projection '{name}'":
            weights = histograms.histogram(name, "", {"first": record.first, "last": record.last})
            yield histograms.drawings([weights], {"first": "at the beginning", "last": "at the end"})


def _potential(run: Observation, k: int) -> html.Html:
    """Draw the largest V_m of the sampled neurons over time, with the threshold."""
    part, v = run.program.populations[k], run.populations[k].potentials.max(axis=1)
    threshold = float(part.parameters["V_th"][0])
    low, high = min(float(v.min()), threshold), max(float(v.max()), threshold)
    x = LEFT + (WIDE - LEFT) * np.arange(1, v.size + 1) / v.size
    y = TALL - (TALL - TOP) * (np.append(v, threshold) - low) / max(high - low, 1e-12)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=False))
    drawing = html.svg(
        WIDE,
        TALL + 20,
        html.line(LEFT, float(y[-1]), WIDE, float(y[-1]), "rule"),
        html.text(LEFT - 6, float(y[-1]) + 4, f"V_th {threshold:g} mV", "quiet", "end"),
        html.text(LEFT - 6, float(y[0]) + 4, f"{v[0]:.4g} mV", "quiet", "end") if abs(y[0] - y[-1]) > 12 else None,
        html.text(WIDE, TALL + 16, f"{run.ms:g} ms", "quiet", "end"),
        html.tag("polyline", points=points, class_="curve chip0"),
        label=f"largest V_m of {part.name}",
    )
    return html.figure(drawing, f"The largest V_m of {run.populations[k].ids.size:,} neurons of {part.name}.")


def _run(run: Observation) -> Iterator[html.Html]:
    yield html.tag("h2", "The run")
    populations = run.program.populations
    rows = [
        (p.name, p.model_name, f"{p.size:,}", f"{int(run.populations[k].spikes.sum()):,}", f"{run.rate(k):.3g}")
        for k, p in enumerate(populations)
        if p.kind != "current"
    ]
    yield html.table(("population", "model", ">neurons", ">spikes", ">rate Hz"), rows)
    yield from _raster(run, [k for k, p in enumerate(populations) if p.records and p.kind != "current"][:50])


def _raster(run: Observation, indices: list[int]) -> Iterator[html.Html]:
    """Draw the spikes of the sampled neurons of some populations."""
    strips = []
    for k in indices:
        s, part = run.populations[k], run.program.populations[k]
        if not part.records:
            continue
        window = raster.Window(s.ids, run.steps + 1, part.size)
        subtitle = f"{run.rate(k):.3g} Hz, {window.described(run.ms, run.program.resolution)}"
        keys = window.keys(s.steps, s.ids[s.rows]) if s.steps.size else np.zeros(0, dtype=np.int64)
        strips.append(raster.Strip(part.name, subtitle, window, {"spike": keys}))
    if strips:
        names = ", ".join(strip.name for strip in strips)
        drawing = raster.raster(strips, run.ms, run.program.resolution, label=f"raster of {names}", tallest=100)
        yield html.figure(drawing, "Each row is a neuron, the first at the bottom.", class_="raster")


MOST_ALIKE = 4
"""Largest number of findings with the same name that are printed in full."""
COLUMNS = (*_HEADS, "found", "remedy")


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """All findings about a network, faults first; iterable.

    Attributes:
        network: name of the network.
        findings: the findings.
        about: one sentence about the short run.
        observation: record of the run, None if nothing ran.
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
        return tuple(finding for finding in self.findings if finding.severity == "fault")

    @property
    def verdict(self) -> str:
        """Number of findings of each severity, e.g. "net: 1 fault, 2 notes"."""
        counts = [(sum(finding.severity == word for finding in self.findings), word) for word in SEVERITIES]
        return f"{self.network}: {', '.join(some(n, word) for n, word in counts if n) or 'nothing is wrong'}"

    def __str__(self) -> str:
        return "\n".join([*self._lines(), self.about, self.verdict])

    def _lines(self) -> Iterator[str]:
        """Yield the first findings of each name in full, and one line with the parts of the others."""
        groups: dict[tuple[str, str], list[Finding]] = {}
        for finding in self.findings:
            groups.setdefault((finding.severity, finding.name), []).append(finding)
        for group in groups.values():
            yield from map(str, group[:MOST_ALIKE])
            if similar := group[MOST_ALIKE:]:
                names = ", ".join(finding.what for finding in similar[:MOST_ALIKE])
                yield f"  the same for {names}{', ...' * (len(similar) > MOST_ALIKE)} ({len(similar)} more)"

    def _repr_html_(self) -> str:
        rows = tuple((e.severity, e.name, e.what, str(e.where or ""), e.evidence, e.remedy) for e in self)
        return tables.as_html(self.verdict, [tables.Table(self.about, COLUMNS, rows)])

    def as_dict(self) -> dict[str, Any]:
        """Return the diagnosis as plain data for JSON."""
        return {
            "network": self.network,
            "about": self.about,
            "faults": len(self.faults),
            "findings": [finding.as_dict() for finding in self.findings],
        }

    def page(self) -> str:
        """Return a web page with the findings and the spikes that are their evidence, as HTML text."""
        return page(self.network, f"{self.verdict}. {self.about}", self.findings, self.observation)


def sort_findings(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by severity; of several with the same name about the same part, only the first remains."""
    first: dict[tuple[str, str], Finding] = {}
    for finding in findings:
        first.setdefault((finding.name, finding.what), finding)
    return tuple(sorted(first.values(), key=lambda finding: SEVERITIES.index(finding.severity)))
