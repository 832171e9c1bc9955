"""What a recogniser says of single files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neuro.events import load
from neuro_recognise.method import SILENT, choose
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Floats

__all__ = ["Predicted", "predict_files"]

MOMENTS = 20
"""Times at which a recording is asked about, evenly spread over it."""


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """What is said of a recording.

    Attributes:
        path: the file.
        label: index of the class, -1 for none.
        scores: (classes,) what speaks for each.
        decided_ms: from the first event on, after which the decision did not change any more; NaN without one.
        length_ms: of the recording.
    """

    path: str
    label: int
    scores: Floats
    decided_ms: float
    length_ms: float


def predict_files(recogniser: Recogniser, files: Iterable[Path], backend: str = "event") -> list[Predicted]:
    """Decide on files, each a recording.

    Raises:
        EventFileError: a file is damaged, or no recording.
        ModelError: it does not fit the recogniser; the message tells the file.
    """
    return [_predict(recogniser, file, backend) for file in files]


def _predict(recogniser: Recogniser, file: Path, backend: str) -> Predicted:
    events = load(file)
    length = (int(events.t[-1]) - int(events.t[0])) / 1000.0 if len(events) else 0.0
    times = np.linspace(0.0, length, MOMENTS + 1)[1:]
    at = recogniser.scores_at(events, times.tolist())
    labels = choose(at)
    final = int(labels[-1])
    changed = np.flatnonzero(labels != final)
    since = 0 if not changed.size else int(changed[-1]) + 1
    decided = float("nan") if final == SILENT else float(times[since])
    return Predicted(str(file), final, at[-1], decided, length)
