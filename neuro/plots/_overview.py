"""A run at a glance."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from neuro.core.values import literal
from neuro.files.recorded import recorded, trains
from neuro.plots._canvas import WIDTH_IN, Picture
from neuro.plots._spikes import raster, rate
from neuro.plots._traces import trace

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
    told = recorded(run)
    found = trains(told, of, window)
    probes = list(told.probes) if of is None else []
    drawn = [name for name in probes if told.trace(name).times_ms.size][:MOST_TRACES]
    heights = [_PANELS_IN[0], _PANELS_IN[1], *[_PANELS_IN[2]] * len(drawn)]
    figure = Picture(figsize=(WIDTH_IN, 0.9 + sum(heights)), layout="constrained", dpi=150)
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    neurons = sum(train.neurons.size for train in found)
    title = f"{told.network} on {told.backend}: {told.duration_ms:g} ms, {neurons:,} neurons"
    title += f", {len(drawn)} of {len(probes)} probes" if len(drawn) < len(probes) else ""
    figure.suptitle(literal(title), fontsize=13)
    raster(run, of, window=window, ax=axes[0])
    rate(run, of, window=window, ax=axes[1])
    for axis, name in zip(axes[2:], drawn, strict=True):
        trace(run, name, window=window, ax=axis)
    for axis in axes[:-1]:
        axis.set_xlabel("")
    return figure
