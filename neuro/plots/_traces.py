"""Figures of recorded values: traces, maps of many neurons or synapses, dots at pre spikes, weights and kernels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from neuro.core.errors import ModelError, nearest, unknown
from neuro.core.values import literal, shown
from neuro.files.parts import Trace
from neuro.files.recorded import Recorded, SynapseWeights, Window, checked_window, trains, within
from neuro.model.views import View
from neuro.plots._canvas import (
    COLOURS,
    WIDTH_IN,
    Picture,
    checked_axes,
    label,
    legend,
    over_time,
    panels,
    tidy,
    whole_numbers,
)
from neuro.plots._spikes import raster, rate
from neuro.program.program import Floats

MOST_LINES = 6
MOST_ROWS = 500
MOST_TIMES = 4000
FAINTEST = 0.02


def trace(run: object, probe: Any = None, *, of: Any = None, window: Any = None, ax: Any = None) -> Figure:
    """Draw the traces of probes: lines for up to six neurons or synapses, else a map. Large maps are thinned.

    Values at pre spikes are dots, with one colour for each of up to six synapses.

    Args:
        run: a simulation or results.
        probe: a probe, its name, or a list of these, with a panel for each; by default all probes of states. A probe
            of several states has a panel for each.
        of: a view of a population, or a list of views; only their neurons are drawn.
        window: begin and end in ms; by default the whole run.
        ax: axes to draw one probe into; by default a new figure.

    Returns:
        the figure.

    Raises:
        ModelError: the probe does not exist, or recorded no values.
    """
    source = Recorded(run)
    span = checked_window(source, window)
    all_traces = _traces(source, probe)
    selected = [(name, part) for name, state_trace in all_traces if (part := among(state_trace, of)) is not None]
    if not selected:
        raise ModelError(f"of = {shown(of)}: no probe recorded states of these neurons")
    traces = [(name, _cut(name, part, span)) for name, part in selected]
    if ax is not None:
        if len(traces) != 1:
            raise ModelError(f"ax is given for {len(traces)} probes: expected one", hint="name the probe")
        axis = checked_axes(ax)
        figure: Figure = axis.get_figure(root=True)
        axes = [axis]
        over_time(axis, span)
    else:
        figure, axes = panels(f"{source.network}: traces", len(traces), span)
    for axis, (name, part) in zip(axes, traces, strict=True):
        draw(figure, axis, name, part)
    return figure


def among(state_trace: Trace, of: Any) -> Trace | None:
    """Return the part of a trace for the neurons in some views.

    The whole trace is returned if no view belongs to the recorded population. The result is None if the views of that
    population contain no recorded neuron.
    """
    views = [view for view in (of if isinstance(of, (list, tuple)) else [of]) if isinstance(view, View)]
    own_views = [view for view in views if view.population.name == state_trace.of]
    if state_trace.noun != "neuron" or not own_views:
        return state_trace
    columns = np.flatnonzero(np.isin(state_trace.ids, np.concatenate([view.ids for view in own_views])))
    if not columns.size:
        return None
    return replace(state_trace, ids=state_trace.ids[columns], values=state_trace.values[:, columns])


def draw(figure: Figure, axis: Any, name: str, part: Trace) -> None:
    """Draw one trace into axes of a figure, with title and labels."""
    quantity = f"{part.state} ({part.unit})" if part.unit else part.state
    title = f"{name}: {'mean ' * (part.noun == '' and part.state != 'rate')}{part.state} of {part.of}"
    if part.at_pre_spikes:
        _dots(axis, part)
        label(axis, f"{title} at pre spikes", quantity)
    elif part.ids.size <= MOST_LINES:
        for column, (name_of_line, colour) in enumerate(zip(_column_names(part), COLOURS, strict=False)):
            axis.plot(part.times_ms, part.values[:, column], color=colour, lw=1.0, label=name_of_line)
        if part.ids.size > 1:
            legend(axis, MOST_LINES, "right")
        label(axis, title, quantity)
    else:
        image, note = _map(axis, part)
        figure.colorbar(image, ax=axis, label=quantity, pad=0.01)
        label(axis, title + note, part.noun)


def _column_names(part: Trace) -> list[str]:
    """Return a name for each column, e.g. "neuron 3", or "3 to 7" for a synapse."""
    if part.pre is not None and part.post is not None:
        return [f"{pre} to {post}" for pre, post in zip(part.pre, part.post, strict=True)]
    return [f"{part.noun} {number}" for number in part.ids]


def _dots(axis: Any, part: Trace) -> None:
    assert part.pre is not None
    assert part.post is not None
    ends, synapse_index = np.unique(np.stack([part.pre, part.post]), axis=1, return_inverse=True)
    if ends.shape[1] > MOST_LINES:
        opacity = max(FAINTEST, min(1.0, MOST_TIMES / part.values.size))
        axis.plot(part.times_ms, part.values, ".", color=COLOURS[0], ms=2.0, mew=0.0, alpha=opacity, rasterized=True)
        return
    for k, (pre, post) in enumerate(ends.T.tolist()):
        rows = synapse_index.ravel() == k
        axis.plot(part.times_ms[rows], part.values[rows], ".", color=COLOURS[k], ms=4.0, label=f"{pre} to {post}")
    if ends.shape[1] > 1:
        legend(axis, MOST_LINES, "right")


def _traces(run: Recorded, probe: Any) -> list[tuple[str, Trace]]:
    probes = list(probe) if isinstance(probe, (list, tuple)) else run.probes if probe is None else [probe]
    names = []
    for name in (getattr(item, "name", item) for item in probes):
        of_probe = [trace for trace, probe in run.probes.items() if name in (trace, probe)]
        if not of_probe:
            raise unknown("probe of a state", name, run.probes)
        names += of_probe
    traces = [(name, run.trace(name)) for name in names]
    traces = [pair for pair in traces if pair[1].times_ms.size]
    if not traces:
        raise ModelError("no traces were recorded", hint="add a probe of a state, such as V_m")
    return traces


def _cut(name: str, part: Trace, window: Window) -> Trace:
    cut = within(part, window)
    if not cut.times_ms.size:
        raise ModelError(f"probe '{name}' recorded nothing in {window[0]:g} to {window[1]:g} ms")
    return cut


def _map(axis: Any, part: Trace) -> tuple[Any, str]:
    steps = slice(None, None, -(-part.times_ms.size // MOST_TIMES))
    times, values = part.times_ms[steps], part.values[steps]
    n = part.ids.size
    rows = np.unique(np.linspace(0, n - 1, MOST_ROWS).astype(int))
    interval = times[1] - times[0] if times.size > 1 else 1.0
    # Columns that are not consecutive neurons are numbered by their place in the view.
    first = int(part.ids[0]) if (np.diff(part.ids) == 1).all() else 0
    extent = (times[0] - interval, times[-1], first - 0.5, first + n - 0.5)
    whole_numbers(axis)
    options: dict[str, Any] = {"aspect": "auto", "origin": "lower", "cmap": "cividis", "interpolation": "nearest"}
    limits = axis.get_xlim()
    image = axis.imshow(values[:, rows].T, extent=extent, **options)
    axis.set_xlim(limits)
    return image, f", {rows.size} of {n:,} {part.noun}s drawn" if rows.size < n else ""


MOST_TRACES = 3
_PANELS_IN = (3.2, 1.6, 1.6)


def overview(run: object, of: Any = None, *, window: Any = None) -> Figure:
    """Draw raster, rates and traces of a run, one below the other.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; by default all recorded populations.
        window: begin and end in ms; by default the whole run.

    Returns:
        the figure, with the first three probes; the title has the number of all probes.

    Raises:
        ModelError: no spikes of these populations were recorded.
    """
    source = Recorded(run)
    spike_trains = trains(source, of, window)
    probes = list(source.probes) if of is None else []
    first_probes = [name for name in probes if source.trace(name).times_ms.size][:MOST_TRACES]
    heights = [_PANELS_IN[0], _PANELS_IN[1], *[_PANELS_IN[2]] * len(first_probes)]
    figure = Picture(figsize=(WIDTH_IN, 0.9 + sum(heights)), layout="constrained", dpi=150)
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    neurons = sum(train.neurons.size for train in spike_trains)
    title = f"{source.network} on {source.backend}: {source.duration_ms:g} ms, {neurons:,} neurons"
    title += f", {len(first_probes)} of {len(probes)} probes" if len(first_probes) < len(probes) else ""
    figure.suptitle(literal(title), fontsize=13)
    raster(run, of, window=window, ax=axes[0])
    rate(run, of, window=window, ax=axes[1])
    for axis, name in zip(axes[2:], first_probes, strict=True):
        trace(run, name, window=window, ax=axis)
    for axis in axes[:-1]:
        axis.set_xlabel("")
    return figure


BINS = 100
MOST_CELLS = 500
MOST_KERNELS = 100
KINDS = ("histogram", "matrix", "time")
_MAP: dict[str, Any] = {"cmap": "cividis", "interpolation": "nearest"}


def weights(run: object, projection: Any, kind: str = "histogram", *, ax: Any = None) -> Figure:
    """Draw the weights of a projection: the weights at the end of a run, or the present weights of a simulation.

    Args:
        run: a simulation or results.
        projection: the projection or its name.
        kind: "histogram"; "matrix", source by target, or the kernels of a grid; or "time", the trace of a probe of the
            weights. A cell of the matrix is white without a synapse, and shows the mean of several synapses. A matrix
            of more than 500 lines is drawn in blocks.
        ax: axes to draw into; by default a new figure.

    Returns:
        the figure.

    Raises:
        ModelError: the projection does not exist, its weights were not stored, or `kind` is another word.
    """
    source = Recorded(run)
    name = getattr(projection, "name", projection)
    if kind not in KINDS:
        hint = nearest(str(kind), KINDS)
        raise ModelError(f"kind = {shown(kind)}: expected one of {', '.join(KINDS)}", hint=hint)
    if kind == "time":
        return trace(run, _probe_of(source, name), ax=ax)
    synapses = source.weights(name)
    if ax is None:
        figure: Figure = Picture(figsize=(7.0, 5.0), layout="constrained", dpi=150)
        axis = figure.subplots()
        figure.suptitle(literal(f"{source.network}: weights"), fontsize=13)
        tidy(axis)
    else:
        axis = checked_axes(ax)
        figure = axis.get_figure(root=True)
    if kind == "histogram":
        _histogram(axis, name, synapses)
    elif synapses.pre is None:
        _kernels(figure, axis, name, synapses.weight)
    else:
        _matrix(figure, axis, name, synapses)
    return figure


def _probe_of(run: Recorded, projection: Any) -> str:
    """Return the name of the trace of a projection's weights."""
    names = [name for name in run.probes if (t := run.trace(name)).of == projection and t.state == "weight"]
    if not names:
        hint = f"net.probe('w', '{projection}', 'weight', every=10.0) does"
        raise ModelError(f"no probe recorded the weights of {shown(projection)}", hint=hint)
    return names[0]


def _histogram(axis: Any, name: str, synapses: SynapseWeights) -> None:
    values = synapses.weight.ravel()
    axis.set_xlabel("weight")
    if not values.size:
        label(axis, f"{name}: no synapses", "synapses")
        return
    spread = values.std() if values.min() < values.max() else 0.0
    counts, edges = np.histogram(values, BINS)
    axis.stairs(counts, edges, color=COLOURS[0], fill=True, alpha=0.25)
    axis.stairs(counts, edges, color=COLOURS[0])
    label(axis, f"{name}: {values.size:,} weights, {values.mean():.4g} ± {spread:.3g}", "synapses")


def _matrix(figure: Figure, axis: Any, name: str, synapses: SynapseWeights) -> None:
    assert synapses.pre is not None
    assert synapses.post is not None
    blocks = [max(1, -(-n // MOST_CELLS)) for n in synapses.shape]
    rows, columns = (-(-n // block) for n, block in zip(synapses.shape, blocks, strict=True))
    cell = (synapses.pre // blocks[0]) * columns + synapses.post // blocks[1]
    count = np.bincount(cell, minlength=rows * columns)
    total = np.bincount(cell, synapses.weight, minlength=rows * columns)
    mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0).reshape(rows, columns)
    extent = (-0.5, columns * blocks[1] - 0.5, rows * blocks[0] - 0.5, -0.5)
    image = axis.imshow(mean, extent=extent, aspect="auto", **_MAP)
    axis.set_xlim(-0.5, synapses.shape[1] - 0.5)
    axis.set_ylim(synapses.shape[0] - 0.5, -0.5)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MaxNLocator(nbins=6, integer=True, min_n_ticks=1))
    figure.colorbar(image, ax=axis, label="weight", pad=0.01)
    note = f", means of blocks of {blocks[0]} x {blocks[1]}" if max(blocks) > 1 else ""
    label(axis, f"{name}: {synapses.weight.size:,} weights{note}", "source neuron")
    axis.set_xlabel("target neuron")


def _kernels(figure: Figure, axis: Any, name: str, kernels: Floats) -> None:
    """Draw kernels side by side with white lines between them, by map, then channel."""
    height, width = kernels.shape[2:]
    tiles = kernels.reshape(-1, height, width)
    drawn_tiles = tiles[:MOST_KERNELS]
    columns = math.ceil(math.sqrt(len(drawn_tiles)))
    rows = -(-len(drawn_tiles) // columns)
    sheet = np.full((rows * (height + 1) - 1, columns * (width + 1) - 1), np.nan)
    for k, tile in enumerate(drawn_tiles):
        top, left = k // columns * (height + 1), k % columns * (width + 1)
        sheet[top : top + height, left : left + width] = tile
    image = axis.imshow(sheet, **_MAP)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_visible(False)
    figure.colorbar(image, ax=axis, label="weight", pad=0.01)
    note = f", {len(drawn_tiles)} of {len(tiles):,} drawn" if len(drawn_tiles) < len(tiles) else ""
    label(axis, f"{name}: kernels of {height} x {width}{note}", "")
