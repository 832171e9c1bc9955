"""Weights before and after quantisation, as histograms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.compare import html
from neuro.compare.html import Html, tag
from neuro.compare.result import Comparison
from neuro.compare.weights import Histogram
from neuro.program import Floats

WIDTH, HEIGHT = 330.0, 150.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 8.0, 8.0, 10.0, 26.0
_ROOM = 90.0
MOST = 60


def weights(comparison: Comparison) -> Html:
    """A histogram of each projection with several weights, and a table of those with one."""
    wide = [part for part in comparison.histograms if part.counts]
    single = [part for part in comparison.histograms if not part.counts]
    chips = [run.backend for run in comparison.ran if run.fixed]
    kinds = (("described", "as described"), *((f"chip{i}", f"on {name}") for i, name in enumerate(chips)))
    parts: list[object] = [html.legend(*kinds)] if wide else []
    parts.append(tag("div", *(_drawing(part, chips) for part in wide[:MOST]), class_="grid"))
    if len(wide) > MOST:
        parts.append(tag("p", f"{len(wide) - MOST} more projections are not drawn."))
    if single:
        columns = ("projection", ">synapses", ">as described", *(f">on {name}" for name in chips))
        parts.append(html.table(columns, (_row(part, chips) for part in single), "Projections with one weight for all"))
    return html.join(parts)


def _row(part: Histogram, chips: list[str]) -> list[str]:
    told = (part.extent.get(name) for name in ("described", *chips))
    values = ("-" if pair is None else f"{pair[0]:.6g} {part.unit}".rstrip() for pair in told)
    return [part.projection, f"{part.synapses:,}", *values]


def _drawing(part: Histogram, chips: list[str]) -> Html:
    most = max(int(counts.max()) for counts in part.counts.values())
    low, high = float(part.edges[0]), float(part.edges[-1])

    def x(weight: float) -> float:
        return _LEFT + (WIDTH - _LEFT - _RIGHT) * (weight - low) / (high - low)

    floor = HEIGHT - _BOTTOM
    tops = {name: floor - (floor - _TOP) * counts / most for name, counts in part.counts.items()}
    xs = np.array([x(float(edge)) for edge in part.edges])
    parts = [tag("path", d=_steps(xs, tops["described"], floor), class_="described")]
    for i, name in enumerate(chips):
        if name in tops:
            parts.append(tag("path", d=_steps(xs, tops[name], floor), class_=f"outline chip{i}"))
    parts.append(html.line(_LEFT, floor, WIDTH - _RIGHT, floor, "axis"))
    ends = (min(pair[0] for pair in part.extent.values()), max(pair[1] for pair in part.extent.values()))
    for weight, at, anchor in zip(ends, (_LEFT, WIDTH - _RIGHT), ("start", "end"), strict=True):
        parts.append(html.text(at, HEIGHT - 9, f"{weight:.4g} {part.unit}".rstrip(), "tick", anchor))
    if _ROOM < x(0) < WIDTH - _ROOM:
        parts += [html.line(x(0), floor, x(0), floor + 4, "axis"), html.text(x(0), HEIGHT - 9, "0", "tick", "middle")]
    picture = html.svg(WIDTH, HEIGHT, *parts, label=f"weights of {part.projection}")
    return html.figure(picture, _about(part, chips), part.projection)


def _steps(xs: Floats, tops: NDArray[np.float64], floor: float) -> str:
    path = "".join(f"V{top:.1f}H{right:.1f}" for top, right in zip(tops, xs[1:], strict=True))
    return f"M{xs[0]:.1f} {floor:.1f}{path}V{floor:.1f}"


def _about(part: Histogram, chips: list[str]) -> str:
    count = f"{part.synapses:,} synapses, {part.distinct['described']:,} different weights"
    return "; ".join([count, *(f"{part.distinct[name]:,} on {name}" for name in chips if name in part.distinct)])
