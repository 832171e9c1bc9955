"""Training for early decisions: decisions on held-out recordings at each moment.

Each fold is held out once, and a recogniser that was trained on the other folds decides on its recordings. Methods with
`Method.by_moment` are trained separately for each moment, on beginnings of recordings. All other methods are trained on
whole recordings. Both computations consist of steps, and a checkpoint follows each step. Separate trainings first
compute the evidence of all beginnings, and store it in files of a hundred recordings each:

```
/                  attribute: format
/K/NAME/values     values of the array NAME of all recordings at moment K, concatenated
/K/NAME/shape      (recordings, dimensions) shape of the array in each recording
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
"""Number of recordings in a file. The evidence of all their moments is in memory while the file is written."""


def seen_until(method: Method, recording: Sample, times_us: Ints) -> list[Evidence]:
    """Return the evidence of a recording up to each time, us after its first event. Errors: see `seen_of`."""
    return seen_of(recording, lambda events: method.observe_until(events, times_us.tolist()))


class Beginnings:
    """Evidence of the beginnings of all recordings at each moment, stored in files.

    Args:
        method: method that observes the recordings.
        data: labelled recordings.
        times_us: durations of the beginnings, us.
        folder: folder for the files; existing files are not computed again.
    """

    def __init__(self, method: Method, data: Recordings, times_us: Ints, folder: Path) -> None:
        self._method, self._data, self._times = method, data, times_us
        self._files = [folder / f"{first:08d}.h5" for first in range(0, len(data), IN_FILE)]
        self._folder = folder

    def look(self) -> Iterator[int]:
        """Compute the missing files. After each file, yield the number of finished recordings.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: a recording does not fit the method; the message names it.
            Unwritable: a file cannot be written.
        """
        make_folder(self._folder)
        for k, file in enumerate(self._files):
            part = self._data[IN_FILE * k : IN_FILE * (k + 1)]
            if not hdf5.is_whole(file, BEGINNINGS):
                _write(file, [seen_until(self._method, item, self._times) for item in part])
            yield IN_FILE * k + len(part)

    def at(self, moment: int) -> Features:
        """Load the evidence of all recordings at a moment into memory."""
        evidence = [item for file in self._files for item in _read(file, moment)]
        return Features(evidence, self._data.labels, tuple(item.name for item in self._data), self._data.classes)

    def remove(self) -> None:
        """Delete the files and the folder."""
        for file in self._files:
            file.unlink(missing_ok=True)
        if self._folder.exists():
            self._folder.rmdir()


def _write(file: Path, recordings: Sequence[Sequence[Evidence]]) -> None:
    with hdf5.writing(file, BEGINNINGS, replace=True) as out:
        for moment, evidence in enumerate(zip(*recordings, strict=True)):
            write_evidence(out.create_group(str(moment)), evidence)


def _read(file: Path, moment: int) -> list[Evidence]:
    arrays: dict[str, list[Array]] = {}
    with hdf5.reading(file, BEGINNINGS) as stored:
        for name, group in stored[str(moment)].items():
            shapes, values = group["shape"][()], group["values"][()]
            parts = np.split(values, np.cumsum(shapes.prod(axis=1))[:-1])
            arrays[name] = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
    return [dict(zip(arrays, parts, strict=True)) for parts in zip(*arrays.values(), strict=True)]


AT_ONCE = 40
"""Number of recordings whose beginnings are scored together."""


Decided = tuple[tuple[Any, Any], Floats, Learnt]
"""Result of a step: an index into an array (recordings, moments), the scores of all classes at this index, and the
training result for the moment, which is empty without separate trainings."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Decisions on held-out recordings, computed in steps.

    Attributes:
        recogniser: recogniser that was trained on whole recordings.
        data: recordings for the cross-validation.
        fingerprint: fingerprint of the contents of `data`.
        times: durations of the beginnings, us.
        folds: for each fold, the indices of the recordings to learn from, and of the recordings to decide on.
        backend: backend that scores recordings; trainings use the backend of the recogniser's training.
        base: path whose file name is the prefix of the names of intermediate files.
        cache: folder for evidence of whole recordings; None uses the user's cache.
        report: function that is called with the progress.
    """

    recogniser: Recogniser
    data: Recordings
    fingerprint: str
    times: Ints
    folds: list[tuple[Ints, Ints]]
    backend: str
    base: Path
    cache: Path | None
    report: Callable[[Progress], None]

    @property
    def course(self) -> Course:
        """Conditions of the recogniser's training."""
        training = self.recogniser.training
        return Course(int(training.get("seed", 0)), str(training.get("backend", "event")), None, self.report)

    def file(self, ending: str) -> Path:
        """Return the path of an intermediate file."""
        return self.base.with_name(f"{self.base.name}.{ending}")

    @cached_property
    def steps(self) -> list[tuple[int, Ints]]:
        """The steps as pairs: a moment and all recordings, or a fold and some of its held-out recordings."""
        if self.recogniser.method.by_moment:
            return [(moment, np.arange(len(self.data))) for moment in range(len(self.times))]
        return [
            (fold, held_out[first : first + AT_ONCE])
            for fold, (_, held_out) in enumerate(self.folds)
            for first in range(0, len(held_out), AT_ONCE)
        ]

    def separate_trainings(self, start: int) -> Iterator[Decided]:
        """Train separately for each moment, once per fold and once on all recordings; skip the first `start` steps."""
        method, course = self.recogniser.method, self.course
        beginnings = Beginnings(method, self.data, self.times, self.file("beginnings"))
        for finished in beginnings.look():
            self.report(Progress("looking at beginnings", finished, len(self.data)))
        for moment, _ in self.steps[start:]:
            features = beginnings.at(moment)
            scores = np.full((len(features), len(features.classes)), np.nan)
            for learnt_rows, held_out in self.folds:
                learnt = method.fit(features.take(learnt_rows), course)
                scores[held_out] = method.answer(learnt, features.take(held_out), self.backend).scores
            yield (slice(None), moment), scores, method.fit(features, course)

    def wholes(self, start: int) -> Iterator[Decided]:
        """Train once per fold on whole recordings, and score held-out beginnings; skip the first `start` steps.

        Each fold's training is saved as a separate recogniser, so that an interruption loses little work.
        """
        method, classes, course = self.recogniser.method, self.recogniser.classes, self.course
        options: Any = {"seed": course.seed, "backend": course.backend, "report": course.report}

        def look(finished: int, total: int) -> None:
            self.report(Progress("looking at recordings", finished, total))

        features = observe(method, self.data, fingerprint=self.fingerprint, cache=self.cache, report=look)
        current_fold: int | None = None
        for fold, rows in self.steps[start:]:
            if fold != current_fold:
                digest = f"{self.fingerprint} without fold {fold} of {len(self.folds)}"
                other_features = features.take(self.folds[fold][0])
                fold_recogniser = learn(method, other_features, digest, out=self.file(f"fold{fold}"), **options)
                current_fold, ask = fold, method.asker(fold_recogniser.learnt, self.backend)
            evidence = [item for row in rows.tolist() for item in seen_until(method, self.data[row], self.times)]
            scores = ask(unlabelled(evidence, classes)).scores
            yield (rows, slice(None)), scores.reshape(len(rows), len(self.times), len(classes)), {}

    def clear(self) -> None:
        """Delete all intermediate files."""
        Beginnings(self.recogniser.method, self.data, self.times, self.file("beginnings")).remove()
        for fold in range(len(self.folds)):
            self.file(f"fold{fold}").unlink(missing_ok=True)

    def decided(self, checkpoint: Checkpoint) -> Early:
        """Run the remaining steps from the last checkpoint, and return the decisions."""
        shape, state = (len(self.data), len(self.times)), checkpoint.resume()
        all_margins = np.array(state.get("margins", np.full(shape, np.nan)))
        is_right = np.array(state.get("right", np.zeros(shape, bool)))
        learnt: dict[str, Array] = dict(state.get("learnt", {}))
        if not state:  # before all other files, so an error about changed options comes from this checkpoint
            checkpoint.keep(done=np.array(0), margins=all_margins, right=is_right, learnt=learnt)
        start, labels, total = int(state.get("done", 0)), self.data.labels, len(self.steps)
        step_results = self.separate_trainings if self.recogniser.method.by_moment else self.wholes
        self.report(Progress("deciding on held-out recordings", start, total))
        for k, (rows_of_step, scores, moment_state) in enumerate(step_results(start) if start < total else (), start):
            labels_decided = choose(scores.reshape(-1, scores.shape[-1])).reshape(scores.shape[:-1])
            all_margins[rows_of_step] = margins(scores)
            is_right[rows_of_step] = labels_decided == np.broadcast_to(labels[:, None], shape)[rows_of_step]
            learnt |= {f"{k}.{name}": np.asarray(part) for name, part in moment_state.items()}
            checkpoint.keep(done=np.array(k + 1), margins=all_margins, right=is_right, learnt=learnt)
            self.report(Progress("deciding on held-out recordings", k + 1, total))
        arrays_by_moment: list[dict[str, Array]] = [{} for _ in range(len(self.times) if learnt else 0)]
        for key, part in learnt.items():
            moment, _, name = key.partition(".")
            arrays_by_moment[int(moment)][name] = part
        return Early(Held(self.times, all_margins, is_right, labels), tuple(arrays_by_moment))


MOST = 200
"""Largest number of moments. More moments would be so close that decisions hardly change between them."""
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

    Methods with `Method.by_moment` train separately for each moment on the beginnings of recordings.

    Args:
        recogniser: recogniser that was trained on whole recordings.
        data: labelled recordings of the same classes, preferably the recordings of the training.
        every_ms: time between moments, ms, up to the end of the longest recording.
        folds: number of folds; a training on all other folds decides on each fold.
        backend: backend that scores recordings; trainings of folds use the backend of the recogniser's training.
        out: file for the recogniser, which may be the file that it was loaded from. Checkpoints are stored beside this
            file. The same call resumes an interrupted run and gives the same bits.
        cache: folder for evidence of the recordings; None uses the user's cache.
        report: function that is called with the progress.

    Returns:
        The same recogniser with `early`.

    Raises:
        ModelError: there are too many moments, a class has fewer recordings than folds, the classes differ, the method
            has no network for the backend, a recording does not fit the method, or the checkpoint of `out` has other
            options.
        EventFileError: a recording is damaged.
    """
    method = recogniser.method
    if data.classes != recogniser.classes:
        raise ModelError(f"the recordings have the classes {list(data.classes)}, expected {list(recogniser.classes)}")
    method.check_backend(backend)
    times = moments(data, every_ms)
    splits = data.folds(folds, seed=int(recogniser.training.get("seed", 0)))
    settings = {"method": method.as_words(), **recogniser.training, "every": every_ms, "folds": folds}
    fingerprint = data.fingerprint()
    settings |= {"early data": fingerprint, "early backend": backend}
    with tempfile.TemporaryDirectory() if out is None else nullcontext("") as folder:
        base = out or Path(folder) / "early"
        checkpoint = Checkpoint(base, FORMAT, settings)
        work = HeldOut(recogniser, data, fingerprint, times, splits, backend, base, cache, report)
        with_early = replace(recogniser, early=work.decided(checkpoint))
        if out is not None:
            with_early.save(out)
        work.clear()
        checkpoint.remove()
    return with_early


def moments(data: Recordings, every_ms: float) -> Ints:
    """Return a moment every `every_ms` up to the end of the longest recording, (moments,) us after the first event.

    Raises:
        ModelError: there are more than 200, or the interval is not above 0.
    """
    longest = max(int(events.t[-1] - events.t[0]) if len(events) else 0 for events in (item.load() for item in data))
    if not (np.isfinite(every_ms) and 1000.0 * every_ms * MOST >= max(longest, MOST)):
        shortest = np.ceil(max(longest, MOST) / MOST) / 1000.0
        raise ModelError(
            f"every_ms = {every_ms:g}: expected at least {shortest:g} ms, for at most {MOST} moments in the "
            f"{longest / 1000:g} ms of the longest recording"
        )
    interval = round(1000.0 * every_ms)
    return interval * np.arange(1, max(1, -(-longest // interval)) + 1, dtype=np.int64)
