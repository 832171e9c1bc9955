"""A recogniser tried on recordings: how well it decides, what that took, and what it says of single files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from neuro import ModelError
from neuro.apps import Evaluation, evaluate
from neuro.events import Events, Recordings, load
from neuro_recognise.deciding.stopping import ASSURANCE
from neuro_recognise.method import SILENT, Answer, choose
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Floats

OWN = "own"
"""The vote of a method that has only one."""


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What came of showing recordings.

    Attributes:
        own: by the scores of the recogniser.
        votes: by other ways of reading the same evidence, by name.
        answer: scores, and what it took to find them.
    """

    own: Evaluation
    votes: Mapping[str, Evaluation]
    answer: Answer


def try_out(recogniser: Recogniser, data: Recordings, backend: str = "event") -> Tried:
    """Let a recogniser decide on recordings.

    Args:
        recogniser: what was learnt.
        data: recordings of its classes.
        backend: runs networks.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: one does not fit the method, or the backend cannot run it.
    """
    recogniser.method.check_backend(backend)
    shown = recogniser.shown(data)
    answer = recogniser.answer_shown(shown, backend)
    votes = {name: evaluate(choose(scores), shown.labels, shown.classes) for name, scores in answer.votes.items()}
    return Tried(evaluate(choose(answer.scores), shown.labels, shown.classes), votes, answer)


MOMENTS = 20
"""Times at which a recording is asked about where no moments were learnt, evenly spread over it."""


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """What is said of a recording.

    Attributes:
        path: the file.
        label: index of the class, -1 for none.
        scores: (classes,) what speaks for each.
        decided_ms: from the first event on. With an allowed error: when it was met, else the end. Without: the first
            moment from which on the decision was always the one on the whole recording. None without a decision.
        length_ms: of the recording.
        settled: whether an allowed error was met.
    """

    path: str
    label: int
    scores: Floats
    decided_ms: float | None
    length_ms: float
    settled: bool = False


def predict_files(
    recogniser: Recogniser,
    files: Iterable[Path],
    backend: str = "event",
    allow: float | None = None,
    assurance: float = ASSURANCE,
) -> tuple[list[Predicted], list[ModelError]]:
    """Decide on files, each a recording.

    Args:
        recogniser: what was learnt.
        files: recordings.
        backend: runs networks.
        allow: share of wrong decisions: each recording is decided on as soon as this is met, and what comes later is
            not looked at. None decides on the whole.
        assurance: of an allowed error, see `Recogniser.session`.

    Returns:
        What is said of the recordings, and what is wrong with those that are damaged or do not fit.

    Raises:
        ModelError: the backend cannot run the recogniser, or the allowed error cannot be met.
    """
    recogniser.answer([], backend)  # what is wrong with all is reported before any is read
    recogniser.session(allow=allow, assurance=assurance)
    found, wrong = list[Predicted](), list[ModelError]()
    for file in files:
        try:
            events = load(file)
            found.append(
                _whole(recogniser, str(file), events, backend)
                if allow is None
                else _early(recogniser, str(file), events, backend, allow, assurance)
            )
        except ModelError as error:
            wrong.append(error.at(None, str(file)))
    return found, wrong


def _whole(recogniser: Recogniser, file: str, events: Events, backend: str) -> Predicted:
    length = _length(events)
    scores = recogniser.scores(events, backend)
    label = int(choose(scores)[0])
    if label == SILENT:
        return Predicted(file, label, scores[0], None, length)
    times = _moments(recogniser, length)
    other = np.flatnonzero(choose(recogniser.scores_at(events, times.tolist(), backend)) != label)
    since = int(other[-1]) + 1 if other.size else 0
    return Predicted(file, label, scores[0], float(times[since]) if since < len(times) else length, length)


def _early(
    recogniser: Recogniser, file: str, events: Events, backend: str, allow: float, assurance: float
) -> Predicted:
    length = _length(events)
    early = recogniser.early
    every = early.held.times_us[0] / 1000.0 if early else 1.0
    window = length + every
    session = recogniser.session(every_ms=every, allow=allow, assurance=assurance, window_ms=window, backend=backend)
    scores = np.full(len(recogniser.classes), np.nan)
    for decision in chain(session.feed(events), session.end()):
        scores = decision.scores
        if decision.settled:
            return Predicted(file, decision.label, scores, decision.after_ms, length, settled=True)
    label = int(choose(scores[None])[0])
    return Predicted(file, label, scores, None if label == SILENT else length, length)


def _moments(recogniser: Recogniser, length: float) -> Floats:
    """When a recording is asked about, ms: the moments that were learnt, else some evenly spread, and the end."""
    if recogniser.early is None:
        return np.linspace(0.0, length, MOMENTS + 1)[1:]
    learnt = recogniser.early.held.times_us / 1000.0
    return np.append(learnt[learnt < length], length)


def _length(events: Events) -> float:
    return (int(events.t[-1]) - int(events.t[0])) / 1000.0 if len(events) else 0.0
