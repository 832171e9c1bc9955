"""Boxes on frames of events, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from neuro.apps import literal
from neuro.events import Events
from neuro_recognise.detection.boxes import UNKNOWN, Boxes
from neuro_recognise.detection.watching import COLOURS
from neuro_recognise.telling.pictures import INK, PAPER

__all__ = ["drawn"]

MOST = 9
"""Frames of a picture; of more an even choice is drawn."""
SHADES = ("#dde3ea", "#b6c2cf", "#8fa0b3", "#66788e")
"""Of pixels with 1, 2, 3 or more events."""


def drawn(events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> Figure:
    """Some frames with their boxes, in the order of time.

    Args:
        events: of the recording.
        boxes: that were found.
        classes: names.
        title: of the picture.
    """
    spans = boxes.spans()
    spans = spans[np.unique(np.linspace(0, len(spans) - 1, min(MOST, len(spans))).round().astype(int))]
    columns = max(1, min(3, len(spans)))
    rows = max(1, -(-len(spans) // columns))
    width, height = events.sensor_size
    figure = Figure(
        figsize=(3.4 * columns, (3.4 * height / width + 0.35) * rows + 0.4), dpi=140, layout="constrained",
        facecolor=PAPER,
    )  # fmt: skip
    figure.suptitle(literal(title), x=0.01, ha="left", fontsize=11, color=INK)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(spans) :]:
        axis.set_visible(False)
    for axis, (start, stop) in zip(axes, spans.tolist(), strict=False):
        axis.imshow(_picture(events.between(start, stop)), interpolation="nearest")
        _draw(axis, boxes[(boxes.start == start) & (boxes.stop == stop)], classes)
        axis.set_title(f"{start / 1000:.0f} to {stop / 1000:.0f} ms", loc="left", fontsize=8, color=INK)
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_color("#e4e8ee")
    return figure


def _picture(events: Events) -> Any:
    """(height, width, 3) the more events a pixel has, the darker."""
    from matplotlib.colors import to_rgb

    from neuro.events import representations

    shades = np.array([to_rgb(colour) for colour in (PAPER, *SHADES)])
    counts = np.asarray(representations.event_frame(events, polarity="ignored"))
    return shades[np.minimum(counts, len(SHADES))]


def _draw(axis: Any, boxes: Boxes, classes: Sequence[str]) -> None:
    for k in range(len(boxes)):
        left, top, right, bottom = boxes.box[k] - 0.5
        colour = COLOURS[int(boxes.identity[k]) % len(COLOURS)]
        axis.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, edgecolor=colour, linewidth=1.6))
        name = "?" if boxes.label[k] == UNKNOWN else classes[boxes.label[k]]
        above = top > 7
        axis.text(left, top - 0.6 if above else bottom + 0.6, f"{literal(name)}  #{boxes.identity[k]}", color=colour,
                  fontsize=8, fontweight="bold", va="bottom" if above else "top", clip_on=True)  # fmt: skip
