"""Curves along time: rates of populations, and what probes recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.files.results import Results, Trace, Train
from neuro.pages import html
from neuro.pages.html import Html, tag
from neuro.pages.raster import evenly
from neuro.program.program import Floats

WIDTH, HEIGHT = 330.0, 130.0
_TOP, _FLOOR = 18.0, 104.0
MOST = 60
MOST_NEURONS = 4
BINS = 150
_POINTS = 300


def rates(results: Results) -> Html:
    """The rate of a neuron of each population whose spikes were kept, along time."""
    shown = [name for name, train in results.populations.items() if train.times_ms.size]
    drawn = [_rate(name, results.populations[name], results) for name in shown[:MOST]]
    return _grid(drawn, len(shown), "populations")


def _rate(name: str, train: Train, results: Results) -> Html:
    step, last = results.about["resolution_ms"], results.duration_ms
    width = max(1, round(last / step / BINS)) * step
    edges = np.append(np.arange(0.0, last - step / 2, width), last)
    counts, _ = np.histogram(train.times_ms, edges, weights=train.multiplicity)
    hz = counts / (train.size * np.diff(edges) / 1000.0)
    picture = curves(edges[:-1] + np.diff(edges) / 2, [hz], 0.0, last, "Hz", f"rate of {name}")
    return html.figure(picture, f"bins of {width:g} ms", name)


def traces(results: Results) -> Html:
    """What each probe of a state recorded."""
    parts = list(results.traces.items())
    return _grid([_trace(name, trace, results.duration_ms) for name, trace in parts[:MOST]], len(parts), "traces")


def _trace(name: str, trace: Trace, last: float) -> Html:
    neurons = trace.values.shape[1]
    chosen = evenly(neurons, MOST_NEURONS)
    each = [np.asarray(trace.values[:, column]) for column in chosen]
    picture = curves(trace.times_ms, each, None, last, trace.unit, f"{trace.state} of {trace.population}")
    told = f"{trace.state} of {chosen.size} of {neurons:,} neurons" if chosen.size < neurons else trace.state
    return html.figure(picture, f"{told} of {trace.population}", name)


def _grid(drawn: Sequence[Html], there: int, what: str) -> Html:
    left_out = tag("p", f"{there - len(drawn)} more {what} are not drawn.") if there > len(drawn) else None
    return html.join([tag("div", *drawn, class_="grid"), left_out])


def curves(x: Floats, each: Sequence[Floats], least: float | None, last: float, unit: str, label: str) -> Html:
    """Lines along time, from 0 to `last` ms.

    Args:
        x: times of all lines, in ms.
        each: values of each line; what is not finite is left out.
        least: the lowest value of the axis; the lowest of all values if None.
        last: the end of the time axis.
        unit: of the values.
        label: for those who cannot see it.
    """
    there = np.concatenate([y[np.isfinite(y)] for y in each]) if each else np.zeros(0)
    low = float(there.min(initial=np.inf)) if least is None and there.size else least or 0.0
    high = float(there.max(initial=low)) if there.size else low
    flat = not high > low
    across = WIDTH / last
    down = 0.0 if flat else (_FLOOR - _TOP) / (high - low)
    lines = []
    for index, y in enumerate(each):
        points = _path(x * across, (_FLOOR + _TOP) / 2 + 0.0 * y if flat else _FLOOR - (y - low) * down)
        lines.append(tag("path", d=points, class_=f"curve chip{index}"))
    ends = [html.text(0.0, HEIGHT - 10, "0", "tick"), html.text(WIDTH, HEIGHT - 10, f"{last:g} ms", "tick", "end")]
    ends += [html.text(0.0, _TOP - 6, f"{high:.4g} {unit}".rstrip(), "tick")]
    if not flat:
        ends.append(html.text(WIDTH / 2, HEIGHT - 10, f"lowest {low:.4g} {unit}".rstrip(), "tick", "middle"))
    return html.svg(WIDTH, HEIGHT, html.line(0.0, _FLOOR, WIDTH, _FLOOR, "axis"), *lines, *ends, label=label)


def _path(x: Floats, y: Floats) -> str:
    """A line; of more points than there is room for, the lowest and the highest of each stretch."""
    keep = np.isfinite(y)
    x, y = x[keep], y[keep]
    if y.size > 2 * _POINTS:
        parts = np.array_split(np.arange(y.size), _POINTS)
        at = np.array([sorted((part[y[part].argmin()], part[y[part].argmax()])) for part in parts]).ravel()
        x, y = x[at], y[at]
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)) if y.size else ""
