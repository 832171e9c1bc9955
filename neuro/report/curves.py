"""Curves along time: rates of populations, and what probes recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.core import html
from neuro.core.html import Html, tag
from neuro.files.results import Results, Trace, Train
from neuro.pages.raster import evenly
from neuro.program.program import Floats

WIDTH, LANE = 330.0, 84.0
_TOP = 18.0
MOST = 60
MOST_LINES = 4
BINS = 150
_POINTS = 300


def rates(results: Results) -> Html:
    """The rate of a neuron of each population whose spikes were kept, along time."""
    shown = [name for name, train in results.populations.items() if train.times_ms.size]
    drawn = [_rate(name, results.populations[name], results) for name in shown[:MOST]]
    return _grid(drawn, len(shown), "populations")


def _rate(name: str, train: Train, results: Results) -> Html:
    step, last = results.about["resolution_ms"], end_ms(results)
    width = max(1, round(last / step / BINS)) * step
    edges = np.append(np.arange(0.0, max(last - width / 2, step / 2), width), last)
    counts, _ = np.histogram(train.times_ms, edges, weights=train.multiplicity)
    hz = counts / (train.size * np.diff(edges) / 1000.0)
    picture = curves(edges[:-1] + np.diff(edges) / 2, [hz], 0.0, last, "Hz", f"rate of {name}")
    return html.figure(picture, f"bins of {width:g} ms", name)


def traces(results: Results, of: str) -> Html:
    """What each probe recorded of a "population", or of a "projection"."""
    parts = [(name, trace) for name, trace in results.traces.items() if getattr(trace, of)]
    return _grid([_trace(name, trace, end_ms(results)) for name, trace in parts[:MOST]], len(parts), "traces")


def end_ms(results: Results) -> float:
    """How long a run was, or one step where it has just begun."""
    return max(results.duration_ms, float(results.about["resolution_ms"]))


def _trace(name: str, trace: Trace, last: float) -> Html:
    of, what = (trace.population, "neuron") if trace.population else (trace.projection, "synapse")
    x, values = _of_synapses(trace) if trace.at_pre_spikes else (trace.times_ms, trace.values)
    values = values[:, None] if values.ndim == 1 else values
    chosen = evenly(values.shape[1], MOST_LINES)
    if trace.single:
        told = f"{'mean ' * trace.mean}{trace.state} of {of}"
    else:
        told = f"{trace.state} of {chosen.size:,} of {values.shape[1]:,} {what}s of {of}"
        told += ", as pre spikes leave it" * trace.at_pre_spikes
    each = [values[:, column] for column in chosen]
    return html.figure(curves(x, each, None, last, trace.unit, told), told, name)


def _of_synapses(trace: Trace) -> tuple[Floats, Floats]:
    """What pre spikes left, a column a synapse, of as many as are drawn; not a number where it had no pre spike."""
    ends, which = np.unique(np.stack([trace.pre, trace.post]), axis=1, return_inverse=True)
    drawn = evenly(ends.shape[1], MOST_LINES)
    values = np.where(which.reshape(-1, 1) == np.arange(ends.shape[1])[None, drawn], trace.values[:, None], np.nan)
    mine = np.isfinite(values).any(axis=1)
    table = np.full((int(mine.sum()), ends.shape[1]), np.nan)
    table[:, drawn] = values[mine]
    return trace.times_ms[mine], table


def _grid(drawn: Sequence[Html], there: int, what: str) -> Html:
    left_out = tag("p", f"{there - len(drawn)} more {what} are not drawn.") if there > len(drawn) else None
    return html.join([tag("div", *drawn, class_="grid"), left_out])


def curves(x: Floats, each: Sequence[Floats], least: float | None, last: float, unit: str, label: str) -> Html:
    """Lines along time, from 0 to `last` ms, one below the other on one scale.

    Args:
        x: times of all lines, in ms.
        each: values of each line; what is not finite is left out.
        least: the lowest value of the scale; the lowest of all values if None.
        last: the end of the time axis.
        unit: of the values.
        label: for those who cannot see it.
    """
    tall = LANE if len(each) == 1 else LANE / 2
    floor = _TOP + tall * len(each)
    finite = [y[np.isfinite(y)] for y in each]
    there = np.concatenate(finite) if finite else np.zeros(0)
    high = float(there.max()) if there.size else 0.0
    low = least if least is not None else float(there.min()) if there.size else 0.0
    lines = []
    for index, y in enumerate(each):
        share = (y - low) / (high - low) if high > low else np.full_like(y, 0.5)
        at = _TOP + tall * (index + 1) - (tall - 4.0) * share
        lines.append(tag("path", d=_path(x * (WIDTH / last), at), class_=f"curve chip{index}"))
    told = f"{low:.4g} to {high:.4g} {unit}" if high > low else f"{high:.4g} {unit}"
    words = [
        html.text(0.0, _TOP - 7, told.rstrip(), "tick"),
        html.text(0.0, floor + 16, "0", "tick"),
        html.text(WIDTH, floor + 16, f"{last:g} ms", "tick", "end"),
    ]
    return html.svg(WIDTH, floor + 24, html.line(0.0, floor, WIDTH, floor, "axis"), *lines, *words, label=label)


def _path(x: Floats, y: Floats) -> str:
    """A line; of more points than there is room for, the lowest and the highest of each stretch."""
    keep = np.isfinite(y)
    x, y = x[keep], y[keep]
    if y.size > 2 * _POINTS:
        parts = np.array_split(np.arange(y.size), _POINTS)
        at = np.array([sorted((part[y[part].argmin()], part[y[part].argmax()])) for part in parts]).ravel()
        x, y = x[at], y[at]
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)) if y.size else ""
