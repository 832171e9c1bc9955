"""Rasters: of each population one strip a backend, where spikes that only one of two runs has stand out."""

from __future__ import annotations

import numpy as np

from neuro.compare.result import Comparison, Run
from neuro.core import html
from neuro.core.html import Html, tag
from neuro.pages.raster import Strip, Window, raster, window

MOST_DOTS = 40_000
MOST_DOTS_IN_ALL = 400_000
MOST_POPULATIONS = 40


def rasters(comparison: Comparison) -> Html:
    """A drawing for each population, neurons first, then input."""
    populations = comparison.first.populations
    order = sorted(populations, key=lambda name: populations[name].generator)
    shown = [name for name in order if any(run.populations[name].spikes for run in comparison.ran)]
    drawn, silent = shown[:MOST_POPULATIONS], [name for name in order if name not in shown]
    dots = min(MOST_DOTS, MOST_DOTS_IN_ALL // max(1, len(drawn) * len(comparison.ran)))
    parts: list[object] = [_raster(comparison, name, dots) for name in drawn]
    if len(shown) > len(drawn):
        parts.append(tag("p", f"{len(shown) - len(drawn)} more populations are not drawn: {MOST_POPULATIONS} are."))
    if silent:
        parts.append(tag("p", f"Silent on every backend: {', '.join(silent)}."))
    return html.join([_legend(comparison), *parts])


def _legend(comparison: Comparison) -> Html:
    first = comparison.first.backend
    told = (("same", f"as on {first}"), ("extra", f"only here, not on {first}"), ("missing", f"on {first}, not here"))
    return html.legend(*told)


def _raster(comparison: Comparison, name: str, dots: int) -> Html:
    ms, resolution = comparison.ms, comparison.resolution_ms
    trains = [(run.trains[name].steps, run.trains[name].ids) for run in comparison.ran]
    found = [run.populations[name].first for run in comparison.ran]
    also = [part.neuron for part in found if part is not None]
    part = comparison.first.populations[name]
    drawn = window(part.neurons, trains, round(ms / resolution), dots, also)
    strips = [_strip(comparison, run, name, drawn) for run in comparison.ran]
    label = f"raster of {name} on {', '.join(run.backend for run in comparison.ran)}"
    picture = raster(strips, ms, resolution, label=label, together=True)
    kind = "input, " if part.generator else ""
    return html.figure(picture, kind + drawn.told(ms, resolution), name, "raster")


def _strip(comparison: Comparison, run: Run, name: str, drawn: Window) -> Strip:
    """Spikes of one backend."""
    mine, its = (drawn.keys(train.steps, train.ids) for train in (run.trains[name], comparison.first.trains[name]))
    part = run.populations[name]
    kinds = {
        "same": np.intersect1d(mine, its),
        "missing": np.setdiff1d(its, mine),
        "extra": np.setdiff1d(mine, its),
    }
    mark = None if part.first is None or run is comparison.first else part.first.ms
    return Strip(run.backend, f"{part.rate_hz:{'.3g' if part.rate_hz < 1000 else ',.0f'}} Hz", drawn, kinds, mark)
