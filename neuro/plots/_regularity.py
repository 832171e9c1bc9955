"""How regularly neurons fire: intervals between spikes, and how much they vary."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from neuro.core.values import literal
from neuro.files.recorded import Train, recorded, trains
from neuro.plots._canvas import colours, given, label, legend, panels
from neuro.program.program import Floats, Ints

BINS = 100
DRAWN = 0.99
"""The share of intervals that is drawn: the longest would leave no room for the others."""


def intervals(train: Train) -> tuple[Floats, Ints]:
    """The intervals between spikes of the same neuron in ms, and whose they are, by neuron, then time."""
    order = np.lexsort((train.times_ms, train.ids))
    times, ids = train.times_ms[order], train.ids[order]
    same = ids[1:] == ids[:-1]
    return np.diff(times)[same], ids[1:][same]


def variation(train: Train) -> Floats:
    """The coefficient of variation of the intervals of each neuron that has two or more, by neuron.

    Standard deviation (of the intervals themselves, not of those they are drawn from) by mean; 1 of a Poisson process.
    Intervals that are all 0, of neurons that emit several spikes in one step and no others, have none.
    Source: Softky & Koch, J. Neurosci. 13:334, 1993
    """
    lengths, ids = intervals(train)
    _, whose, count = np.unique(ids, return_inverse=True, return_counts=True)
    mean = np.bincount(whose, lengths) / count
    square = np.bincount(whose, (lengths - mean[whose]) ** 2) / count
    told = (count >= 2) & (mean > 0)
    return np.asarray(np.sqrt(square[told]) / mean[told])


def isi(run: object, of: Any = None, *, window: Any = None, ax: Any = None) -> Figure:
    """How long the intervals between spikes of a neuron are, of all neurons of a population together.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; all that was recorded if not given.
        window: begin and end in ms; the whole run if not given.
        ax: axes to draw into, all populations in one panel; a new figure if not given.

    Returns:
        the figure. The longest hundredth of the intervals is not drawn, and said.

    Raises:
        ModelError: nothing of this was recorded.
    """
    step = recorded(run).resolution_ms

    def draw(axis: Any, train: Train, colour: str) -> str:
        lengths, _ = intervals(train)
        if not lengths.size:
            return "no intervals"
        # Intervals are whole steps: bins of as many steps each, or some would hold more than their neighbours.
        steps = np.rint(lengths / step)
        most = float(np.quantile(steps, DRAWN, method="higher"))
        width = max(1, math.ceil(most / BINS))
        last = math.ceil((most + 0.5) / width) * width - 0.5
        _histogram(axis, steps * step, np.arange(-0.5, last + width / 2, width) * step, colour)
        beyond = int((steps > last).sum())
        note = f", {beyond:,} longer than {last * step:.3g} ms" if beyond else ""
        return f"{lengths.size:,} intervals, mean {lengths.mean():.3g} ms{note}"

    return _each(run, of, window, ax, draw, "intervals between spikes", ("interval (ms)", "intervals"))


def cv(run: object, of: Any = None, *, window: Any = None, ax: Any = None) -> Figure:
    """How irregularly the neurons of a population fire: the coefficient of variation of each one's intervals.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; all that was recorded if not given.
        window: begin and end in ms; the whole run if not given.
        ax: axes to draw into, all populations in one panel; a new figure if not given.

    Returns:
        the figure. Only neurons with two intervals or more have a coefficient; how many is said.

    Raises:
        ModelError: nothing of this was recorded.
    """

    def draw(axis: Any, train: Train, colour: str) -> str:
        found = variation(train)
        of = f"{found.size:,} of {train.neurons.size:,} neurons"
        if not found.size:
            return f"{of} with two intervals"
        _histogram(axis, found, np.linspace(0.0, max(float(found.max()), 1.0), BINS + 1), colour)
        axis.axvline(found.mean(), color=colour, lw=1.0, ls="--")
        return f"mean {found.mean():.2f} of {of}"

    return _each(run, of, window, ax, draw, "irregularity", ("CV of intervals", "neurons"))


def _each(run: object, of: Any, window: Any, ax: Any, draw: Any, what: str, words: tuple[str, str]) -> Figure:
    """Draw each population, in its panel or all in one, and say what it shows."""
    told = recorded(run)
    found = trains(told, of, window)
    if ax is None:
        figure, axes = panels(f"{told.network}: {what}", len(found))
        for axis, train, colour in zip(axes, found, colours(), strict=False):
            label(axis, f"{train.population}: {draw(axis, train, colour)}", words[1])
    else:
        axes = [given(ax)]
        figure = axes[0].get_figure(root=True)
        for train, colour in zip(found, colours(), strict=False):
            axes[0].plot([], [], color=colour, label=literal(f"{train.population}: {draw(axes[0], train, colour)}"))
        label(axes[0], "", words[1])
        legend(axes[0], columns=1)
    for axis in axes:
        axis.set_ylim(bottom=0.0)
    axes[-1].set_xlabel(words[0])
    return figure


def _histogram(axis: Any, values: Floats, edges: Floats, colour: str) -> None:
    counts, _ = np.histogram(values, edges)
    axis.stairs(counts, edges, color=colour, fill=True, alpha=0.25)
    axis.stairs(counts, edges, color=colour)
