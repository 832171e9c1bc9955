"""A diagnosis as a page: each finding with its evidence, its remedy and the spikes that show it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from neuro.core import html
from neuro.core.html import Html, tag
from neuro.core.outputs import sealed
from neuro.core.version import VERSION
from neuro.diagnosis.findings import SEVERITIES, Finding
from neuro.diagnosis.observing import Observation
from neuro.pages import raster
from neuro.pages.raster import Strip, Window

PAGE = sealed("a page of 'neuro doctor'", '<meta name="generator" content="neuro doctor">', "<!-- digest {} -->")
COLUMNS = ("severity", "finding", "of", "place")


def page(network: str, lead: str, findings: Sequence[Finding], seen: Observation | None) -> str:
    """The page as HTML text.

    Args:
        network: its name.
        lead: what was found and how, in a line or two.
        findings: what was found.
        seen: of the run, None where nothing ran.
    """
    parts = (
        tag("header", tag("h1", network), tag("p", lead, class_="lead")),
        html.table(COLUMNS, [(e.severity, e.name, e.what, e.where or "-") for e in findings]) if findings else None,
        *(part for each in findings for part in _finding(each, seen)),
        *(() if seen is None else _run(seen)),
        tag("footer", f"Written by neuro {VERSION} (neuro doctor)."),
    )
    return html.page("neuro doctor", f"{network}: a diagnosis", parts, raster.script())


def _finding(each: Finding, seen: Observation | None) -> Iterator[Html]:
    yield tag("h2", f"{each.severity.capitalize()}: {each.name}")
    yield tag("p", tag("b", each.what), f" {each.where}" if each.where else None)
    yield tag("p", each.evidence)
    yield tag("p", tag("b", "Remedy: "), each.remedy)
    if seen is not None and each.severity != SEVERITIES[-1] and each.shows:
        yield from _raster(seen, [k for k, p in enumerate(seen.program.populations) if p.name in each.shows])


def _run(seen: Observation) -> Iterator[Html]:
    yield tag("h2", "The run")
    populations = seen.program.populations
    rows = [
        (p.name, p.said, f"{p.size:,}", f"{int(seen.populations[k].spikes.sum()):,}", f"{seen.rate(k):.3g}")
        for k, p in enumerate(populations)
        if p.kind != "current"
    ]
    yield html.table(("population", "model", ">neurons", ">spikes", ">rate Hz"), rows)
    yield from _raster(seen, [k for k, p in enumerate(populations) if p.records and p.kind != "current"][:50])


def _raster(seen: Observation, indices: list[int]) -> Iterator[Html]:
    """Strips of the neurons that were followed."""
    strips = []
    for k in indices:
        s, part = seen.populations[k], seen.program.populations[k]
        if not part.records:
            continue
        window = Window(s.ids, seen.steps + 1, part.size)
        about = f"{seen.rate(k):.3g} Hz, {window.described(seen.ms, seen.program.resolution)}"
        keys = window.keys(s.steps, s.ids[s.rows]) if s.steps.size else np.zeros(0, dtype=np.int64)
        strips.append(Strip(part.name, about, window, {"spike": keys}))
    if strips:
        names = ", ".join(strip.name for strip in strips)
        drawn = raster.raster(strips, seen.ms, seen.program.resolution, label=f"raster of {names}", tallest=100)
        yield html.figure(drawn, "Each row is a neuron, the first at the bottom.", class_="raster")
