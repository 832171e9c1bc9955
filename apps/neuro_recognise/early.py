"""Learning to decide while events arrive: held-out decisions moment by moment, and beginnings learnt apart.

Every recording is decided on by what was learnt of the other folds, so that all of them count as held out. There are
two ways of deciding on beginnings, in steps that are done one by one. What beginnings show is looked at once for all
moments, and kept in files of a hundred recordings:

```
/                  attribute: format
/K/NAME/values     an array of all recordings at moment K, one after the other
/K/NAME/shape      (recordings, dimensions) of each
```
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import Checkpoint, hdf5, make_folder
from neuro_events import Recordings
from neuro_events.dataset import Sample
from neuro_recognise.deciding import Early, Held, margins
from neuro_recognise.method import Course, Learnt, Method, Progress, choose
from neuro_recognise.observations import observe, seen_of, write_evidence
from neuro_recognise.recogniser import Recogniser, Tell, learn
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints, unlabelled

BEGINNINGS = "neuro recognise beginnings 1"
IN_FILE = 100
"""Recordings in a file, all of whose moments are in memory while it is made."""


def seen_until(method: Method, recording: Sample, times_us: Ints) -> list[Evidence]:
    """Return what a recording shows until each time; errors as of `seen_of`."""
    return seen_of(recording, lambda events: method.observe_until(events, times_us.tolist()))


class Beginnings:
    """What all recordings show, moment by moment.

    Args:
        method: its settings decide what is looked at.
        data: labelled recordings.
        times_us: how long the beginnings are.
        folder: for the files; what is there already is not looked at again.
    """

    def __init__(self, method: Method, data: Recordings, times_us: Ints, folder: Path) -> None:
        self._method, self._data, self._times = method, data, times_us
        self._files = [folder / f"{first:08d}.h5" for first in range(0, len(data), IN_FILE)]
        self._folder = folder

    def look(self) -> Iterator[int]:
        """Look at what is not there yet; gives the number of recordings that are done, after each hundred.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: one does not fit the method; it is named.
            Unwritable: a file cannot be written.
        """
        make_folder(self._folder)
        for k, file in enumerate(self._files):
            part = self._data[IN_FILE * k : IN_FILE * (k + 1)]
            if not hdf5.is_whole(file, BEGINNINGS):
                _write(file, [seen_until(self._method, item, self._times) for item in part])
            yield IN_FILE * k + len(part)

    def at(self, moment: int) -> Features:
        """Return what beginnings so long show, in memory."""
        evidence = [one for file in self._files for one in _read(file, moment)]
        return Features(evidence, self._data.labels, tuple(item.name for item in self._data), self._data.classes)

    def remove(self) -> None:
        """They are no longer needed."""
        for file in self._files:
            file.unlink(missing_ok=True)
        if self._folder.exists():
            self._folder.rmdir()


def _write(file: Path, of_recordings: Sequence[Sequence[Evidence]]) -> None:
    with hdf5.writing(file, BEGINNINGS, replace=True) as out:
        for moment, evidence in enumerate(zip(*of_recordings, strict=True)):
            write_evidence(out.create_group(str(moment)), evidence)


def _read(file: Path, moment: int) -> list[Evidence]:
    arrays: dict[str, list[Array]] = {}
    with hdf5.reading(file, BEGINNINGS) as kept:
        for name, group in kept[str(moment)].items():
            shapes, values = group["shape"][()], group["values"][()]
            parts = np.split(values, np.cumsum(shapes.prod(axis=1))[:-1])
            arrays[name] = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
    return [dict(zip(arrays, parts, strict=True)) for parts in zip(*arrays.values(), strict=True)]


AT_ONCE = 40
"""Recordings whose beginnings are asked about together."""


Decided = tuple[tuple[Any, Any], Floats, Learnt]
"""What comes of a step: which of (recordings, moments) are decided on, their scores of all classes, and what was learnt
of beginnings so long, where they are learnt apart."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Decisions on recordings that are held out, in steps.

    Attributes:
        recogniser: what was learnt of whole recordings.
        data: recordings to learn from and to decide on.
        fingerprint: of their contents.
        times: how long beginnings are, us.
        folds: indices to learn from and to decide on, of each fold.
        backend: runs networks that are asked; they are trained on that of the recogniser's training.
        beside: files of what is under way have this name and an ending.
        cache: folder for what is computed of recordings; None takes the user's.
        report: called with the progress.
    """

    recogniser: Recogniser
    data: Recordings
    fingerprint: str
    times: Ints
    folds: list[tuple[Ints, Ints]]
    backend: str
    beside: Path
    cache: Path | None
    report: Callable[[Progress], None]

    @property
    def course(self) -> Course:
        """As the recogniser was trained."""
        training = self.recogniser.training
        return Course(int(training.get("seed", 0)), str(training.get("backend", "event")), None, self.report)

    def file(self, ending: str) -> Path:
        """Of something under way."""
        return self.beside.with_name(f"{self.beside.name}.{ending}")

    @cached_property
    def steps(self) -> list[tuple[int, Ints]]:
        """The steps: a moment and all recordings where beginnings are learnt apart, else a fold and some of its own."""
        if self.recogniser.method.by_moment:
            return [(moment, np.arange(len(self.data))) for moment in range(len(self.times))]
        return [
            (fold, held[first : first + AT_ONCE])
            for fold, (_, held) in enumerate(self.folds)
            for first in range(0, len(held), AT_ONCE)
        ]

    def apart(self, done: int) -> Iterator[Decided]:
        """Learn beginnings of each moment, of the other folds for each fold, and then of all; some steps are done."""
        method, course = self.recogniser.method, self.course
        beginnings = Beginnings(method, self.data, self.times, self.file("beginnings"))
        for seen in beginnings.look():
            self.report(Progress("looking at beginnings", seen, len(self.data)))
        for moment, _ in self.steps[done:]:
            shown = beginnings.at(moment)
            scores = np.full((len(shown), len(shown.classes)), np.nan)
            for others, held in self.folds:
                learnt = method.fit(shown.take(others), course)
                scores[held] = method.answer(learnt, shown.take(held), self.backend).scores
            yield (slice(None), moment), scores, method.fit(shown, course)

    def wholes(self, done: int) -> Iterator[Decided]:
        """Ask what was learnt of the other folds' whole recordings about beginnings; some steps are done.

        What is learnt of a fold is a recogniser with a file of its own, so that a kill costs little.
        """
        method, classes, course = self.recogniser.method, self.recogniser.classes, self.course
        words: Any = {"seed": course.seed, "backend": course.backend, "report": course.report}

        def look(seen: int, total: int) -> None:
            self.report(Progress("looking at recordings", seen, total))

        shown = observe(method, self.data, fingerprint=self.fingerprint, cache=self.cache, report=look)
        asked: int | None = None
        for fold, rows in self.steps[done:]:
            if fold != asked:
                message = f"{self.fingerprint} without fold {fold} of {len(self.folds)}"
                others = shown.take(self.folds[fold][0])
                made = learn(method, others, message, out=self.file(f"fold{fold}"), **words)
                asked, ask = fold, method.asker(made.learnt, self.backend)
            evidence = [one for row in rows.tolist() for one in seen_until(method, self.data[row], self.times)]
            scores = ask(unlabelled(evidence, classes)).scores
            yield (rows, slice(None)), scores.reshape(len(rows), len(self.times), len(classes)), {}

    def clear(self) -> None:
        """Remove the files of what was under way."""
        Beginnings(self.recogniser.method, self.data, self.times, self.file("beginnings")).remove()
        for fold in range(len(self.folds)):
            self.file(f"fold{fold}").unlink(missing_ok=True)

    def decided(self, checkpoint: Checkpoint) -> Early:
        """Do all steps, from where they were left."""
        shape, kept = (len(self.data), len(self.times)), checkpoint.resume()
        found = np.array(kept.get("margins", np.full(shape, np.nan)))
        right = np.array(kept.get("right", np.zeros(shape, bool)))
        learnt: dict[str, Array] = dict(kept.get("learnt", {}))
        if not kept:  # before any other file, so that other options are refused by what they are called here
            checkpoint.keep(done=np.array(0), margins=found, right=right, learnt=learnt)
        done, labels, total = int(kept.get("done", 0)), self.data.labels, len(self.steps)
        way = self.apart if self.recogniser.method.by_moment else self.wholes
        self.report(Progress("deciding on recordings held out", done, total))
        for k, (where, scores, of_moment) in enumerate(way(done) if done < total else (), done):
            decided = choose(scores.reshape(-1, scores.shape[-1])).reshape(scores.shape[:-1])
            found[where] = margins(scores)
            right[where] = decided == np.broadcast_to(labels[:, None], shape)[where]
            learnt |= {f"{k}.{name}": np.asarray(part) for name, part in of_moment.items()}
            checkpoint.keep(done=np.array(k + 1), margins=found, right=right, learnt=learnt)
            self.report(Progress("deciding on recordings held out", k + 1, total))
        by_moment: list[dict[str, Array]] = [{} for _ in range(len(self.times) if learnt else 0)]
        for place, part in learnt.items():
            moment, _, name = place.partition(".")
            by_moment[int(moment)][name] = part
        return Early(Held(self.times, found, right, labels), tuple(by_moment))


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
    settings = {"method": method.as_words(), **recogniser.training, "every": every_ms, "folds": folds}
    fingerprint = data.fingerprint()
    settings |= {"early data": fingerprint, "early backend": backend}
    with tempfile.TemporaryDirectory() if out is None else nullcontext("") as folder:
        beside = out or Path(folder) / "early"
        checkpoint = Checkpoint(beside, FORMAT, settings)
        work = HeldOut(recogniser, data, fingerprint, times, cut, backend, beside, cache, report)
        made = replace(recogniser, early=work.decided(checkpoint))
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
