"""Learning to decide while events arrive: held-out decisions moment by moment, and beginnings learnt apart.

Every recording is decided on by what was learnt of the other folds, so that all of them count as held out.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from neuro import ModelError
from neuro.apps import Checkpoint
from neuro.events import Recordings
from neuro_recognise.deciding.held import Early, Held, margins
from neuro_recognise.deciding.held_out import Apart, HeldOut, Wholes
from neuro_recognise.method import Learnt, Progress, choose
from neuro_recognise.recogniser import Recogniser, Tell
from neuro_recognise.shown import Array, Ints

MOST = 200
"""Moments; more would mean an interval far below what changes decisions."""
FORMAT = "neuro recogniser early 2"


def learn_early(
    recogniser: Recogniser,
    data: Recordings,
    *,
    every_ms: float = 10.0,
    folds: int = 5,
    backend: str = "event",
    out: Path | None = None,
    cache: Path | None = None,
    report: Tell = lambda progress: None,
) -> Recogniser:
    """Learn when decisions can be made before a recording ends.

    A method of which `Method.by_moment` says so learns the beginnings of recordings apart, at each moment.

    Args:
        recogniser: what was learnt of whole recordings.
        data: labelled recordings of its classes, best those of its training.
        every_ms: from moment to moment, up to the end of the longest recording.
        folds: into which the recordings are cut; each is decided on by what was learnt of the others.
        backend: runs networks that decide; those of folds are trained on what the recogniser was trained on.
        out: file for the recogniser, also the one it has. What is reached is kept beside it, and the same call goes on
            from there to the same bits.
        cache: folder for what is computed of the recordings; None takes the user's.
        report: called with the progress.

    Returns:
        The same with `early`.

    Raises:
        ModelError: too many moments, a class with fewer recordings than folds, other classes, another backend for a
            method without a network, a recording does not fit the method, or what is there of `out` was begun with
            other options.
        EventFileError: a recording is damaged.
    """
    method = recogniser.method
    if data.classes != recogniser.classes:
        raise ModelError(f"the recordings are of {list(data.classes)}, expected {list(recogniser.classes)}")
    method.check_backend(backend)
    times = moments(data, every_ms)
    cut = data.folds(folds, seed=int(recogniser.training.get("seed", 0)))
    told = {"method": method.as_words(), **recogniser.training, "every": every_ms, "folds": folds}
    fingerprint = data.fingerprint()
    told |= {"early data": fingerprint, "early backend": backend}
    with _beside(out) as beside:
        checkpoint = Checkpoint(beside, FORMAT, told)
        way = Apart if method.by_moment else Wholes
        work = way(recogniser, data, fingerprint, times, cut, backend, beside, cache, report)
        made = replace(recogniser, early=_decided(work, checkpoint))
        if out is not None:
            made.save(out)
        work.clear()
        checkpoint.remove()
    return made


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


@contextmanager
def _beside(out: Path | None) -> Iterator[Path]:
    """What files of something under way lie beside: the file to write, or one that goes when all is done."""
    if out is not None:
        yield out
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "early"


def _decided(work: HeldOut, checkpoint: Checkpoint) -> Early:
    """Do all steps, from where they were left."""
    shape, kept = (len(work.data), len(work.times)), checkpoint.resume()
    found = np.array(kept.get("margins", np.full(shape, np.nan)))
    right = np.array(kept.get("right", np.zeros(shape, bool)))
    learnt: dict[str, Array] = dict(kept.get("learnt", {}))
    if not kept:  # before any other file, so that other options are refused by what they are called here
        checkpoint.keep(done=np.array(0), margins=found, right=right, learnt=learnt)
    labels = work.data.labels
    for k in range(int(kept.get("done", 0)), work.steps):
        work.report(Progress("deciding on recordings held out", k, work.steps))
        made = work.step(k)
        decided = choose(made.scores.reshape(-1, made.scores.shape[-1])).reshape(made.scores.shape[:-1])
        found[made.where] = margins(made.scores)
        right[made.where] = decided == np.broadcast_to(labels[:, None], shape)[made.where]
        learnt |= {f"{k}.{name}": np.asarray(part) for name, part in made.learnt.items()}
        checkpoint.keep(done=np.array(k + 1), margins=found, right=right, learnt=learnt)
    work.report(Progress("deciding on recordings held out", work.steps, work.steps))
    return Early(Held(work.times, found, right, labels), _by_moment(learnt, len(work.times)) if learnt else ())


def _by_moment(kept: Mapping[str, Array], moments: int) -> tuple[Learnt, ...]:
    """What was learnt at each moment, from one flat table."""
    several: list[dict[str, Array]] = [{} for _ in range(moments)]
    for place, part in kept.items():
        k, _, name = place.partition(".")
        several[int(k)][name] = part
    return tuple(several)
