"""Weights: how they are distributed, from where to where they lead, and how they change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from neuro.core.errors import ModelError, nearest
from neuro.core.values import literal, shown
from neuro.files.recorded import Recorded, SynapseWeights, recorded
from neuro.plots._canvas import COLOURS, Picture, given, label, tidy
from neuro.plots._traces import trace
from neuro.program.program import Floats

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
