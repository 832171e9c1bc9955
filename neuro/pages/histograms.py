"""Histograms of weights: a drawing per projection, with several origins of weights on top of each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neuro.core import html
from neuro.core.html import Html, tag
from neuro.pages.curves import tick, ticks
from neuro.program.program import Floats

BINS = 48
WIDTH, HEIGHT = 330.0, 150.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 48.0, 12.0, 18.0, 26.0
MOST = 60


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """Distribution of the weights of one projection.

    Attributes:
        projection: name of the projection.
        unit: unit of the weights, "" for registers of a chip.
        synapses: number of synapses; for a grid the number of weights in the kernels.
        edges: edges of the bins, shape (bins + 1,); length 1 if all weights are equal.
        counts: counts of each bin, shape (bins,), by origin of the weights, e.g. "described" or the name of a chip.
        distinct: number of different weights, by origin.
        extent: smallest and largest weight, by origin.
    """

    projection: str
    unit: str
    synapses: int
    edges: Floats
    counts: dict[str, NDArray[np.int64]]
    distinct: dict[str, int]
    extent: dict[str, tuple[float, float]]


def histogram(projection: str, unit: str, weights: Mapping[str, Floats], grain: float = 0.0) -> Histogram:
    """Return the weights of one projection as a histogram.

    Args:
        projection: name of the projection.
        unit: unit of the weights.
        weights: weights by origin; all origins have the same number of weights.
        grain: largest step between two weights of a chip; 0 without a chip.
    """
    size = next(iter(weights.values())).size if weights else 0
    if not size:
        return Histogram(projection, "", 0, np.zeros(1), {}, {}, {})
    extent = {name: (float(values.min()), float(values.max())) for name, values in weights.items()}
    low, high = min(low for low, _ in extent.values()), max(high for _, high in extent.values())
    has_range = any(high > low for low, high in extent.values())
    edges = _edges(low, high, grain) if has_range else np.array([low])
    counts = {name: np.histogram(values, edges)[0] for name, values in weights.items()} if has_range else {}
    distinct = {name: int(np.unique(values).size) for name, values in weights.items()}
    return Histogram(projection, unit, size, edges, counts, distinct, extent)


def _edges(low: float, high: float, grain: float) -> Floats:
    """Return the edges of about `BINS` bins. Each bin has the same number of possible values of the coarsest chip."""
    if not 0.0 < grain < high - low:
        return np.linspace(low, high, BINS + 1)
    width = grain * np.ceil((high - low) / grain / BINS)
    begin = grain * (np.floor(low / grain + 0.5) - 0.5)
    edges: Floats = begin + width * np.arange(np.floor((high - begin) / width) + 2)
    return edges


def drawings(histograms: Sequence[Histogram], names: Mapping[str, str]) -> Html:
    """Draw histograms, and a table of the projections with one value.

    Args:
        histograms: one for each projection.
        names: name of each origin of weights; the first is drawn filled.
    """
    varying = [part for part in histograms if part.counts]
    constant = [part for part in histograms if not part.counts]
    parts: list[object] = []
    if varying:
        parts.append(html.legend(*((_kind(i), label) for i, label in enumerate(names.values()))))
        parts.append(tag("div", *(_drawing(part, list(names)) for part in varying[:MOST]), class_="grid"))
    if len(varying) > MOST:
        parts.append(tag("p", f"{len(varying) - MOST} more projections are not drawn."))
    if constant:
        columns = ("projection", ">synapses", *(f">{label}" for label in names.values()))
        rows = (_row(part, names) for part in constant)
        parts.append(html.table(columns, rows, "Projections with one weight for all"))
    return html.join(parts)


def _kind(index: int) -> str:
    return f"chip{index - 1}" if index else "described"


def _row(part: Histogram, names: Iterable[str]) -> list[str]:
    ranges = (part.extent.get(name) for name in names)
    values = ("-" if pair is None else f"{pair[0]:.6g} {part.unit}".rstrip() for pair in ranges)
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
    parts += _axes(x, low, high, part.unit, floor, most)
    picture = html.svg(WIDTH, HEIGHT, *parts, label=f"weights of {part.projection}")
    return html.figure(picture, _about(part, names), part.projection)


def _axes(x: Callable[[float], float], low: float, high: float, unit: str, floor: float, most: int) -> Iterator[Html]:
    """Yield axes with round weights, the last with its unit, and round numbers of synapses."""
    yield html.line(_LEFT, floor, WIDTH - _RIGHT, floor, "axis")
    weights = ticks(low, high, 4)
    for weight in weights:
        last = weight == weights[-1]
        yield html.line(x(weight), floor, x(weight), floor + 4, "axis")
        label, anchor = f"{tick(weight, weights)} {unit * last}".rstrip(), "end" if x(weight) > WIDTH - 36 else "middle"
        yield html.text(
            min(x(weight), WIDTH - 1) if anchor == "middle" else WIDTH - 1, HEIGHT - 7, label, "tick", anchor
        )
    counts = [mark for mark in ticks(0.0, float(most), 3) if mark == int(mark)]
    for count in counts:
        y = floor - (floor - _TOP) * count / most
        yield html.line(_LEFT, y, WIDTH - _RIGHT, y, "faint")
        yield html.text(_LEFT - 6, y + 4, tick(count, counts), "tick", "end")
    yield html.text(0.0, _TOP - 8, "synapses", "tick")


def _steps(xs: Floats, tops: NDArray[np.float64], floor: float) -> str:
    path = "".join(f"V{top:.1f}H{right:.1f}" for top, right in zip(tops, xs[1:], strict=True))
    return f"M{xs[0]:.1f} {floor:.1f}{path}V{floor:.1f}"


def _about(part: Histogram, names: Sequence[str]) -> str:
    count = f"{part.synapses:,} synapses, {part.distinct[names[0]]:,} different weights"
    return "; ".join([count, *(f"{part.distinct[name]:,} on {name}" for name in names[1:] if name in part.distinct)])
