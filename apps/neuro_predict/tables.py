"""Predictions as tables, as plain data for JSON, and as a picture of the output's activity."""

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
"""Text in place of the class if there is no decision."""
SCORES = {"counts": "spikes", "first": "first spike, ms", "potential": "mean V_m, mV"}
BEST = 3
"""Number of scores in a row of the table."""


def show(predictions: Sequence[Predictions]) -> None:
    """Print a row for each recording, or for each class if there are labels; then a row for each backend."""
    first, screen = predictions[0], console()
    for p in predictions:
        warn_of_overflows(p.backend, p.overflows or {}, len(p.names))
    for line in footnotes([p.bill for p in predictions if p.bill], False):
        print(f"- {line}")
    readout = first.readout
    print(f"shown by '{readout.input}', '{readout.output}' decides by {readout.decide}")
    if first.own is None:
        head = ("recording", *(f"on {p.backend}" for p in predictions), SCORES[readout.decide])
        screen.print(table(head, list(_rows(predictions))))
    else:
        head = ("shown", *(f">{name}" for name in (*readout.classes, NOTHING)))
        counts = zip(readout.classes, first.own.confusion.tolist(), strict=True)
        rows = [(name, *(n or "." for n in row)) for name, row in counts if any(row)]
        screen.print(table(head, rows, title=f"decided on {first.backend}"))
    screen.print(table(("runs on", *_head(predictions)), [(p.backend, *_figures(p, predictions)) for p in predictions]))
    if bills := [(p.backend, *p.bill.cells()) for p in predictions if p.bill]:
        screen.print(table(("runs on", *COLUMNS), bills, title="a recording"))


def _rows(predictions: Sequence[Predictions]) -> Iterator[tuple[str, ...]]:
    first = predictions[0]
    for k, name in enumerate(first.names):
        yield name, *(p.class_of(k) or NOTHING for p in predictions), _best(first, k)


def _best(p: Predictions, k: int) -> str:
    """Return the best scores of a recording as text."""
    sign = 1.0 if p.readout.decide == "first" else -1.0
    order = np.argsort(sign * p.scores[k], kind="stable")[:BEST]
    ranking = [(p.readout.classes[c], p.scores[k, c]) for c in order if np.isfinite(p.scores[k, c])]
    return ", ".join(f"{name} {number(score)}" for name, score in ranking) or "-"


def _head(predictions: Sequence[Predictions]) -> tuple[str, ...]:
    accuracy = () if predictions[0].own is None else (">right", ">of", ">accuracy", ">95 % interval")
    equal = (">equal decisions",) if len(predictions) > 1 else ()
    return *accuracy, *equal, f">{NOTHING}", ">spikes of a recording"


def _figures(p: Predictions, predictions: Sequence[Predictions]) -> tuple[Any, ...]:
    """Return the row of one backend."""
    accuracy: tuple[Any, ...] = ()
    if p.own is not None:
        low, high = p.own.interval
        accuracy = p.own.correct, p.own.n, f"{p.own.accuracy:.1%}", f"{low:.1%} - {high:.1%}"
    equal = (f"{p.agrees(predictions[0]):.1%}",) if len(predictions) > 1 else ()
    return *accuracy, *equal, int((p.decided < 0).sum()), number(float(p.spikes.mean()))


def as_dict(network: str, predictions: Sequence[Predictions]) -> dict[str, Any]:
    """Return everything as plain values; missing values are None, energies have the form of `neuro energy`."""
    first = predictions[0]
    readout = {word: _plain(value) for word, value in first.readout.parameters().items()}
    header = {"format": FORMAT, "network": network, "readout": readout}
    return header | {
        "backends": {p.backend: _about(p, first) for p in predictions},
        "recordings": [_recording(predictions, k) for k in range(len(first.names))],
    }


def _about(p: Predictions, first: Predictions) -> dict[str, Any]:
    figures = {} if p.own is None else p.own.as_words()
    overflows = {name: count for name, (count, _) in (p.overflows or {}).items()}
    energy = None if p.bill is None else p.bill.as_dict()
    return {**figures, "equal_decisions": p.agrees(first), "overflows": overflows, "energy": energy}


def _recording(predictions: Sequence[Predictions], k: int) -> dict[str, Any]:
    first = predictions[0]
    label = None if first.labels is None else first.readout.classes[first.labels[k]]
    decided = {
        p.backend: {
            "class": p.class_of(k),
            "scores": {
                name: float(score) if np.isfinite(score) else None
                for name, score in zip(p.readout.classes, p.scores[k], strict=True)
            },
            "spikes": int(p.spikes[k]),
        }
        for p in predictions
    }
    return {"recording": first.names[k], "label": label, "decided": decided}


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


MOST = 24
"""Largest number of drawn recordings."""
PANELS = 4
"""Number of panels beside each other."""
DECIDED, OTHER = "#0072B2", "0.6"
NAMED = 20
"""Largest number of classes whose names are drawn at the axis."""


def draw(predictions: Predictions) -> Figure:
    """Draw a panel for each recording shown in full: spikes or potentials of all classes, the decided one in blue."""
    from matplotlib.figure import Figure

    columns = min(PANELS, len(predictions.shown))
    rows = math.ceil(len(predictions.shown) / columns)
    tall = 1.0 + 0.11 * min(NAMED, len(predictions.readout.classes))
    figure = Figure(figsize=(3.2 * columns + 0.6, tall * rows + 0.8), dpi=130, layout="constrained")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False).reshape(-1)
    for k, axis in enumerate(axes):
        if k < len(predictions.shown):
            _panel(axis, predictions, k)
        else:
            axis.set_visible(False)
    n_omitted = len(predictions.names) - len(predictions.shown)
    note = f"; the first {len(predictions.shown)} of {len(predictions.names)} recordings" if n_omitted else ""
    readout = predictions.readout
    figure.suptitle(
        literal(f"'{readout.output}' on {predictions.backend} decides by {readout.decide}{note}"), fontsize=11
    )
    figure.supxlabel("time (ms)", fontsize=10)
    return figure


def _panel(axis: Any, predictions: Predictions, k: int) -> None:
    """Draw the activity of the output in one recording."""
    recording, decided = predictions.shown[k], int(predictions.decided[k])
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(labelsize=7)
    axis.set_xlim(0.0, recording.ms)
    if recording.V_m is None:
        is_decided = recording.ids == decided
        for chosen, colour in ((~is_decided, OTHER), (is_decided, DECIDED)):
            axis.plot(
                recording.times[chosen], recording.ids[chosen], "|", color=colour, markersize=6, markeredgewidth=1.0
            )
        _name_classes(axis, predictions, k)
    else:
        times = [recording.ms * (step + 1) / len(recording.V_m) for step in range(len(recording.V_m))]
        for neuron, trace in enumerate(recording.V_m.T):
            colour, width = (DECIDED, 1.4) if neuron == decided else (OTHER, 0.6)
            axis.plot(times, trace, color=colour, linewidth=width, zorder=2 + (neuron == decided))
        axis.set_ylabel("V_m (mV)", fontsize=8)
    label = "" if predictions.labels is None else f" (shown: {predictions.readout.classes[predictions.labels[k]]})"
    is_wrong = predictions.labels is not None and predictions.labels[k] != decided
    path = PurePath(recording.name)
    title = f"{path.parent.name}/{path.name}: {predictions.class_of(k) or 'nothing'}{label}"
    axis.set_title(literal(title), fontsize=8, loc="left", color="#D55E00" if is_wrong else "black")


def _name_classes(axis: Any, predictions: Predictions, k: int) -> None:
    """Draw a row for each class, with its score to the right."""
    classes, scores, decided = predictions.readout.classes, predictions.scores[k], predictions.decided[k]
    axis.set_ylim(len(classes) - 0.5, -0.5)
    if len(classes) > NAMED:
        return
    axis.set_yticks(range(len(classes)), [literal(name) for name in classes])
    style = {"transform": axis.get_yaxis_transform(), "fontsize": 6, "va": "center"}
    for neuron in range(len(classes)):
        if scores[neuron] > 0.0:  # no NaN
            colour = DECIDED if neuron == decided else OTHER
            axis.text(1.03, neuron, number(float(scores[neuron])), color=colour, **style)
