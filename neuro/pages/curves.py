"""Curves along time with their scales: rates of populations, and traces of probes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from neuro.chips.energy import quantity
from neuro.core import html
from neuro.core.html import Html, tag
from neuro.files.parts import Trace, Train
from neuro.files.results import Results
from neuro.pages.raster import evenly
from neuro.program.program import Floats, Ints

_SLACK = (1e-9, 0.0)
"""Shares of a step by which a mark may lie outside of the range. The second is used if the first has too many marks."""
_LEAST_PLAIN, _LARGE, _LARGEST_PLAIN = 1e-3, 1e3, 1e15


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` evenly spaced round numbers from `low` to `high`, if possible at least two."""
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    candidates = [_multiples(low, high, n * power, slack) for n in (1, 2, 5, 10, 20) for slack in _SLACK]
    best = next((marks for marks in candidates if len(marks) <= most), candidates[-1])
    if len(best) > 1:
        return best
    # For -2 to 4 the marks are 0 and 3, instead of 0 alone.
    threes = (_multiples(low, high, 3 * power, slack) for slack in _SLACK)
    return next((marks for marks in threes if 1 < len(marks) <= most), best)


def _multiples(low: float, high: float, step: float, slack: float) -> list[float]:
    return [step * k for k in range(math.ceil(low / step - slack), math.floor(high / step + slack) + 1)]


def tick(mark: float, marks: Sequence[float]) -> str:
    """Return a round number as text, with the number of digits common to all marks of its axis."""
    step = marks[1] - marks[0] if len(marks) > 1 else abs(mark) or 1.0
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{mark:,.{digits}f}" if digits < 5 and abs(mark) < 1e6 else f"{mark:.3g}"


def few(value: float) -> str:
    """Return a number in three digits, e.g. 0.0123, 16.4 or 302,000."""
    rounded = float(f"{value:.3g}")
    if _LARGE <= abs(rounded) < _LARGEST_PLAIN:
        return f"{rounded:,.0f}"
    return f"{value:.3g}" if abs(rounded) >= _LEAST_PLAIN or not rounded else f"{value:.2e}"


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return a factor and a unit with a prefix, so that values are at most 1000. Only J and s get a prefix.

    Args:
        largest: largest magnitude of the values.
        unit: unit of the values.
    """
    if unit not in ("J", "s") or not 0.0 < largest < math.inf:
        return 1.0, unit
    number, with_prefix = quantity(largest, unit).split()
    return 10.0 ** round(math.log10(float(number) / largest)), with_prefix


WIDTH, LANE = 330.0, 84.0
_TOP, _LEFT = 18.0, 48.0
_WIDE = WIDTH - _LEFT
"""Width of the drawn lines, without the numbers of the scale."""
MOST = 60
MOST_LINES = 4
_HUGE = 1e300
BINS, LEAST_BINS = 150, 10
"""Largest and smallest number of bins of a rate. Within these limits a bin has four spikes on average."""
_POINTS = 500


def rates(results: Results) -> Html:
    """Draw the mean rate of a neuron along time, for each population with recorded spikes."""
    names = [name for name, train in results.populations.items() if train.steps.size]
    return _grid([_rate(name, results.populations[name], results) for name in names[:MOST]], len(names), "populations")


def _rate(name: str, train: Train, results: Results) -> Html:
    step, end = results.about["resolution_ms"], end_ms(results)
    width = max(1, round(_round(end / min(BINS, max(LEAST_BINS, train.times_ms.size / 4))) / step)) * step
    edges = np.append(np.arange(0.0, max(end - width / 2, step / 2), width), end)
    counts, _ = np.histogram(train.times_ms, edges, weights=train.multiplicity)
    hz = counts / (train.size * np.diff(edges) / 1000.0)
    picture = curves(edges[:-1] + np.diff(edges) / 2, [hz], 0.0, end, "Hz", f"rate of {name}")
    return html.figure(picture, f"bins of {width:g} ms", name)


def traces(results: Results, of: str) -> Html:
    """Draw the traces of a "population" or of a "projection"."""
    parts = [(name, trace) for name, trace in results.traces.items() if getattr(trace, of)]
    return _grid([_trace(name, trace, end_ms(results)) for name, trace in parts[:MOST]], len(parts), "traces")


def world(results: Results) -> Html:
    """Draw reward and action of the first copy in each control step of the last block."""
    end, rewards = end_ms(results), results.world["rewards"][:, 0].astype(np.float64)
    actions = results.world["actions"][:, 0].reshape(len(rewards), -1).astype(np.float64)
    times = np.linspace(0.0, end, len(rewards) + 1, dtype=np.float64)[1:]
    action_columns: list[Floats] = [*actions.T[:MOST_LINES]]
    names = [f"action[{k}]" for k in range(len(action_columns))] if len(action_columns) > 1 else []
    figures = [
        html.figure(
            curves(times, [rewards], None, end, "reward", "reward of each step"), "reward of each step", "reward"
        ),
        html.figure(curves(times, action_columns, None, end, "action", "action", names), "what was done", "action"),
    ]
    return _grid(figures, len(figures), "curves")


def end_ms(results: Results) -> float:
    """Return the length of a run in ms, at least one step."""
    return max(results.duration_ms, float(results.about["resolution_ms"]))


def _trace(name: str, trace: Trace, last: float) -> Html:
    x, values = _of_synapses(trace) if trace.at_pre_spikes else (trace.times_ms, trace.values)
    values = values[:, None] if values.ndim == 1 else values
    columns = evenly(values.shape[1], MOST_LINES)
    if trace.single:
        label = f"{'mean ' * trace.mean}{trace.state} of {trace.of}"
    else:
        n = values.shape[1]
        selection = f"{columns.size:,} of {n:,} {trace.noun}s of " if columns.size < n else ""
        label = f"{trace.state} of {selection}{trace.of}"
        label += ", as pre spikes leave it" * trace.at_pre_spikes
    lines = [values[:, column] for column in columns]
    names = [] if trace.single else _names(trace, columns)
    return html.figure(curves(x, lines, None, last, trace.unit or trace.state, label, names), label, name)


def _names(trace: Trace, columns: Ints) -> list[str]:
    """Return the name of each drawn line."""
    if trace.at_pre_spikes:
        ends = np.unique(np.stack([trace.pre, trace.post]), axis=1)
        return [f"{pre} to {post}" for pre, post in ends[:, columns].T]
    if trace.pre is not None and trace.post is not None:
        return [f"{trace.pre[k]} to {trace.post[k]}" for k in columns]
    return [f"{trace.noun} {k if trace.ids is None else trace.ids[k]}" for k in columns]


def _of_synapses(trace: Trace) -> tuple[Floats, Floats]:
    """Return times and values at pre spikes, one column for each drawn synapse, NaN without a spike."""
    ends, index = np.unique(np.stack([trace.pre, trace.post]), axis=1, return_inverse=True)
    columns = evenly(ends.shape[1], MOST_LINES)
    values = np.where(index.reshape(-1, 1) == np.arange(ends.shape[1])[None, columns], trace.values[:, None], np.nan)
    has_values = np.isfinite(values).any(axis=1)
    table = np.full((int(has_values.sum()), ends.shape[1]), np.nan)
    table[:, columns] = values[has_values]
    return trace.times_ms[has_values], table


def _grid(drawings: Sequence[Html], count: int, noun: str) -> Html:
    note = tag("p", f"{count - len(drawings)} more {noun} are not drawn.") if count > len(drawings) else None
    return html.join([tag("div", *drawings, class_="grid"), note])


def curves(
    x: Floats,
    lines: Sequence[Floats],
    lowest: float | None,
    last: float,
    unit: str,
    label: str,
    names: Sequence[str] = (),
) -> Html:
    """Draw lines over time, from 0 to `last` ms, one below the other, with a common scale.

    The page's script zooms the time axis.

    Args:
        x: times of all lines in ms.
        lines: values of each line; NaN and infinite values are left out.
        lowest: lowest value of the scale; by default the lowest of all values.
        last: end of the time axis in ms.
        unit: unit of the values, or their meaning.
        label: description for screen readers.
        names: name of each line, if there are several.
    """
    head = 14.0 if names else 0.0
    lane = LANE if len(lines) == 1 else LANE / 2
    floor = _TOP + (head + lane) * len(lines)
    low, high = _scale(lines, lowest)
    marks = ticks(low, high, 4 if len(lines) == 1 else 2)
    parts: list[Html] = [html.text(_LEFT - 8, _TOP - 6, unit, "tick", "end")]
    for index, y in enumerate(lines):
        bottom = _TOP + (head + lane) * (index + 1)
        share = (y - low) / (high - low)
        path = tag("path", d=_path(x * (_WIDE / last), (lane - 4.0) * (1.0 - share) + 2.0), class_=f"curve chip{index}")
        for mark in marks:
            height = bottom - 2.0 - (lane - 4.0) * (mark - low) / (high - low)
            parts += [html.line(_LEFT, height, WIDTH, height, "faint")]
            parts += [html.text(_LEFT - 8, height + 4, tick(mark, marks), "tick", "end")]
        if names:
            parts.append(html.text(WIDTH, bottom - lane - 2, names[index], f"tick name{index}", "end"))
        box = {"x": _LEFT, "y": bottom - lane, "width": _WIDE, "height": lane}
        parts.append(
            tag("svg", path, viewBox=f"0 0 {_WIDE:g} {lane:g}", preserveAspectRatio="none", class_="lines", **box)
        )
    times = tag("g", *_times(last, floor), class_="times", data_ms=last, data_left=_LEFT, data_wide=_WIDE, data_y=floor)
    axis = html.line(_LEFT, floor, WIDTH, floor, "axis")
    return html.svg(WIDTH, floor + 24, *parts, axis, times, label=label, class_="curves")


def _scale(lines: Sequence[Floats], lowest: float | None) -> tuple[float, float]:
    """Return the lowest and the highest value of a scale, with a range around constant values."""
    finite = np.concatenate([y[np.isfinite(y)] for y in lines]) if lines else np.zeros(0)
    finite = np.clip(finite, -_HUGE, _HUGE)
    high = float(finite.max()) if finite.size else 0.0
    low = lowest if lowest is not None else float(finite.min()) if finite.size else 0.0
    if high - low > max(1e-9 * max(abs(high), abs(low)), 1.0 / _HUGE):
        return low, high
    return (0.0, 1.0) if lowest is not None else (low - (abs(low) / 100 or 1.0), low + (abs(low) / 100 or 1.0))


def _round(ms: float) -> float:
    """Return the next larger 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(ms))
    return next(n * power for n in (1, 2, 5, 10) if n * power >= ms * (1 - 1e-9))


def _times(last: float, floor: float) -> Iterator[Html]:
    """Yield the time axis of the whole run. The page's script draws the axis of a part."""
    marks = ticks(0.0, last, 4)
    for mark in marks:
        x = _LEFT + _WIDE * mark / last
        yield html.line(x, floor, x, floor + 4, "axis")
        label = tick(mark, marks) + " ms" * (mark == marks[-1])
        yield html.text(min(x, WIDTH), floor + 17, label, "tick", "end" if x > WIDTH - 26 else "middle")


def _path(x: Floats, y: Floats) -> str:
    """Return a line as a path. Too many points are reduced to the lowest and the highest point of each stretch."""
    keep = np.isfinite(y)
    x, y = x[keep], y[keep]
    if y.size > 2 * _POINTS:
        parts = np.array_split(np.arange(y.size), _POINTS)
        indices = np.array([sorted((part[y[part].argmin()], part[y[part].argmax()])) for part in parts]).ravel()
        x, y = x[indices], y[indices]
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)) if y.size else ""
