"""Figures of recorded values: traces of neurons or synapses, maps of many, dots at pre spikes; weights and kernels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from neuro.core.errors import ModelError, nearest, unknown
from neuro.core.values import literal, shown
from neuro.files.recorded import Recorded, StateTrace, SynapseWeights, Window, checked_window, recorded, trains
from neuro.model.views import View
from neuro.plots._canvas import COLOURS, WIDTH_IN, Picture, given, label, legend, over_time, panels, tidy, whole_numbers
from neuro.plots._spikes import raster, rate
from neuro.program.program import Floats

MOST_LINES = 6
MOST_ROWS = 500
MOST_TIMES = 4000
FAINTEST = 0.02


def trace(run: object, probe: Any = None, *, of: Any = None, window: Any = None, ax: Any = None) -> Figure:
    """What a probe recorded: lines of up to six neurons or synapses, a map of more, of very many an even choice.

    What pre spikes leave in synapses is a dot for each, in a colour of its own for each of up to six synapses.

    Args:
        run: a simulation or results.
        probe: a probe or its name, or a list of these, a panel for each; all that recorded states if not given.
            One of several states has a panel for each.
        of: a view of a population, or a list of these, of whose neurons alone what was recorded is drawn.
        window: begin and end in ms; the whole run if not given.
        ax: axes to draw one probe into; a new figure if not given.

    Returns:
        the figure.

    Raises:
        ModelError: there is no such probe, or it recorded nothing.
    """
    source = recorded(run)
    span = checked_window(source, window)
    asked = [(name, seen) for name, found in _asked(source, probe) if (seen := among(found, of)) is not None]
    if not asked:
        raise ModelError(f"of = {shown(of)}: no probe recorded states of these neurons")
    drawn = [(name, _cut(name, found, span)) for name, found in asked]
    if ax is not None:
        if len(drawn) != 1:
            raise ModelError(f"ax is given for {len(drawn)} probes: expected one", hint="name the probe")
        axis = given(ax)
        figure: Figure = axis.get_figure(root=True)
        axes = [axis]
        over_time(axis, span)
    else:
        figure, axes = panels(f"{source.network}: traces", len(drawn), span)
    for axis, (name, found) in zip(axes, drawn, strict=True):
        draw(figure, axis, name, found)
    return figure


def among(found: StateTrace, of: Any) -> StateTrace | None:
    """A trace of those of its neurons that are in some views; None if it has none of them, all if no view is of its."""
    views = [view for view in (of if isinstance(of, (list, tuple)) else [of]) if isinstance(view, View)]
    mine = [view for view in views if view.population.name == found.of]
    if found.noun != "neuron" or not mine:
        return found
    kept = np.flatnonzero(np.isin(found.columns, np.concatenate([view.ids for view in mine])))
    if not kept.size:
        return None
    return replace(found, columns=found.columns[kept], values=found.values[:, kept])


def draw(figure: Figure, axis: Any, name: str, found: StateTrace) -> None:
    """Draw one trace into axes of a figure, and say what it is."""
    quantity = f"{found.state} ({found.unit})" if found.unit else found.state
    title = f"{name}: {'mean ' * (found.noun == '' and found.state != 'rate')}{found.state} of {found.of}"
    if found.at_pre_spikes:
        _dots(axis, found)
        label(axis, f"{title} at pre spikes", quantity)
    elif found.columns.size <= MOST_LINES:
        for column, (called, colour) in enumerate(zip(_called(found), COLOURS, strict=False)):
            axis.plot(found.times_ms, found.values[:, column], color=colour, lw=1.0, label=called)
        if found.columns.size > 1:
            legend(axis, MOST_LINES, "right")
        label(axis, title, quantity)
    else:
        image, note = _map(axis, found)
        figure.colorbar(image, ax=axis, label=quantity, pad=0.01)
        label(axis, title + note, found.noun)


def _called(found: StateTrace) -> list[str]:
    """What each column is of."""
    if found.pre is not None and found.post is not None:
        return [f"{pre} to {post}" for pre, post in zip(found.pre, found.post, strict=True)]
    return [f"{found.noun} {number}" for number in found.columns]


def _dots(axis: Any, found: StateTrace) -> None:
    assert found.pre is not None
    assert found.post is not None
    ends, which = np.unique(np.stack([found.pre, found.post]), axis=1, return_inverse=True)
    if ends.shape[1] > MOST_LINES:
        thin = max(FAINTEST, min(1.0, MOST_TIMES / found.values.size))
        axis.plot(found.times_ms, found.values, ".", color=COLOURS[0], ms=2.0, mew=0.0, alpha=thin, rasterized=True)
        return
    for k, (pre, post) in enumerate(ends.T.tolist()):
        mine = which.ravel() == k
        axis.plot(found.times_ms[mine], found.values[mine], ".", color=COLOURS[k], ms=4.0, label=f"{pre} to {post}")
    if ends.shape[1] > 1:
        legend(axis, MOST_LINES, "right")


def _asked(run: Recorded, probe: Any) -> list[tuple[str, StateTrace]]:
    asked = list(probe) if isinstance(probe, (list, tuple)) else run.probes if probe is None else [probe]
    names = []
    for name in (getattr(each, "name", each) for each in asked):
        mine = [trace for trace, probe in run.probes.items() if name in (trace, probe)]
        if not mine:
            raise unknown("probe of a state", name, run.probes)
        names += mine
    found = [(name, run.trace(name)) for name in names]
    found = [pair for pair in found if pair[1].times_ms.size]
    if not found:
        raise ModelError("no traces were recorded", hint="a probe of a state, such as V_m, records one")
    return found


def _cut(name: str, found: StateTrace, window: Window) -> StateTrace:
    cut = found.within(window)
    if not cut.times_ms.size:
        raise ModelError(f"probe '{name}' recorded nothing in {window[0]:g} to {window[1]:g} ms")
    return cut


def _map(axis: Any, found: StateTrace) -> tuple[Any, str]:
    steps = slice(None, None, -(-found.times_ms.size // MOST_TIMES))
    times, values = found.times_ms[steps], found.values[steps]
    n = found.columns.size
    pick = np.unique(np.linspace(0, n - 1, MOST_ROWS).astype(int))
    every = times[1] - times[0] if times.size > 1 else 1.0
    # Those that a view chose at random are counted by their place in it.
    first = int(found.columns[0]) if (np.diff(found.columns) == 1).all() else 0
    extent = (times[0] - every, times[-1], first - 0.5, first + n - 0.5)
    whole_numbers(axis)
    options: dict[str, Any] = {"aspect": "auto", "origin": "lower", "cmap": "cividis", "interpolation": "nearest"}
    limits = axis.get_xlim()
    image = axis.imshow(values[:, pick].T, extent=extent, **options)
    axis.set_xlim(limits)
    return image, f", {pick.size} of {n:,} {found.noun}s drawn" if pick.size < n else ""


MOST_TRACES = 3
_PANELS_IN = (3.2, 1.6, 1.6)


def overview(run: object, of: Any = None, *, window: Any = None) -> Figure:
    """Raster, rates and traces of a run, one below the other.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; all that was recorded if not given.
        window: begin and end in ms; the whole run if not given.

    Returns:
        the figure; of more than three probes it shows the first three, and says so.

    Raises:
        ModelError: nothing of this was recorded.
    """
    source = recorded(run)
    found = trains(source, of, window)
    probes = list(source.probes) if of is None else []
    drawn = [name for name in probes if source.trace(name).times_ms.size][:MOST_TRACES]
    heights = [_PANELS_IN[0], _PANELS_IN[1], *[_PANELS_IN[2]] * len(drawn)]
    figure = Picture(figsize=(WIDTH_IN, 0.9 + sum(heights)), layout="constrained", dpi=150)
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    neurons = sum(train.neurons.size for train in found)
    title = f"{source.network} on {source.backend}: {source.duration_ms:g} ms, {neurons:,} neurons"
    title += f", {len(drawn)} of {len(probes)} probes" if len(drawn) < len(probes) else ""
    figure.suptitle(literal(title), fontsize=13)
    raster(run, of, window=window, ax=axes[0])
    rate(run, of, window=window, ax=axes[1])
    for axis, name in zip(axes[2:], drawn, strict=True):
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
    """The weights of a projection at the end of a run, or now.

    Args:
        run: a simulation or results.
        projection: the projection or its name.
        kind: "histogram", or "matrix": source by target, white where there is no synapse; of a grid its kernels.
            Several synapses in a cell are drawn as their mean; a matrix of more than 500 lines is drawn in blocks.
            "time": what a probe of the projection recorded of them, as `trace` draws it.
        ax: axes to draw into; a new figure if not given.

    Returns:
        the figure.

    Raises:
        ModelError: there is no such projection, its weights were not kept, or `kind` is another word.
    """
    source = recorded(run)
    name = getattr(projection, "name", projection)
    if kind not in KINDS:
        hint = nearest(str(kind), KINDS)
        raise ModelError(f"kind = {shown(kind)}: expected one of {', '.join(KINDS)}", hint=hint)
    if kind == "time":
        return trace(run, _probe_of(source, name), ax=ax)
    found = source.weights(name)
    if ax is None:
        figure: Figure = Picture(figsize=(7.0, 5.0), layout="constrained", dpi=150)
        axis = figure.subplots()
        figure.suptitle(literal(f"{source.network}: weights"), fontsize=13)
        tidy(axis)
    else:
        axis = given(ax)
        figure = axis.get_figure(root=True)
    if kind == "histogram":
        _histogram(axis, name, found)
    elif found.pre is None:
        _kernels(figure, axis, name, found.weight)
    else:
        _matrix(figure, axis, name, found)
    return figure


def _probe_of(run: Recorded, projection: Any) -> str:
    """The trace of the weights of a projection."""
    found = [name for name in run.probes if (t := run.trace(name)).of == projection and t.state == "weight"]
    if not found:
        hint = f"net.probe('w', '{projection}', 'weight', every=10.0) does"
        raise ModelError(f"no probe recorded the weights of {shown(projection)}", hint=hint)
    return found[0]


def _histogram(axis: Any, name: str, found: SynapseWeights) -> None:
    values = found.weight.ravel()
    axis.set_xlabel("weight")
    if not values.size:
        label(axis, f"{name}: no synapses", "synapses")
        return
    spread = values.std() if values.min() < values.max() else 0.0
    counts, edges = np.histogram(values, BINS)
    axis.stairs(counts, edges, color=COLOURS[0], fill=True, alpha=0.25)
    axis.stairs(counts, edges, color=COLOURS[0])
    label(axis, f"{name}: {values.size:,} weights, {values.mean():.4g} ± {spread:.3g}", "synapses")


def _matrix(figure: Figure, axis: Any, name: str, found: SynapseWeights) -> None:
    assert found.pre is not None
    assert found.post is not None
    blocks = [max(1, -(-n // MOST_CELLS)) for n in found.shape]
    rows, columns = (-(-n // block) for n, block in zip(found.shape, blocks, strict=True))
    cell = (found.pre // blocks[0]) * columns + found.post // blocks[1]
    count = np.bincount(cell, minlength=rows * columns)
    total = np.bincount(cell, found.weight, minlength=rows * columns)
    mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0).reshape(rows, columns)
    extent = (-0.5, columns * blocks[1] - 0.5, rows * blocks[0] - 0.5, -0.5)
    image = axis.imshow(mean, extent=extent, aspect="auto", **_MAP)
    axis.set_xlim(-0.5, found.shape[1] - 0.5)
    axis.set_ylim(found.shape[0] - 0.5, -0.5)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MaxNLocator(nbins=6, integer=True, min_n_ticks=1))
    figure.colorbar(image, ax=axis, label="weight", pad=0.01)
    note = f", means of blocks of {blocks[0]} x {blocks[1]}" if max(blocks) > 1 else ""
    label(axis, f"{name}: {found.weight.size:,} weights{note}", "source neuron")
    axis.set_xlabel("target neuron")


def _kernels(figure: Figure, axis: Any, name: str, kernels: Floats) -> None:
    """Kernels side by side with a line of white between them, by map, then channel."""
    height, width = kernels.shape[2:]
    tiles = kernels.reshape(-1, height, width)
    drawn = tiles[:MOST_KERNELS]
    columns = math.ceil(math.sqrt(len(drawn)))
    rows = -(-len(drawn) // columns)
    sheet = np.full((rows * (height + 1) - 1, columns * (width + 1) - 1), np.nan)
    for k, tile in enumerate(drawn):
        top, left = k // columns * (height + 1), k % columns * (width + 1)
        sheet[top : top + height, left : left + width] = tile
    image = axis.imshow(sheet, **_MAP)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_visible(False)
    figure.colorbar(image, ax=axis, label="weight", pad=0.01)
    note = f", {len(drawn)} of {len(tiles):,} drawn" if len(drawn) < len(tiles) else ""
    label(axis, f"{name}: kernels of {height} x {width}{note}", "")
