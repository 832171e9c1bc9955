"""Weights as histograms: before and after quantisation, and at the end of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from neuro.compare import html
from neuro.compare.html import Html, tag
from neuro.compare.result import Comparison
from neuro.compare.weights import Histogram
from neuro.program.program import Floats

WIDTH, HEIGHT = 330.0, 150.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 8.0, 8.0, 10.0, 26.0
_ROOM = 90.0
MOST = 60


def weights(comparison: Comparison) -> Html:
    """Before and after quantisation: a histogram of each projection with several weights, a row of each with one."""
    chips = [run.backend for run in comparison.ran if run.fixed]
    return _drawings(comparison.histograms, {"described": "as described"} | {name: f"on {name}" for name in chips})


def learnt(comparison: Comparison) -> Html:
    """At the end of the run: the same of each projection that learns, on each backend."""
    return _drawings(comparison.learnt, {run.backend: f"on {run.backend}" for run in comparison.ran})


def _drawings(found: Sequence[Histogram], names: Mapping[str, str]) -> Html:
    """Histograms; `names` says what each kind of weights is called, the first of which is filled."""
    wide = [part for part in found if part.counts]
    single = [part for part in found if not part.counts]
    parts: list[object] = []
    if wide:
        parts.append(html.legend(*((_kind(i), told) for i, told in enumerate(names.values()))))
        parts.append(tag("div", *(_drawing(part, list(names)) for part in wide[:MOST]), class_="grid"))
    if len(wide) > MOST:
        parts.append(tag("p", f"{len(wide) - MOST} more projections are not drawn."))
    if single:
        columns = ("projection", ">synapses", *(f">{told}" for told in names.values()))
        rows = (_row(part, names) for part in single)
        parts.append(html.table(columns, rows, "Projections with one weight for all"))
    return html.join(parts)


def _kind(index: int) -> str:
    return f"chip{index - 1}" if index else "described"


def _row(part: Histogram, names: Iterable[str]) -> list[str]:
    told = (part.extent.get(name) for name in names)
    values = ("-" if pair is None else f"{pair[0]:.6g} {part.unit}".rstrip() for pair in told)
    return [part.projection, f"{part.synapses:,}", *values]


def _drawing(part: Histogram, names: Sequence[str]) -> Html:
    most = max(int(counts.max()) for counts in part.counts.values())
    low, high = float(part.edges[0]), float(part.edges[-1])

    def x(weight: float) -> float:
        return _LEFT + (WIDTH - _LEFT - _RIGHT) * (weight - low) / (high - low)

    floor = HEIGHT - _BOTTOM
    tops = {name: floor - (floor - _TOP) * counts / most for name, counts in part.counts.items()}
    xs = np.array([x(float(edge)) for edge in part.edges])
    kinds = [(name, _kind(i)) for i, name in enumerate(names) if name in tops]
    parts = [
        tag("path", d=_steps(xs, tops[name], floor), class_=kind if kind == "described" else f"outline {kind}")
        for name, kind in kinds
    ]
    parts.append(html.line(_LEFT, floor, WIDTH - _RIGHT, floor, "axis"))
    ends = (min(pair[0] for pair in part.extent.values()), max(pair[1] for pair in part.extent.values()))
    for weight, at, anchor in zip(ends, (_LEFT, WIDTH - _RIGHT), ("start", "end"), strict=True):
        parts.append(html.text(at, HEIGHT - 9, f"{weight:.4g} {part.unit}".rstrip(), "tick", anchor))
    if _ROOM < x(0) < WIDTH - _ROOM:
        parts += [html.line(x(0), floor, x(0), floor + 4, "axis"), html.text(x(0), HEIGHT - 9, "0", "tick", "middle")]
    picture = html.svg(WIDTH, HEIGHT, *parts, label=f"weights of {part.projection}")
    return html.figure(picture, _about(part, names), part.projection)


def _steps(xs: Floats, tops: NDArray[np.float64], floor: float) -> str:
    path = "".join(f"V{top:.1f}H{right:.1f}" for top, right in zip(tops, xs[1:], strict=True))
    return f"M{xs[0]:.1f} {floor:.1f}{path}V{floor:.1f}"


def _about(part: Histogram, names: Sequence[str]) -> str:
    count = f"{part.synapses:,} synapses, {part.distinct[names[0]]:,} different weights"
    return "; ".join([count, *(f"{part.distinct[name]:,} on {name}" for name in names[1:] if name in part.distinct)])
