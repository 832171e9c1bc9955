"""Predictions as tables, as plain data for JSON, and as a picture of what the output does."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.apps import console, literal, number, table
from neuro.chips import COLUMNS, footnotes
from neuro_predict.predict import Predictions
from neuro_predict.showing import warn_of_overflows

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FORMAT = "neuro predictions 1"
NOTHING = "nothing"
"""What stands for the class where there is no decision."""
SCORES = {"counts": "spikes", "first": "first spike, ms", "potential": "mean V_m, mV"}
BEST = 3
"""Scores that a row shows."""


def show(found: Sequence[Predictions]) -> None:
    """Print a row for each recording, or with labels for each class, then one for each backend; warn of overflows."""
    first, out = found[0], console()
    for one in found:
        warn_of_overflows(one.backend, one.overflows or {}, len(one.names))
    for line in footnotes([one.bill for one in found if one.bill], False):
        print(f"- {line}")
    asked = first.readout
    print(f"shown by '{asked.input}', '{asked.output}' decides by {asked.decide}")
    if first.own is None:
        head = ("recording", *(f"on {one.backend}" for one in found), SCORES[asked.decide])
        out.print(table(head, list(_rows(found))))
    else:
        head = ("shown", *(f">{name}" for name in (*asked.classes, NOTHING)))
        counts = zip(asked.classes, first.own.confusion.tolist(), strict=True)
        rows = [(name, *(n or "." for n in row)) for name, row in counts if any(row)]
        out.print(table(head, rows, title=f"decided on {first.backend}"))
    out.print(table(("runs on", *_head(found)), [(one.backend, *_figures(one, found)) for one in found]))
    if bills := [(one.backend, *one.bill.cells()) for one in found if one.bill]:
        out.print(table(("runs on", *COLUMNS), bills, title="a recording"))


def _rows(found: Sequence[Predictions]) -> Iterator[tuple[str, ...]]:
    first = found[0]
    for k, name in enumerate(first.names):
        yield name, *(one.class_of(k) or NOTHING for one in found), _best(first, k)


def _best(one: Predictions, k: int) -> str:
    """The best scores of a recording."""
    sign = 1.0 if one.readout.decide == "first" else -1.0
    order = np.argsort(sign * one.scores[k], kind="stable")[:BEST]
    shown = [(one.readout.classes[c], one.scores[k, c]) for c in order if np.isfinite(one.scores[k, c])]
    return ", ".join(f"{name} {number(score)}" for name, score in shown) or "-"


def _head(found: Sequence[Predictions]) -> tuple[str, ...]:
    right = () if found[0].own is None else (">right", ">of", ">accuracy", ">95 % interval")
    equal = (">equal decisions",) if len(found) > 1 else ()
    return *right, *equal, f">{NOTHING}", ">spikes of a recording"


def _figures(one: Predictions, found: Sequence[Predictions]) -> tuple[Any, ...]:
    """What stands below the head."""
    right: tuple[Any, ...] = ()
    if one.own is not None:
        low, high = one.own.interval
        right = one.own.correct, one.own.n, f"{one.own.accuracy:.1%}", f"{low:.1%} - {high:.1%}"
    equal = (f"{one.agrees(found[0]):.1%}",) if len(found) > 1 else ()
    return *right, *equal, int((one.decided < 0).sum()), number(float(one.spikes.mean()))


def as_dict(network: str, found: Sequence[Predictions]) -> dict[str, Any]:
    """All of it as plain values: what is not there is None; energies as of `neuro energy`."""
    first = found[0]
    readout = {word: _plain(value) for word, value in first.readout.parameters().items()}
    about = {"format": FORMAT, "network": network, "readout": readout}
    return about | {
        "backends": {one.backend: _about(one, first) for one in found},
        "recordings": [_recording(found, k) for k in range(len(first.names))],
    }


def _about(one: Predictions, first: Predictions) -> dict[str, Any]:
    own = {} if one.own is None else one.own.as_words()
    overflows = {what: some for what, (some, _) in (one.overflows or {}).items()}
    energy = None if one.bill is None else one.bill.as_dict()
    return {**own, "equal_decisions": one.agrees(first), "overflows": overflows, "energy": energy}


def _recording(found: Sequence[Predictions], k: int) -> dict[str, Any]:
    first = found[0]
    label = None if first.labels is None else first.readout.classes[first.labels[k]]
    decided = {
        one.backend: {
            "class": one.class_of(k),
            "scores": {
                name: float(score) if np.isfinite(score) else None
                for name, score in zip(one.readout.classes, one.scores[k], strict=True)
            },
            "spikes": int(one.spikes[k]),
        }
        for one in found
    }
    return {"recording": first.names[k], "label": label, "decided": decided}


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


MOST = 24
"""Recordings that are drawn, the first ones."""
PANELS = 4
"""Panels beside one another."""
DECIDED, OTHER = "#0072B2", "0.6"
NAMED = 20
"""Classes up to which each has its name at the axis."""


def draw(found: Predictions) -> Figure:
    """A panel for each recording that was kept: spikes or potentials of all classes, the decided one in blue."""
    from matplotlib.figure import Figure

    columns = min(PANELS, len(found.shown))
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
