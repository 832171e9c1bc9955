"""What all pictures share: colours, panels, and a figure that shows itself in a notebook.

Figures are made without pyplot, so that no window opens, nothing stays behind and no setting is changed.
Colours are those of Okabe and Ito and of cividis, which colour-blind readers can distinguish.
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
    """A figure of matplotlib; a notebook shows it, `savefig` writes it.

    Attributes:
        titles: by the `gid` of an artist, a text for each of its marks, which a page shows when one is pointed at.
    """

    def __init__(self, *args: Any, **words: Any) -> None:
        super().__init__(*args, **words)
        self.titles: dict[str, list[str]] = {}

    def _repr_png_(self) -> bytes:
        out = BytesIO()
        self.savefig(out, format="png")
        return out.getvalue()


def colours() -> Iterator[str]:
    """The colours, again and again."""
    return cycle(COLOURS)


def panels(title: str, count: int, window: Window | None = None) -> tuple[Figure, list[Any]]:
    """A figure with panels below each other, which share an axis of time where a window is given."""
    height = min(TALLEST_IN, 0.9 + PANEL_IN * count)
    figure = Picture(figsize=(WIDTH_IN, height), layout="constrained", dpi=150)
    figure.suptitle(literal(title), fontsize=13)
    axes = list(figure.subplots(count, 1, sharex=window is not None, squeeze=False)[:, 0])
    for axis in axes:
        tidy(axis)
    if window is not None:
        over_time(axes[-1], window)
    return figure, axes


def given(ax: Any) -> Any:
    """The axes that a caller gave to draw into, and their figure.

    Raises:
        ModelError: these are none.
    """
    if not isinstance(ax, Axes):
        raise ModelError(f"ax = {shown(ax)}: expected axes of matplotlib, as plt.gca() gives")
    tidy(ax)
    return ax


def tidy(axis: Any) -> None:
    """No frame above and to the right."""
    axis.spines[["top", "right"]].set_visible(False)


def over_time(axis: Any, window: Window) -> None:
    """Let the axis to the right be biological time."""
    axis.set_xlabel("time (ms)")
    begin, end = window
    axis.set_xlim(begin, end if end > begin else begin + 1.0)


def label(axis: Any, title: str, quantity: str) -> None:
    """Say what is drawn, and what goes up."""
    axis.set_title(literal(title), loc="left", fontsize=10)
    axis.set_ylabel(literal(quantity))


def legend(axis: Any, columns: int, side: str = "left") -> None:
    """Say above the panel, where it covers nothing, which colour is what."""
    corner = (0.0 if side == "left" else 1.0, 1.0)
    place: dict[str, Any] = {"loc": f"lower {side}", "bbox_to_anchor": corner, "borderaxespad": 0.2}
    axis.legend(ncols=columns, frameon=False, fontsize="small", handlelength=1.2, **place)


def whole_numbers(axis: Any) -> None:
    """Ticks at numbers of neurons."""
    axis.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, min_n_ticks=1))


def about(train: SpikeTrain) -> str:
    """How many neurons there are and how fast they fire."""
    n = train.neurons.size
    return f"{n:,} neuron{'s' * (n != 1)}, {train.rate_hz:.3g} Hz"
