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
from neuro_recognise.early import Early
from neuro_recognise.method import Course, Learnt, Progress, choose
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import Recogniser, Tell
from neuro_recognise.shown import Array, Floats, Ints, Shown, unlabelled
from neuro_recognise.stopping import Held, margins

__all__ = ["learn_early", "stratified"]

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
        ModelError: too many moments, fewer recordings than folds, or other classes.
        EventFileError: a recording is damaged or does not fit the method.
    """
    if data.classes != recogniser.classes:
        raise ModelError(f"the recordings are of {list(data.classes)}, expected {list(recogniser.classes)}")
    if not 2 <= folds <= len(data):
        raise ModelError(f"folds = {folds}: expected 2 to {len(data)}, the number of recordings")
    times = moments(data, every_ms)
    labels = np.array([item.label for item in data], np.int64)
    seed = int(recogniser.training.get("seed", 0))
    work = _Work(recogniser, data, times, labels, stratified(labels, folds, seed), seed)
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


def stratified(labels: Ints, folds: int, seed: int) -> Ints:
    """A fold for each recording, each class spread evenly."""
    rng = np.random.default_rng([seed, 7])
    order = np.concatenate([rng.permutation(np.flatnonzero(labels == label)) for label in np.unique(labels)])
    fold = np.empty(len(labels), np.int64)
    fold[order] = np.arange(len(labels)) % folds
    return fold


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
    labels: Ints
    fold: Ints
    seed: int

    def moment(self, k: int) -> _Step:
        """A moment: learn beginnings so long, of the other folds for each fold, and then of all."""
        method, time = self.recogniser.method, int(self.times[k])
        evidence = [method.observe_until(item.load(), [time])[0] for item in self.data]
        shown = replace(unlabelled(evidence, self.recogniser.classes), labels=self.labels)
        scores = np.full((len(shown), len(shown.classes)), np.nan)
        for fold in np.unique(self.fold):
            held = np.flatnonzero(self.fold == fold)
            scores[held] = method.answer(self._learn(shown, fold), shown.take(held)).scores
        learnt = method.fit(shown, Course(self.seed))
        return _Step((slice(None), k), scores, choose(scores) == self.labels, learnt)

    def fold_of_wholes(self, k: int) -> _Step:
        """A fold: learn the other folds' recordings as wholes, and ask about the beginnings of its own."""
        method = self.recogniser.method
        learnt = self._learn(observe(method, self.data), k)
        held = np.flatnonzero(self.fold == k)
        scores = np.empty((len(held), len(self.times), len(self.recogniser.classes)))
        for row, index in enumerate(held.tolist()):
            evidence = method.observe_until(self.data[index].load(), self.times.tolist())
            scores[row] = method.answer(learnt, unlabelled(evidence, self.recogniser.classes)).scores
        right = choose(scores.reshape(-1, scores.shape[2])).reshape(scores.shape[:2]) == self.labels[held, None]
        return _Step((held, slice(None)), scores, right, {})

    def _learn(self, shown: Shown, without: int) -> Learnt:
        return self.recogniser.method.fit(shown.take(np.flatnonzero(self.fold != without)), Course(self.seed))


def _by_moment(kept: Mapping[str, Array], moments: int) -> tuple[Learnt, ...]:
    """What was learnt at each moment, from one flat table."""
    several: list[dict[str, Array]] = [{} for _ in range(moments)]
    for place, part in kept.items():
        k, _, name = place.partition(".")
        several[int(k)][name] = part
    return tuple(several)
