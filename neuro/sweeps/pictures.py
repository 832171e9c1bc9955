"""Metrics of a sweep drawn over its parameters, as figures of matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from neuro.core.checks import is_number
from neuro.core.values import literal
from neuro.plots._canvas import Picture, colours, tidy
from neuro.sweeps.plot_data import PlotData, is_log, ordered, plot_data, scaled, told
from neuro.sweeps.table import SweepTable


def pictures(
    table: SweepTable, metrics: Sequence[str] = (), of: Sequence[str] = (), kind: str = "auto"
) -> dict[str, Figure]:
    """A figure for each metric, by the name of a file; arguments and errors as of `plot_data.plot_data`."""
    drawn = plot_data(table, metrics, of, kind)
    return {f"{_in_a_name(each.metric)}-{each.kind}": _DRAW[each.kind](table, each) for each in drawn}


def _in_a_name(metric: str) -> str:
    """A metric in the name of a file of one folder, such as val-loss of val/loss."""
    return metric.replace("/", "-").lstrip(".")


def _figure(table: SweepTable, wide: float = 7.0) -> tuple[Figure, Any]:
    figure = Picture(figsize=(wide, 4.4), layout="constrained", dpi=150)
    figure.suptitle(literal(table.name), fontsize=12)
    axis = figure.subplots()
    tidy(axis)
    return figure, axis


def _lines(table: SweepTable, data: PlotData) -> Figure:
    """A line for each value of the second parameter, with a band of one standard deviation over what is left."""
    figure, axis = _figure(table)
    lines = data.lines()
    for (name, x, mean, spread), colour in zip(lines, colours(), strict=False):
        axis.plot(x, mean, "o-", color=colour, label=literal(name), markersize=4, linewidth=1.3)
        if spread.any():
            axis.fill_between(x, mean - spread, mean + spread, color=colour, alpha=0.18, linewidth=0)
    _named(axis.xaxis, data.axis(0))
    axis.set_xlabel(literal(data.names[0]))
    axis.set_ylabel(literal(data.metric))
    if len(data.names) > 1:
        axis.legend(frameon=False, fontsize="small", loc="best")
    if is_log(data.axis(0)):
        axis.set_xscale("log")
    return figure


def _map(table: SweepTable, data: PlotData) -> Figure:
    """A field for each pair of values, by the mean over what is left."""
    figure, axis = _figure(table)
    grid = data.grid()
    image = axis.imshow(grid, origin="lower", aspect="auto", cmap="cividis", interpolation="nearest")
    for side, values, name in ((axis.xaxis, data.axis(0), data.names[0]), (axis.yaxis, data.axis(1), data.names[1])):
        every = max(1, -(-len(values) // 12))
        side.set_ticks(range(0, len(values), every), [literal(told(value)) for value in values[::every]])
        side.set_label_text(literal(name))
    if grid.size <= 64:
        middle = (np.nanmin(grid) + np.nanmax(grid)) / 2
        for (row, column), value in np.ndenumerate(grid):
            if np.isfinite(value):
                ink = "white" if value < middle else "black"
                axis.text(column, row, f"{value:.3g}", ha="center", va="center", color=ink, fontsize=8)
    figure.colorbar(image, ax=axis, label=literal(data.metric))
    return figure


def _parallel(table: SweepTable, data: PlotData) -> Figure:
    """An axis for each parameter and one for the metric; a line for each point, in the colour of its metric.

    Source: Inselberg, The Visual Computer 1:69, 1985
    """
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    names = (*data.names, data.metric)
    figure, axis = _figure(table, max(7.0, 1.6 * len(names)))
    axis.spines[["left", "bottom"]].set_visible(False)
    metric = np.array([np.mean(each) for _, each in data.points])
    columns = [[values[k] for values, _ in data.points] for k in range(len(data.names))] + [metric.tolist()]
    heights = []
    for k, values in enumerate(columns):
        every = ordered(values)
        at = dict(zip(map(repr, every), scaled(every), strict=True))
        y = np.array([at[repr(value)] for value in values])
        low, high = float(min(at.values())), float(max(at.values()))
        heights.append((y - low) / (high - low) if high > low else np.full_like(y, 0.5))
        axis.axvline(k, color="0.6", linewidth=0.8, zorder=0)
        for value in every if len(every) <= 6 else (every[0], every[-1]):
            share = (at[repr(value)] - low) / (high - low) if high > low else 0.5
            axis.text(k, share, f" {literal(told(value))}", fontsize=8, va="center")
    order = np.argsort(metric)
    lines = np.stack([np.broadcast_to(np.arange(len(names)), (metric.size, len(names))), np.array(heights).T], axis=2)
    share = heights[-1]
    axis.add_collection(LineCollection(list(lines[order]), colors=colormaps["cividis"](share[order]), linewidths=1.0))
    axis.set_xlim(-0.15, len(names) - 0.6)
    axis.set_ylim(-0.05, 1.05)
    axis.set_xticks(range(len(names)), [literal(name) for name in names])
    axis.set_yticks([])
    return figure


def _named(side: Any, values: list[Any]) -> None:
    if not all(map(is_number, values)):
        side.set_ticks(range(len(values)), [literal(told(value)) for value in values])


_DRAW = {"lines": _lines, "map": _map, "parallel": _parallel}
