"""Spikes as dots, and rates."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.core.quantities import in_ms
from neuro.core.values import literal, shown
from neuro.files.recorded import Recorded, SpikeTrain, intervals, trains, up_to, variation
from neuro.plots._canvas import about, checked_axes, colours, label, legend, over_time, panels, whole_numbers
from neuro.program.program import Floats, Ints

MOST_DOTS = 100_000
MOST_TICKS = 100
MOST_VECTORS = 10_000
MOST_BINS = 100_000
LEAST_BAND = 0.08
"""Smallest height of a population's band, as a share of the heights of all bands."""


def raster(run: object, of: Any = None, *, window: Any = None, ax: Any = None) -> Figure:
    """Draw every spike as a dot, with a panel for each population. Large recordings are thinned evenly, with a note.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; by default all recorded populations.
        window: begin and end in ms; by default the whole run.
        ax: axes to draw into, the populations above each other; by default a new figure.

    Returns:
        the figure.

    Raises:
        ModelError: no spikes of these populations were recorded.
    """
    source = Recorded(run)
    spike_trains = trains(source, of, window)
    if ax is not None:
        return _stacked(spike_trains, checked_axes(ax))
    figure, axes = panels(f"{source.network}: spikes", len(spike_trains), spike_trains[0].window)
    for axis, train, colour in zip(axes, spike_trains, colours(), strict=False):
        times, ids, note = sample_spikes(train, MOST_DOTS)
        first, last = int(train.neurons[0]), int(train.neurons[-1])
        height = 72 * axis.get_position().height * figure.get_figheight()
        _dots(axis, times, ids, colour, height, last - first + 1)
        margin = 0.5 + 0.02 * (last - first + 1)
        axis.set_ylim(first - margin, last + margin)
        whole_numbers(axis)
        label(axis, f"{train.population}: {about(train)}{note}", "neuron")
    return figure


def _stacked(spike_trains: list[SpikeTrain], axis: Any) -> Figure:
    """Draw all populations in a panel, from the bottom up, in bands of visible height."""
    figure: Figure = axis.get_figure(root=True)
    points = 72 * axis.get_position().height * figure.get_figheight()
    sizes = np.array([train.neurons.size for train in spike_trains], dtype=np.float64)
    bands = np.maximum(sizes, LEAST_BAND * sizes.sum())
    bands /= bands.sum()
    ends = np.cumsum(bands)
    notes = []
    for train, colour, end, band in zip(spike_trains, colours(), ends, bands, strict=False):
        times, ids, note = sample_spikes(train, MOST_DOTS // len(spike_trains))
        rows = (np.searchsorted(train.neurons, ids) + 0.5) / max(train.neurons.size, 1)
        _dots(axis, times, end - band + 0.96 * band * rows, colour, points * band, train.neurons.size)
        notes += [train.population + note] if note else []
    axis.set_ylim(0.0, 1.0)
    axis.set_yticks(ends - bands / 2, [literal(train.population) for train in spike_trains])
    axis.tick_params(axis="y", length=0.0)
    label(axis, "; ".join(notes), "")
    over_time(axis, spike_trains[0].window)
    return figure


def _dots(axis: Any, times: Floats, rows: NDArray[Any], colour: str, height: float, n_rows: int) -> None:
    """Draw dots, or ticks if there are few rows, as large as the rows of a panel of this height in points allow."""
    marker, edge = ("|", 0.8) if n_rows <= MOST_TICKS else ("o", 0.0)
    size = float(np.clip(0.8 * height / n_rows, 1.0 if times.size < MOST_DOTS // 5 else 0.6, 12.0))
    # Very many dots would make a file of vectors slow to show.
    axis.plot(times, rows, marker, color=colour, ms=size, mew=edge, rasterized=times.size > MOST_VECTORS)


def sample_spikes(train: SpikeTrain, limit: int) -> tuple[Floats, Ints, str]:
    """Return at most `limit` spikes, chosen evenly and reproducibly, and a note for the title."""
    if train.times_ms.size <= limit:
        return train.times_ms, train.ids, ""
    selection = np.random.default_rng(0).choice(train.times_ms.size, limit, replace=False)
    return train.times_ms[selection], train.ids[selection], f", {limit:,} of {train.times_ms.size:,} spikes drawn"


def rate(run: object, of: Any = None, *, bin: float | str | None = None, window: Any = None, ax: Any = None) -> Figure:
    """Draw the mean rate of a neuron of each population in bins of equal length.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; by default all recorded populations.
        bin: length of a bin in ms, a multiple of the resolution; by default a round one.
        window: begin and end in ms; by default the whole run.
        ax: axes to draw into, all populations in one panel; by default a new figure.

    Returns:
        the figure.

    Raises:
        ModelError: no spikes of these populations were recorded, or the bin is invalid.
    """
    source = Recorded(run)
    spike_trains = trains(source, of, window)
    edges, width = _edges(source, spike_trains[0], bin)
    if ax is not None:
        axis = checked_axes(ax)
        for train, colour in zip(spike_trains, colours(), strict=False):
            axis.stairs(binned(train, edges), edges, color=colour, label=literal(train.population))
        legend(axis, min(len(spike_trains), 6))
        label(axis, "", f"rate (Hz), {width:g} ms bins")
        axis.set_ylim(bottom=0.0)
        over_time(axis, spike_trains[0].window)
        root_figure: Figure = axis.get_figure(root=True)
        return root_figure
    figure, axes = panels(
        f"{source.network}: mean rates in bins of {width:g} ms", len(spike_trains), spike_trains[0].window
    )
    for axis, train, colour in zip(axes, spike_trains, colours(), strict=False):
        hz = binned(train, edges)
        axis.stairs(hz, edges, color=colour, fill=True, alpha=0.25)
        axis.stairs(hz, edges, color=colour)
        axis.set_ylim(bottom=0.0)
        label(axis, f"{train.population}: {about(train)}", "rate (Hz)")
    return figure


def binned(train: SpikeTrain, edges: Floats) -> Floats:
    """Return a neuron's mean rate in Hz between edges in ms. A spike on an edge belongs to the bin that ends there."""
    counts = [up_to(train.times_ms, edge) for edge in edges]
    return np.diff(counts) / max(train.neurons.size, 1) / np.diff(edges) * 1000.0


def _edges(run: Recorded, train: SpikeTrain, bin: float | str | None) -> tuple[Floats, float]:
    begin, end = train.window
    width = _default_bin(run, end - begin) if bin is None else _checked_bin(run, bin, end - begin)
    n_bins = math.ceil((end - begin) / width * (1.0 - 1e-12))
    return np.append(begin + width * np.arange(max(n_bins, 1)), max(end, begin + run.resolution_ms)), width


def _default_bin(run: Recorded, length: float) -> float:
    """Return a round length of bins in ms, rounded up to whole steps."""
    shortest = max(length / 200.0, run.resolution_ms)
    return math.ceil(next(t for t in _round_lengths() if t >= shortest) / run.resolution_ms - 1e-6) * run.resolution_ms


def _checked_bin(run: Recorded, bin: float | str, length: float) -> float:
    """Return a bin width in ms after its check."""
    width = in_ms(bin, "bin")
    if not is_number(width) or not width > 0 or not width < np.inf:
        raise ModelError(f"bin = {shown(bin)}: expected a time > 0 ms")
    if length / width > MOST_BINS:
        raise ModelError(f"bin = {width:g} ms: expected at most {MOST_BINS:,} bins in {length:g} ms")
    clock = Clock(run.resolution_ms)
    return clock.ms(clock.step(width, "bin"))


def _round_lengths() -> Iterator[float]:
    """Yield 1, 2 and 5 times all powers of ten from 1e-4 to 1e11, ascending."""
    for exponent in range(-4, 12):
        for digit in (1, 2, 5):
            yield float(f"{digit}e{exponent}")


BINS = 100
DRAWN = 0.99
"""Share of the intervals that are drawn. The longest intervals would leave no room for the others."""


def isi(run: object, of: Any = None, *, window: Any = None, ax: Any = None) -> Figure:
    """Draw the distribution of intervals between spikes of a neuron, all neurons of a population together.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; by default all recorded populations.
        window: begin and end in ms; by default the whole run.
        ax: axes to draw into, all populations in one panel; by default a new figure.

    Returns:
        the figure, without the longest hundredth of the intervals; a note has the number of intervals that are missing.

    Raises:
        ModelError: no spikes of these populations were recorded.
    """
    step = Recorded(run).resolution_ms

    def draw(axis: Any, train: SpikeTrain, colour: str) -> str:
        lengths, _ = intervals(train.times_ms, train.ids)
        if not lengths.size:
            return "no intervals"
        # Intervals are whole steps. Bins have equal numbers of steps, or some would contain more than their neighbours.
        steps = np.rint(lengths / step)
        most = float(np.quantile(steps, DRAWN, method="higher"))
        width = max(1, math.ceil(most / BINS))
        end = math.ceil((most + 0.5) / width) * width - 0.5
        _histogram(axis, steps * step, np.arange(-0.5, end + width / 2, width) * step, colour)
        n_longer = int((steps > end).sum())
        note = f", {n_longer:,} longer than {end * step:.3g} ms" if n_longer else ""
        return f"{lengths.size:,} intervals, mean {lengths.mean():.3g} ms{note}"

    return _distributions(run, of, window, ax, draw, "intervals between spikes", ("interval (ms)", "intervals"))


def cv(run: object, of: Any = None, *, window: Any = None, ax: Any = None) -> Figure:
    """Draw the distribution of the neurons' coefficients of variation, the irregularity of firing.

    Args:
        run: a simulation or results.
        of: a population, a view of one, a name, or a list of these; by default all recorded populations.
        window: begin and end in ms; by default the whole run.
        ax: axes to draw into, all populations in one panel; by default a new figure.

    Returns:
        the figure; only neurons with two intervals or more have a coefficient, and a note has their number.

    Raises:
        ModelError: no spikes of these populations were recorded.
    """

    def draw(axis: Any, train: SpikeTrain, colour: str) -> str:
        coefficients = variation(train.times_ms, train.ids)
        selection = f"{coefficients.size:,} of {train.neurons.size:,} neurons"
        if not coefficients.size:
            return f"{selection} with two intervals"
        _histogram(axis, coefficients, np.linspace(0.0, max(float(coefficients.max()), 1.0), BINS + 1), colour)
        axis.axvline(coefficients.mean(), color=colour, lw=1.0, ls="--")
        return f"mean {coefficients.mean():.2f} of {selection}"

    return _distributions(run, of, window, ax, draw, "irregularity", ("CV of intervals", "neurons"))


def _distributions(run: object, of: Any, window: Any, ax: Any, draw: Any, title: str, names: tuple[str, str]) -> Figure:
    """Draw each population with a label, in a panel per population, or all in `ax`."""
    source = Recorded(run)
    spike_trains = trains(source, of, window)
    if ax is None:
        figure, axes = panels(f"{source.network}: {title}", len(spike_trains))
        for axis, train, colour in zip(axes, spike_trains, colours(), strict=False):
            label(axis, f"{train.population}: {draw(axis, train, colour)}", names[1])
    else:
        axes = [checked_axes(ax)]
        figure = axes[0].get_figure(root=True)
        for train, colour in zip(spike_trains, colours(), strict=False):
            axes[0].plot([], [], color=colour, label=literal(f"{train.population}: {draw(axes[0], train, colour)}"))
        label(axes[0], "", names[1])
        legend(axes[0], columns=1)
    for axis in axes:
        axis.set_ylim(bottom=0.0)
    axes[-1].set_xlabel(names[0])
    return figure


def _histogram(axis: Any, values: Floats, edges: Floats, colour: str) -> None:
    counts, _ = np.histogram(values, edges)
    axis.stairs(counts, edges, color=colour, fill=True, alpha=0.25)
    axis.stairs(counts, edges, color=colour)
