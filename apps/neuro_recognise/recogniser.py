"""Trained recognisers: training, prediction, files, and a check whether a training equals the one in a file."""

from __future__ import annotations

import hashlib
import json
import platform
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace as with_changes
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Checkpoint, check_output, hdf5, provenance, record_input
from neuro_events import EventFileError, Events, Recordings
from neuro_events.dataset import UNKNOWN
from neuro_recognise.deciding import ASSURANCE, WINDOW_MS, Early, Session, part_of, stopping_rule
from neuro_recognise.method import Answer, Course, Learnt, Method, Progress, choose
from neuro_recognise.methods import method_of
from neuro_recognise.observations import code_of, observe, observed
from neuro_recognise.shown import Evidence, Features, Floats, Ints, unlabelled

Training: TypeAlias = Mapping[str, Any]
OTHER = {"data": "other recordings", "code": "other code, of an earlier version or before an edit"}
REPLACE = "give another name, or --force (in Python replace=True) to replace it"


def settled(method: Method, data: Recordings) -> Method:
    """Return a method in which the settings that follow from the training data are filled in.

    Raises:
        EventFileError: see `field_of`.
        ModelError: the method does not support a field of this size.
    """
    return method.fitting(field_of(data))


def field_of(data: Recordings) -> tuple[int, int]:
    """Return width and height of the field that covers all training recordings, px.

    Raises:
        EventFileError: there are no recordings, all have the same class, or a recording is damaged.
    """
    labels = set(data.labels.tolist()) - {UNKNOWN}
    if len(labels) < 2:
        problem = f"has only the class '{data.classes[labels.pop()]}'" if labels else "has no recordings with a class"
        if data.layout == "recording":
            problem = "is a single recording"
        raise EventFileError(data.path, f"{problem}: expected recordings of at least two classes")
    return data.sensor_size(setting="--set size=[WIDTH, HEIGHT]")


def digest_of(fingerprint: str) -> str:
    """Return a short hash of a data set's fingerprint."""
    return hashlib.blake2b(fingerprint.encode(), digest_size=16).hexdigest()


def training_record(method: Method, digest: str, recordings: int, seed: int, backend: str) -> dict[str, Any]:
    """Return the conditions of a training, without the settings of the method."""
    return {"seed": seed, "backend": backend, "data": digest, "recordings": recordings, "code": code_of(method)}


def check_same(out: Path, there: tuple[Method, Training], now: tuple[Method, Training]) -> None:
    """Check that a training has the same settings and conditions as the recogniser that it would replace.

    Args:
        out: file of the recogniser.
        there: method and training of the recogniser in the file.
        now: method and training of the new recogniser.

    Raises:
        ModelError: a value differs; the message names the first value that differs.
    """
    before, after = ({"method": m.called(), **m.as_words(), **training} for m, training in (there, now))
    for name in before | after:
        values = before.get(name), after.get(name)
        if values[0] != values[1]:
            # A setting that chooses a part is a dict, whose only key is the name of the part.
            old, new = (next(iter(value)) if isinstance(value, dict) else value for value in values)
            difference = OTHER.get(name, f"{name} = {old}: found {new} now")
            raise ModelError(f"{out}: a recogniser that was trained with {difference}", hint=REPLACE)


AT_MOST = 4
"""Largest number of prepared functions in `Ready`; the least recently used function is dropped first."""

Ask: TypeAlias = Callable[[Features], Answer]


class Ready:
    """Cache of prepared scoring functions (`Method.asker`), one for each training result and backend.

    Copies start empty, also when pickled for another process.
    """

    def __init__(self) -> None:
        self._askers: OrderedDict[tuple[int, str], tuple[Learnt, Ask]] = OrderedDict()

    def asker(self, method: Method, learnt: Learnt, backend: str) -> Ask:
        """Return the cached result of `Method.asker`, or create it.

        The cache does not compare methods, so a training result must always be passed with the same method.

        Raises:
            ModelError: the method cannot run on the backend.
        """
        key = (id(learnt), backend)
        if key not in self._askers:
            method.check_backend(backend)
            # A reference to `learnt` is stored, so that no other object can get the same id.
            self._askers[key] = learnt, method.asker(learnt, backend)
        self._askers.move_to_end(key)
        while len(self._askers) > AT_MOST:
            self._askers.popitem(last=False)
        return self._askers[key][1]

    def __reduce__(self) -> tuple[Any, ...]:
        return Ready, ()


Tell = Callable[[Progress], None]
FORMAT = "neuro recogniser 1"


@dataclass(frozen=True, slots=True, eq=False)
class Recogniser:
    """A trained recogniser: method, classes and everything that was learnt.

    Attributes:
        method: the method with its settings, including settings that followed from the training recordings.
        classes: names of the classes.
        learnt: arrays and texts by name.
        training: conditions of the training: seed, backend, number and hash of the recordings.
        early: data for early decisions; None until `learn_early` was run.
    """

    method: Method
    classes: tuple[str, ...]
    learnt: Learnt
    training: Mapping[str, Any] = field(default_factory=dict)
    early: Early | None = None
    _cache: Ready = field(default_factory=Ready, init=False, repr=False)

    def scores(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Floats:
        """Compute the score of each class.

        Args:
            recordings: a data set, several recordings, or a single recording.
            backend: backend that runs networks.

        Returns:
            (recordings, classes) scores, larger for a more likely class. A row without evidence is all NaN.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: a recording does not fit the method, or the backend cannot run the method.
        """
        return self.answer(recordings, backend).scores

    def predict(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Ints:
        """Return the class of each recording as an index into `classes`, -1 without evidence. Errors: see `scores`."""
        return choose(self.scores(recordings, backend))

    def scores_at(self, recording: Events, times_ms: Sequence[float], backend: str = "event") -> Floats:
        """Compute the score of each class from the first milliseconds of a recording.

        Args:
            recording: events of the recording.
            times_ms: durations counted from the first event, ms, >= 0, ascending.
            backend: backend that runs networks.

        Returns:
            (times, classes) scores, see `scores`. Row i depends only on events up to time i. If `learn_early` trained
            on beginnings separately, each row uses the training for its duration.

        Raises:
            ModelError: a time is negative, the times are not ascending, or the recording does not fit the method.
        """
        times = np.asarray(times_ms, float)
        if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times, prepend=0.0) < 0):
            raise neuro.ModelError(f"times_ms = {list(times_ms)}: expected times >= 0 in ascending order, ms")
        times_us = [round(1000.0 * t) for t in times]
        evidence = self.method.observe_until(recording, times_us)
        if self.early is None or not self.early.learnt:
            return self.answer_shown(unlabelled(evidence, self.classes), backend).scores
        rows = [self._scores_after(backend)(time, item) for time, item in zip(times_us, evidence, strict=True)]
        return np.array(rows).reshape(-1, len(self.classes))

    def changed(self, values: Mapping[str, Any]) -> Recogniser:
        """Return a recogniser with other settings and the same `learnt`, but without the result of `learn_early`.

        Args:
            values: new values of settings in `Method.changeable`, by name. E.g. a network that learnt from some of the
                frames can be tested on other frames.

        Raises:
            ModelError: a setting cannot be changed after training, or its value is wrong.
        """
        method = self.method.changed(values)
        old, new = self.method.as_words(), method.as_words()
        for name in new:
            if new[name] != old[name] and name not in method.changeable:
                changeable = ", ".join(method.changeable) or "none"
                raise neuro.ModelError(
                    f"{method.place()}: '{name}' cannot be changed after training, which depends on it",
                    hint=f"settings that can be changed: {changeable}; or train again",
                )
        return with_changes(self, method=method, early=None) if new != old else self

    def learnt_at(self, after_us: int) -> Learnt:
        """Return the training result to use for the first `after_us` us of a recording."""
        return self.early.at(after_us) or self.learnt if self.early else self.learnt

    def session(
        self,
        *,
        every_ms: float = 10.0,
        allow: float | None = None,
        assurance: float = ASSURANCE,
        window_ms: float | None = None,
        gap_ms: float | None = None,
        backend: str = "event",
    ) -> Session:
        """Start a session that decides while the events of a stream arrive.

        Args:
            every_ms: time between decisions, ms.
            allow: largest share of wrong decisions; needs `early`. `Decision.settled` is true once wrong decisions are
                expected to stay within this share.
            assurance: probability that the share of wrong decisions stays within `allow`, see `stopping_rule`.
            window_ms: longest stretch of the stream, ms. Then the session forgets all events, and the next event
                starts a new stretch. None uses the longest recording of `learn_early`, or else 1000 ms.
            gap_ms: longest pause without events, ms, which also ends a stretch; None for no limit.
            backend: backend that runs networks.

        Raises:
            ModelError: a time is not above 0, or the held-out recordings do not support the allowed error.
        """
        longest_ms = self.early.held.times_us[-1] / 1000.0 if self.early else WINDOW_MS
        interval = _microseconds("every_ms", every_ms)
        window = _microseconds("window_ms", longest_ms if window_ms is None else window_ms)
        gap = None if gap_ms is None else _microseconds("gap_ms", gap_ms)
        held_out, rule = self.early.held if self.early else None, None
        if allow is not None and held_out is None:
            raise neuro.ModelError(
                "the recogniser has not learnt when it may stop",
                hint="learn_early, or 'neuro recognise early MODEL --data FOLDER'",
            )
        if allow is not None and held_out is not None:
            rule = stopping_rule(held_out, allow, assurance)
        return Session(self.method.observer, self._scores_after(backend), interval, window, gap, held_out, rule)

    def _scores_after(self, backend: str) -> Callable[[int, Evidence], Floats]:
        """Return a function that computes scores, (classes,), from the time since the first event, us, and evidence."""

        def ask(after_us: int, evidence: Evidence) -> Floats:
            features = unlabelled([evidence], self.classes)
            scores: Floats = self._cache.asker(self.method, self.learnt_at(after_us), backend)(features).scores[0]
            return scores

        return ask

    def answer(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Answer:
        """Return scores, scores by other decision rules, and the network's run. Arguments and errors: see `scores`."""
        self._cache.asker(self.method, self.learnt, backend)  # raises errors before any recording is read
        return self.answer_shown(self.shown(recordings), backend)

    def answer_shown(self, features: Features, backend: str = "event") -> Answer:
        """Return the answer for evidence that `shown` computed. Without recordings, the scores are an empty array."""
        ask = self._cache.asker(self.method, self.learnt, backend)
        return ask(features) if len(features) else Answer(np.empty((0, len(self.classes))))

    def shown(self, recordings: Recordings | Iterable[Events] | Events) -> Features:
        """Compute the evidence of recordings."""
        if isinstance(recordings, Recordings):
            return observe(self.method, recordings)
        several = [recordings] if isinstance(recordings, Events) else recordings
        return observed(self.method, several, self.classes)

    def network(self) -> neuro.Network | None:
        """Return the learnt network; None for a method without a network."""
        return self.method.network(self.learnt)

    def save(self, path: Path) -> None:
        """Write the recogniser to a file. An existing recogniser of that name is replaced.

        ```
        /            attributes: format "neuro recogniser 1", method, settings and training (JSON), and the versions of
             neuro, python, numpy and numba
        /classes     names of the classes
        /learnt      arrays and texts by name, as returned by the method's `fit`
        /early       data for early decisions, if `learn_early` was run: see `neuro_recognise.deciding`
        ```

        Raises:
            Unwritable: the file cannot be written, or the name belongs to something other than a recogniser.
        """
        options = {word: self.training.get(word) for word in ("backend", "seed")}
        with hdf5.writing(path, FORMAT, record=provenance(**options)) as file:
            file.attrs["method"] = self.method.called()
            file.attrs["settings"] = json.dumps(self.method.as_words())
            file.attrs["training"] = json.dumps(dict(self.training))
            file.attrs.update({"neuro": neuro.__version__, "python": platform.python_version()})
            file.attrs.update({name: version(name) for name in ("numpy", "numba")})
            file["classes"] = list(self.classes)
            group = file.create_group("learnt")
            for name, part in self.learnt.items():
                group[name] = part
            if self.early is not None:
                self.early.write(file.create_group("early"))

    @classmethod
    def load(cls, path: Path) -> Recogniser:
        """Read a recogniser from a file.

        Raises:
            ModelError: the file is missing, damaged or no recogniser, or its method is not installed.
        """
        with hdf5.reading(path, FORMAT) as file:
            record_input(path)
            method = method_of(str(file.attrs["method"])).from_words(json.loads(file.attrs["settings"]))
            classes = tuple(file["classes"].asstr()[:].tolist())
            learnt = {name: part_of(data) for name, data in file["learnt"].items()}
            early = Early.read(file["early"]) if "early" in file else None
            return cls(method, classes, learnt, json.loads(file.attrs["training"]), early)


def fit(
    data: Recordings,
    method: str | Method = "remus",
    *,
    seed: int = 0,
    backend: str = "event",
    out: Path | None = None,
    replace: bool = False,
    cache: Path | None = None,
    report: Tell | None = None,
) -> Recogniser:
    """Train a recogniser.

    Args:
        data: labelled recordings.
        method: name of a method, or a method with its own settings.
        seed: seed of all random numbers.
        backend: backend that runs networks.
        out: file for the recogniser. Checkpoints are stored beside it: the same call resumes an interrupted training
            and gives the same bits. A finished training is not repeated.
        replace: whether `out` may replace a recogniser of a different training.
        cache: folder for evidence of the recordings; None uses the user's cache.
        report: function that is called with the progress.

    Returns:
        The recogniser.

    Raises:
        ModelError: a setting or the backend is wrong, a recording does not fit, there is nothing to learn, or `out`
            belongs to a different training.
        EventFileError: a recording is damaged, or all recordings are of one class.
    """
    chosen = method if isinstance(method, Method) else method_of(method)
    chosen.check_backend(backend)
    fixed, fingerprint, tell = settled(chosen, data), data.fingerprint(), report or (lambda progress: None)
    digest = digest_of(fingerprint)
    training = training_record(fixed, digest, len(data), seed, backend)

    def look(done: int, n: int) -> None:
        tell(Progress("looking at recordings", done, n))

    features = partial(observe, fixed, data, fingerprint=fingerprint, cache=cache, report=look)
    return _train_and_save(fixed, features, training, Course(seed, backend, None, tell), out, replace)


def learn(
    method: Method,
    features: Features,
    digest: str,
    *,
    seed: int = 0,
    backend: str = "event",
    out: Path | None = None,
    replace: bool = False,
    report: Tell = lambda progress: None,
) -> Recogniser:
    """Train on evidence that was computed before.

    Args:
        method: method in which the settings that follow from the sensor are filled in.
        features: evidence of the recordings.
        digest: hash of the recordings, see `digest_of`.
        seed: seed of all random numbers.
        backend: backend that runs networks.
        out: see `fit`.
        replace: see `fit`.
        report: function that is called with the progress.

    Raises:
        ModelError: see `fit`.
    """
    method.check_backend(backend)
    training = training_record(method, digest, len(features), seed, backend)
    return _train_and_save(method, lambda: features, training, Course(seed, backend, None, report), out, replace)


def _train_and_save(
    method: Method,
    look: Callable[[], Features],
    training: Training,
    course: Course,
    out: Path | None,
    replace: bool,
) -> Recogniser:
    """Train on the evidence that `look` returns, and write the result to `out`, with checkpoints beside it.

    Raises:
        ModelError: `out` cannot be written, or belongs to a different training and `replace` is false.
    """
    if out is None:
        features = look()
        return Recogniser(method, features.classes, method.fit(features, course), training)
    conditions = {"method": method.called(), "settings": method.fixed(), **training}
    checkpoint = Checkpoint(out, "neuro recogniser training 1", conditions)
    # Errors about `out` are raised before the long computation.
    check_output(out, hdf5.kind(FORMAT))
    if not replace and hdf5.has_format(out, FORMAT):
        recogniser = Recogniser.load(out)
        check_same(out, (recogniser.method, recogniser.training), (method, training))
    else:
        features = look()
        learnt = method.fit(features, with_changes(course, checkpoint=checkpoint))
        recogniser = Recogniser(method, features.classes, learnt, training)
        recogniser.save(out)
    checkpoint.remove()
    return recogniser


def _microseconds(name: str, value: float) -> int:
    """Convert a time in ms to whole us.

    Raises:
        ModelError: the time is not finite, or below 1 us.
    """
    if not np.isfinite(value) or round(1000.0 * value) < 1:
        raise neuro.ModelError(f"{name} = {value:g}: expected a time above 0 ms")
    return round(1000.0 * value)
