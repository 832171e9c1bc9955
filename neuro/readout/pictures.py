"""A picture of what the output does while it is shown recordings."""

from __future__ import annotations

import math
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from neuro.chips.energy import number
from neuro.core.values import literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from neuro.readout.predict import Predictions

MOST = 24
"""Recordings that are drawn, the first ones."""
COLUMNS = 4
DECIDED, OTHER = "#0072B2", "0.6"
NAMED = 20
"""Classes up to which each has its name at the axis."""


def draw(found: Predictions) -> Figure:
    """A panel for each recording that was kept: spikes or potentials of all classes, the decided one in blue."""
    from matplotlib.figure import Figure

    columns = min(COLUMNS, len(found.shown))
    rows = math.ceil(len(found.shown) / columns)
    tall = 1.0 + 0.11 * min(NAMED, len(found.readout.classes))
    figure = Figure(figsize=(3.2 * columns + 0.6, tall * rows + 0.8), dpi=130, layout="constrained")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False).reshape(-1)
    for k, axis in enumerate(axes):
        if k < len(found.shown):
            _panel(axis, found, k)
        else:
            axis.set_visible(False)
    more = len(found.names) - len(found.shown)
    some = f"; the first {len(found.shown)} of {len(found.names)} recordings" if more else ""
    asked = found.readout
    figure.suptitle(literal(f"'{asked.output}' on {found.backend} decides by {asked.decide}{some}"), fontsize=11)
    figure.supxlabel("time (ms)", fontsize=10)
    return figure


def _panel(axis: Any, found: Predictions, k: int) -> None:
    """What the output does in one recording."""
    shown, decided = found.shown[k], int(found.decided[k])
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(labelsize=7)
    axis.set_xlim(0.0, shown.ms)
    if shown.V_m is None:
        mine = shown.ids == decided
        for chosen, colour in ((~mine, OTHER), (mine, DECIDED)):
            axis.plot(shown.times[chosen], shown.ids[chosen], "|", color=colour, markersize=6, markeredgewidth=1.0)
        _name_classes(axis, found, k)
    else:
        times = [shown.ms * (step + 1) / len(shown.V_m) for step in range(len(shown.V_m))]
        for neuron, trace in enumerate(shown.V_m.T):
            colour, width = (DECIDED, 1.4) if neuron == decided else (OTHER, 0.6)
            axis.plot(times, trace, color=colour, linewidth=width, zorder=2 + (neuron == decided))
        axis.set_ylabel("V_m (mV)", fontsize=8)
    label = "" if found.labels is None else f" (shown: {found.readout.classes[found.labels[k]]})"
    wrong = found.labels is not None and found.labels[k] != decided
    path = PurePath(shown.name)
    title = f"{path.parent.name}/{path.name}: {found.class_of(k) or 'nothing'}{label}"
    axis.set_title(literal(title), fontsize=8, loc="left", color="#D55E00" if wrong else "black")


def _name_classes(axis: Any, found: Predictions, k: int) -> None:
    """A row for each class, with its score to the right."""
    classes, scores, decided = found.readout.classes, found.scores[k], found.decided[k]
    axis.set_ylim(len(classes) - 0.5, -0.5)
    if len(classes) > NAMED:
        return
    axis.set_yticks(range(len(classes)), [literal(name) for name in classes])
    place = {"transform": axis.get_yaxis_transform(), "fontsize": 6, "va": "center"}
    for neuron in range(len(classes)):
        if scores[neuron] > 0.0:  # no NaN
            colour = DECIDED if neuron == decided else OTHER
            axis.text(1.03, neuron, number(float(scores[neuron])), color=colour, **place)
