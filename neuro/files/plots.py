"""Pictures of results: raster, rates and traces.

Colours are those of Okabe and Ito and of cividis, which colour-blind readers tell apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from neuro.core.errors import ModelError
from neuro.files.results import Results, Trace, Train
from neuro.program.program import Floats

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MOST_DOTS = 100_000
MOST_LINES = 6
MOST_ROWS = 500
MOST_TICKS = 100
WIDTH_IN, PANEL_IN, TALLEST_IN = 10.0, 2.2, 60.0


def raster(results: Results) -> Figure:
    """Every spike as a dot, one panel for each population; of very many an even choice is drawn, and said."""
    trains = _recorded(results)
    figure, axes = _panels(results, "spikes", len(trains))
    for axis, (name, train), colour in zip(axes, trains.items(), cycle(COLOURS), strict=False):
        times, ids, note = _chosen(train)
        height = 72 * axis.get_position().height * figure.get_figheight()
        marker, edge = ("|", 0.8) if train.size <= MOST_TICKS else ("o", 0.0)
        size = float(np.clip(0.8 * height / train.size, 1.0 if times.size < MOST_DOTS // 5 else 0.6, 12.0))
        axis.plot(times, ids, marker, color=colour, ms=size, mew=edge)
        margin = 0.5 + 0.02 * train.size
        axis.set_ylim(-margin, train.size - 1 + margin)
        axis.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, min_n_ticks=1))
        _label(axis, f"{name}: {_about(results, train)}{note}", "neuron")
    return figure


def rates(results: Results) -> Figure:
    """The mean rate of each population in bins of equal length."""
    trains = _recorded(results)
    width = _bin_ms(results)
    edges = np.arange(0.0, results.duration_ms + 0.5 * width, width)
    edges = edges if len(edges) > 1 else np.array([0.0, results.duration_ms])
    figure, axes = _panels(results, f"mean rates in bins of {width:g} ms", len(trains))
    for axis, (name, train), colour in zip(axes, trains.items(), cycle(COLOURS), strict=False):
        spikes, _ = np.histogram(train.times_ms, edges, weights=train.multiplicity)
        hz = spikes / train.size / np.diff(edges) * 1000.0
        axis.stairs(hz, edges, color=colour, fill=True, alpha=0.25)
        axis.stairs(hz, edges, color=colour)
        axis.set_ylim(bottom=0.0)
        _label(axis, f"{name}: {_about(results, train)}", "rate (Hz)")
    return figure


def traces(results: Results) -> Figure:
    """What each probe recorded: lines of a few neurons, a map of many.

    Raises:
        ModelError: no probe of a state recorded anything.
    """
    shown = {name: trace for name, trace in results.traces.items() if trace.times_ms.size}
    if not shown:
        raise ModelError("the results hold no traces", hint="a probe of a state, such as V_m, records one")
    figure, axes = _panels(results, "traces", len(shown))
    for axis, (name, trace) in zip(axes, shown.items(), strict=True):
        quantity = f"{trace.state} ({trace.unit})" if trace.unit else trace.state
        title = f"{name}: {trace.state} of {trace.population}"
        if trace.values.shape[1] <= MOST_LINES:
            _lines(axis, trace)
            _label(axis, title, quantity)
        else:
            image = _map(axis, trace)
            figure.colorbar(image, ax=axis, label=quantity, pad=0.01)
            _label(axis, title, "neuron")
    return figure


def _lines(axis: Any, trace: Trace) -> None:
    for neuron, colour in zip(range(trace.values.shape[1]), COLOURS, strict=False):
        axis.plot(trace.times_ms, trace.values[:, neuron], color=colour, lw=1.0, label=f"neuron {neuron}")
    if trace.values.shape[1] > 1:
        axis.legend(loc="upper right", ncols=MOST_LINES)


def _map(axis: Any, trace: Trace) -> Any:
    steps = slice(None, None, -(-trace.times_ms.size // 4000))
    times, values = trace.times_ms[steps], trace.values[steps]
    pick = np.unique(np.linspace(0, values.shape[1] - 1, MOST_ROWS).astype(int))
    every = times[1] - times[0] if times.size > 1 else 1.0
    extent = (times[0] - every, times[-1], -0.5, values.shape[1] - 0.5)
    axis.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, min_n_ticks=1))
    options: dict[str, Any] = {"aspect": "auto", "origin": "lower", "cmap": "cividis", "interpolation": "nearest"}
    return axis.imshow(values[:, pick].T, extent=extent, **options)


def _recorded(results: Results) -> dict[str, Train]:
    found = {name: train for name, train in results.populations.items() if train.recorded}
    if not found:
        raise ModelError("the results hold no spikes", hint="'neuro run --record NAME' keeps them")
    return found


def _panels(results: Results, what: str, count: int) -> tuple[Figure, Any]:
    height = min(TALLEST_IN, 0.9 + PANEL_IN * count)
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained", dpi=150)
    figure.suptitle(f"{results.about['network']}: {what}", fontsize=13)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time (ms)")
    axes[-1].set_xlim(0.0, results.duration_ms)
    return figure, axes


def _label(axis: Any, title: str, quantity: str) -> None:
    axis.set_title(title, loc="left", fontsize=10)
    axis.set_ylabel(quantity)


def _about(results: Results, train: Train) -> str:
    hz = train.counts["spikes"] / train.size / results.duration_ms * 1000.0
    return f"{train.size:,} neuron{'s' * (train.size != 1)}, {hz:.3g} Hz"


def _chosen(train: Train) -> tuple[Floats, Any, str]:
    if train.times_ms.size <= MOST_DOTS:
        return train.times_ms, train.ids, ""
    chosen = np.random.default_rng(0).choice(train.times_ms.size, MOST_DOTS, replace=False)
    return train.times_ms[chosen], train.ids[chosen], f", {MOST_DOTS:,} of {train.times_ms.size:,} spikes drawn"


def _bin_ms(results: Results) -> float:
    least = max(results.duration_ms / 200.0, float(results.about["resolution_ms"]))
    return next(width for width in _nice() if width >= least)


def _nice() -> Iterator[float]:
    for exponent in range(-4, 12):
        for digit in (1, 2, 5):
            yield float(f"{digit}e{exponent}")
