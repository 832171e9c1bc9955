"""Learning to decide while events arrive: held-out decisions moment by moment, and beginnings learnt apart.

Every recording is decided on by what was learnt of the other folds, so that all of them count as held out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import Checkpoint
from neuro.events import Recordings
from neuro_recognise.deciding.early import Early
from neuro_recognise.deciding.stopping import Held, margins
from neuro_recognise.method import Course, Learnt, Progress, choose
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import Recogniser, Tell
from neuro_recognise.shown import Array, Floats, Ints, unlabelled

__all__ = ["learn_early", "moments"]

AT_ONCE = 40
"""Recordings whose beginnings are asked about together."""
MOST = 200
"""Moments; more would mean an interval far below what changes decisions."""


def learn_early(
    recogniser: Recogniser,
    data: Recordings,
    *,
    every_ms: float = 10.0,
    folds: int = 5,
    checkpoint: Checkpoint | None = None,
    report: Tell = lambda progress: None,
) -> Recogniser:
    """Learn when decisions can be made before a recording ends.

    A method of which `Method.by_moment` says so learns the beginnings of recordings apart, at each moment.

    Args:
        recogniser: what was learnt of whole recordings.
        data: labelled recordings of its classes, best those of its training.
        every_ms: from moment to moment, up to the end of the longest recording.
        folds: into which the recordings are cut; each is decided on by what was learnt of the others.
        checkpoint: keeps what is reached, so that a killed call goes on.
        report: is told the progress.

    Returns:
        The same with `early`.

    Raises:
        ModelError: too many moments, a class with fewer recordings than folds, or other classes.
        EventFileError: a recording is damaged or does not fit the method.
    """
    if data.classes != recogniser.classes:
        raise ModelError(f"the recordings are of {list(data.classes)}, expected {list(recogniser.classes)}")
    times = moments(data, every_ms)
    seed = int(recogniser.training.get("seed", 0))
    work = _Work(recogniser, data, times, data.folds(folds, seed=seed), seed)
    by_moment = recogniser.method.by_moment
    steps, step = (len(times), work.moment) if by_moment else (folds, work.fold_of_wholes)
    kept = checkpoint.resume() if checkpoint else {}
    found = np.array(kept.get("margins", np.full((len(data), len(times)), np.nan)))
    right = np.array(kept.get("right", np.zeros(found.shape, bool)))
    learnt: dict[str, Array] = dict(kept.get("learnt", {}))
    for k in range(int(kept.get("done", 0)), steps):
        report(Progress("deciding on recordings held out", k, steps))
        made = step(k)
        found[made.where], right[made.where] = margins(made.scores), made.right
        learnt |= {f"{k}.{name}": np.asarray(part) for name, part in made.learnt.items()}
        if checkpoint:
            checkpoint.keep(done=np.array(k + 1), margins=found, right=right, learnt=learnt)
    report(Progress("deciding on recordings held out", steps, steps))
    return replace(recogniser, early=Early(Held(times, found, right), _by_moment(learnt, steps) if by_moment else ()))


def moments(data: Recordings, every_ms: float) -> Ints:
    """(moments,) from the first event on, us: every few ms until the longest recording is over.

    Raises:
        ModelError: there are more than 200, or the interval is not above 0.
    """
    longest = max(int(events.t[-1] - events.t[0]) if len(events) else 0 for events in (one.load() for one in data))
    if not (np.isfinite(every_ms) and 1000.0 * every_ms * MOST >= max(longest, MOST)):
        least = np.ceil(max(longest, MOST) / MOST) / 1000.0
        raise ModelError(
            f"every_ms = {every_ms:g}: expected at least {least:g} ms, for at most {MOST} moments in the "
            f"{longest / 1000:g} ms of the longest recording"
        )
    every = round(1000.0 * every_ms)
    return every * np.arange(1, max(1, -(-longest // every)) + 1, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """What came of a step: which of (recordings, moments) it decided on, and how."""

    where: tuple[Any, Any]
    scores: Floats
    right: Any
    learnt: Learnt


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """The two ways of deciding on recordings that were held out."""

    recogniser: Recogniser
    data: Recordings
    times: Ints
    folds: list[tuple[Ints, Ints]]
    seed: int

    def moment(self, k: int) -> _Step:
        """A moment: learn beginnings so long, of the other folds for each fold, and then of all."""
        method, time = self.recogniser.method, int(self.times[k])
        evidence = [method.observe_until(item.load(), [time])[0] for item in self.data]
        shown = replace(unlabelled(evidence, self.recogniser.classes), labels=self.data.labels)
        scores = np.full((len(shown), len(shown.classes)), np.nan)
        for others, held in self.folds:
            scores[held] = method.answer(method.fit(shown.take(others), Course(self.seed)), shown.take(held)).scores
        learnt = method.fit(shown, Course(self.seed))
        return _Step((slice(None), k), scores, choose(scores) == self.data.labels, learnt)

    def fold_of_wholes(self, k: int) -> _Step:
        """A fold: learn the other folds' recordings as wholes, and ask about the beginnings of its own."""
        method = self.recogniser.method
        others, held = self.folds[k]
        learnt = method.fit(observe(method, self.data).take(others), Course(self.seed))
        ask = method.asker(learnt)
        scores = np.empty((len(held), len(self.times), len(self.recogniser.classes)))
        for first in range(0, len(held), AT_ONCE):
            rows = held[first : first + AT_ONCE].tolist()
            evidence = [one for k in rows for one in method.observe_until(self.data[k].load(), self.times.tolist())]
            found = ask(unlabelled(evidence, self.recogniser.classes)).scores
            scores[first : first + len(rows)] = found.reshape(len(rows), *scores.shape[1:])
        right = choose(scores.reshape(-1, scores.shape[2])).reshape(scores.shape[:2]) == self.data.labels[held, None]
        return _Step((held, slice(None)), scores, right, {})


def _by_moment(kept: Mapping[str, Array], moments: int) -> tuple[Learnt, ...]:
    """What was learnt at each moment, from one flat table."""
    several: list[dict[str, Array]] = [{} for _ in range(moments)]
    for place, part in kept.items():
        k, _, name = place.partition(".")
        several[int(k)][name] = part
    return tuple(several)
