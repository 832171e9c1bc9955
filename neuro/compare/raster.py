"""Rasters: of each population one strip a backend, where spikes that only one of two runs has stand out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.compare import cells, html
from neuro.compare.html import Html, tag
from neuro.compare.result import Comparison, Run
from neuro.compare.spikes import Train, evenly
from neuro.program.program import Ints

MOST_ROWS = 64
LEAST_ROWS = 8
MOST_DOTS = 3000
MOST_DOTS_IN_ALL = 60_000
MOST_POPULATIONS = 40
WIDTH, LEFT, RIGHT = 1040.0, 104.0, 12.0
_GAP, _AXIS = 8.0, 24.0


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """What is drawn of a population.

    Attributes:
        neurons: which, ascending; each takes a row.
        steps: up to this step, not included.
        end_ms: the time of it.
        dots: most of a strip.
    """

    neurons: Ints
    steps: int
    end_ms: float
    dots: int


def rasters(comparison: Comparison) -> Html:
    """A drawing for each population, neurons first, then input."""
    populations = comparison.first.populations
    order = sorted(populations, key=lambda name: populations[name].generator)
    shown = [name for name in order if populations[name].spikes or _differs(comparison, name)]
    drawn, silent = shown[:MOST_POPULATIONS], [name for name in order if name not in shown]
    dots = min(MOST_DOTS, MOST_DOTS_IN_ALL // max(1, len(drawn) * len(comparison.ran)))
    parts: list[object] = [_raster(comparison, name, dots) for name in drawn]
    if len(shown) > len(drawn):
        parts.append(tag("p", f"{len(shown) - len(drawn)} more populations are not drawn: {MOST_POPULATIONS} are."))
    if silent:
        parts.append(tag("p", f"Silent on every backend: {', '.join(silent)}."))
    return html.join([_legend(comparison), *parts])


def _differs(comparison: Comparison, name: str) -> bool:
    return any(run.populations[name].spikes for run in comparison.ran)


def _legend(comparison: Comparison) -> Html:
    first = comparison.first.backend
    told = (("same", f"as on {first}"), ("extra", f"only here, not on {first}"), ("missing", f"on {first}, not here"))
    return html.legend(*told)


def _raster(comparison: Comparison, name: str, dots: int) -> Html:
    window = _window(comparison, name, dots)
    height = float(max(26, min(96, 3 * window.neurons.size)))
    first = comparison.first.trains[name]
    parts: list[object] = []
    y = 4.0
    for run in comparison.ran:
        parts += _strip(comparison, run, name, window, y, height)
        y += height + _GAP
    parts += _axis(window.end_ms, y - _GAP / 2)
    label = f"raster of {name} on {', '.join(run.backend for run in comparison.ran)}"
    kind = "input, " if comparison.first.populations[name].generator else ""
    caption = kind + _caption(first, window, comparison)
    return html.figure(html.svg(WIDTH, y + _AXIS, *parts, label=label, class_="wide"), caption, name)


def _window(comparison: Comparison, name: str, dots: int) -> _Window:
    """As many neurons as there is room for, those that differ first among them; then the first part of the run."""
    trains = [run.trains[name] for run in comparison.ran]
    size = trains[0].size
    total = max(train.ids.size for train in trains)
    rows = max(min(MOST_ROWS, int(0.9 * dots * size / max(total, 1))), LEAST_ROWS)
    found = [run.populations[name].first for run in comparison.ran]
    neurons = np.union1d(evenly(size, rows), [part.neuron for part in found if part is not None]).astype(np.int64)
    end = round(comparison.ms / comparison.resolution_ms) + 1
    for train in trains:
        steps = train.steps[np.isin(train.ids, neurons)]
        if steps.size > dots:
            end = min(end, int(steps[dots]))
    whole = end * comparison.resolution_ms >= comparison.ms
    return _Window(neurons, end, comparison.ms if whole else end * comparison.resolution_ms, dots)


def _keys(train: Train, window: _Window) -> Ints:
    """Step and row of each spike that is drawn, as one number."""
    keep = (train.steps < window.steps) & np.isin(train.ids, window.neurons)
    row = np.searchsorted(window.neurons, train.ids[keep])
    keys: Ints = np.unique(train.steps[keep] * window.neurons.size + row)
    return keys


def _strip(comparison: Comparison, run: Run, name: str, window: _Window, y: float, height: float) -> list[Html]:
    """Spikes of one backend."""
    mine, its = _keys(run.trains[name], window), _keys(comparison.first.trains[name], window)
    part, first = run.populations[name], run is comparison.first
    kinds = (
        ("same", np.intersect1d(mine, its)),
        ("missing", np.setdiff1d(its, mine)),
        ("extra", np.setdiff1d(mine, its)),
    )
    parts = [
        html.box(LEFT, y, WIDTH - LEFT - RIGHT, height, "field"),
        html.text(LEFT - 10, y + height / 2 - 2, run.backend, "name", "end"),
        html.text(LEFT - 10, y + height / 2 + 12, f"{part.rate_hz:.3g} Hz", "quiet", "end"),
        *(_dots(comparison, window, keys, y, height, kind) for kind, keys in kinds if keys.size),
    ]
    if part.first is not None and not first and part.first.ms < window.end_ms:
        x = _x(part.first.ms, window.end_ms)
        mark = tag("title", f"first difference: {cells.where(part.first)}")
        parts.append(tag("line", mark, x1=x, y1=y - 3, x2=x, y2=y + height + 3, class_="first"))
    return parts


def _dots(comparison: Comparison, window: _Window, keys: Ints, y: float, height: float, kind: str) -> Html:
    rows = window.neurons.size
    steps, row = np.divmod(keys, rows)
    tall = height / rows
    length = max(1.6, min(tall * 0.8, 12.0))
    xs = (_x(float(ms), window.end_ms) for ms in steps * comparison.resolution_ms)
    tops = y + height - (row + 0.5) * tall - length / 2
    path = "".join(f"M{x:.1f} {top:.1f}v{length:.1f}" for x, top in zip(xs, tops, strict=True))
    return tag("path", d=path, class_=f"dots {kind}")


def _x(ms: float, end_ms: float) -> float:
    return LEFT + 4 + (WIDTH - LEFT - RIGHT - 8) * ms / end_ms


def _axis(end_ms: float, y: float) -> list[Html]:
    step = next(width for width in (d * 10.0**e for e in range(-3, 12) for d in (1, 2, 5)) if end_ms / width <= 10)
    ticks = [i * step for i in range(int(end_ms / step) + 1)]
    parts = [html.text(_x(ms, end_ms), y + 16, f"{ms:g}", "tick", "middle") for ms in ticks]
    marks = [html.line(_x(ms, end_ms), y, _x(ms, end_ms), y + 4, "axis") for ms in ticks]
    return [*marks, *parts, html.text(LEFT - 10, y + 16, "ms", "tick", "end")]


def _caption(train: Train, window: _Window, comparison: Comparison) -> str:
    n = window.neurons.size
    which = f"{train.size:,} neuron{'s' * (train.size != 1)}"
    told = which if n == train.size else f"{n} of {which}, evenly chosen"
    return told if window.end_ms >= comparison.ms else f"{told}; the first {window.end_ms:g} of {comparison.ms:g} ms"
