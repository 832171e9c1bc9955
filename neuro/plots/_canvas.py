"""Colours, panels and axes of all figures, and a figure class for notebooks.

Figures are made without pyplot, so that no window opens, no figure stays in memory and no setting changes. Colours
are those of Okabe and Ito and of cividis, which colour-blind readers can distinguish.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from itertools import cycle
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from neuro.core.errors import ModelError
from neuro.core.values import literal, shown
from neuro.files.recorded import SpikeTrain, Window

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
WIDTH_IN, PANEL_IN, TALLEST_IN = 10.0, 2.2, 60.0


class Picture(Figure):
    """Matplotlib figure that a notebook displays. Write it with `savefig`.

    Attributes:
        titles: texts for the marks of an artist, by `gid` of the artist; a page shows the text under the pointer.
    """

    def __init__(self, *args: Any, **words: Any) -> None:
        super().__init__(*args, **words)
        self.titles: dict[str, list[str]] = {}

    def _repr_png_(self) -> bytes:
        out = BytesIO()
        self.savefig(out, format="png")
        return out.getvalue()


def colours() -> Iterator[str]:
    """Return an endless iterator over the colours."""
    return cycle(COLOURS)


def panels(title: str, count: int, window: Window | None = None) -> tuple[Figure, list[Any]]:
    """Return a figure with panels below each other; with a window the panels share an axis of time."""
    height = min(TALLEST_IN, 0.9 + PANEL_IN * count)
    figure = Picture(figsize=(WIDTH_IN, height), layout="constrained", dpi=150)
    figure.suptitle(literal(title), fontsize=13)
    axes = list(figure.subplots(count, 1, sharex=window is not None, squeeze=False)[:, 0])
    for axis in axes:
        tidy(axis)
    if window is not None:
        over_time(axes[-1], window)
    return figure, axes


def checked_axes(ax: Any) -> Any:
    """Return the axes of a caller without their upper and right frame.

    Raises:
        ModelError: the argument is not axes.
    """
    if not isinstance(ax, Axes):
        raise ModelError(f"ax = {shown(ax)}: expected axes of matplotlib, as plt.gca() gives")
    tidy(ax)
    return ax


def tidy(axis: Any) -> None:
    """Remove the upper and right frame."""
    axis.spines[["top", "right"]].set_visible(False)


def over_time(axis: Any, window: Window) -> None:
    """Label the horizontal axis as biological time and set its limits."""
    axis.set_xlabel("time (ms)")
    begin, end = window
    axis.set_xlim(begin, end if end > begin else begin + 1.0)


def label(axis: Any, title: str, quantity: str) -> None:
    """Set the title of a panel and the label of its vertical axis."""
    axis.set_title(literal(title), loc="left", fontsize=10)
    axis.set_ylabel(literal(quantity))


def legend(axis: Any, columns: int, side: str = "left") -> None:
    """Draw the legend of colours above the panel, outside of the data."""
    corner = (0.0 if side == "left" else 1.0, 1.0)
    place: dict[str, Any] = {"loc": f"lower {side}", "bbox_to_anchor": corner, "borderaxespad": 0.2}
    axis.legend(ncols=columns, frameon=False, fontsize="small", handlelength=1.2, **place)


def whole_numbers(axis: Any) -> None:
    """Set ticks at whole numbers."""
    axis.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, min_n_ticks=1))


def about(train: SpikeTrain) -> str:
    """Return the number of neurons and their mean rate as text."""
    n = train.neurons.size
    return f"{n:,} neuron{'s' * (n != 1)}, {train.rate_hz:.3g} Hz"
