"""What probes recorded: lines of a few neurons, a map of many."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from neuro.core.errors import ModelError, unknown
from neuro.files.recorded import Recorded, Trace, Window, checked_window, recorded, up_to
from neuro.plots._canvas import COLOURS, given, label, legend, over_time, panels, whole_numbers

MOST_LINES = 6
MOST_ROWS = 500
MOST_TIMES = 4000


def trace(run: object, probe: Any = None, *, window: Any = None, ax: Any = None) -> Figure:
    """What a probe recorded: lines of up to six neurons, a map of more; of very many an even choice is drawn.

    Args:
        run: a simulation or results.
        probe: a probe or its name, or a list of these, a panel for each; all probes of states if not given.
        window: begin and end in ms; the whole run if not given.
        ax: axes to draw one probe into; a new figure if not given.

    Returns:
        the figure.

    Raises:
        ModelError: there is no such probe, or it recorded nothing.
    """
    told = recorded(run)
    span = checked_window(told, window)
    shown = [_cut(found, span) for found in _asked(told, probe)]
    if ax is not None:
        if len(shown) != 1:
            raise ModelError(f"ax is given for {len(shown)} probes: expected one", hint="name the probe")
        axis = given(ax)
        figure: Figure = axis.get_figure(root=True)
        axes = [axis]
        over_time(axis, span)
    else:
        figure, axes = panels(f"{told.network}: traces", len(shown), span)
    for axis, (name, found) in zip(axes, shown, strict=True):
        draw(figure, axis, name, found)
    return figure


def draw(figure: Figure, axis: Any, name: str, found: Trace) -> None:
    """Draw one trace into axes of a figure, and say what it is."""
    quantity = f"{found.state} ({found.unit})" if found.unit else found.state
    title = f"{name}: {found.state} of {found.population}"
    if found.neurons.size <= MOST_LINES:
        for column, (neuron, colour) in enumerate(zip(found.neurons, COLOURS, strict=False)):
            axis.plot(found.times_ms, found.values[:, column], color=colour, lw=1.0, label=f"neuron {neuron}")
        if found.neurons.size > 1:
            legend(axis, MOST_LINES, "right")
        label(axis, title, quantity)
        return
    image, note = _map(axis, found)
    figure.colorbar(image, ax=axis, label=quantity, pad=0.01)
    label(axis, title + note, "neuron")


def _asked(run: Recorded, probe: Any) -> list[tuple[str, Trace]]:
    asked = list(probe) if isinstance(probe, (list, tuple)) else run.probes if probe is None else [probe]
    names = [getattr(each, "name", each) for each in asked]
    for name in names:
        if name not in run.probes:
            raise unknown("probe of a state", name, run.probes)
    found = [(name, run.trace(name)) for name in names]
    found = [pair for pair in found if pair[1].times_ms.size]
    if not found:
        raise ModelError("no traces were recorded", hint="a probe of a state, such as V_m, records one")
    return found


def _cut(found: tuple[str, Trace], window: Window) -> tuple[str, Trace]:
    """What a probe recorded in a window, its begin and end included."""
    name, t = found
    inside = slice(int(np.searchsorted(t.times_ms, window[0])), up_to(t.times_ms, window[1]))
    if not t.times_ms[inside].size:
        raise ModelError(f"probe '{name}' recorded nothing in {window[0]:g} to {window[1]:g} ms")
    return name, Trace(t.population, t.state, t.unit, t.neurons, t.times_ms[inside], t.values[inside])


def _map(axis: Any, found: Trace) -> tuple[Any, str]:
    steps = slice(None, None, -(-found.times_ms.size // MOST_TIMES))
    times, values = found.times_ms[steps], found.values[steps]
    n = found.neurons.size
    pick = np.unique(np.linspace(0, n - 1, MOST_ROWS).astype(int))
    every = times[1] - times[0] if times.size > 1 else 1.0
    # Neurons that a view chose at random are counted by their place in it.
    first = int(found.neurons[0]) if (np.diff(found.neurons) == 1).all() else 0
    extent = (times[0] - every, times[-1], first - 0.5, first + n - 0.5)
    whole_numbers(axis)
    options: dict[str, Any] = {"aspect": "auto", "origin": "lower", "cmap": "cividis", "interpolation": "nearest"}
    limits = axis.get_xlim()
    image = axis.imshow(values[:, pick].T, extent=extent, **options)
    axis.set_xlim(limits)
    return image, f", {pick.size} of {n:,} neurons drawn" if pick.size < n else ""
