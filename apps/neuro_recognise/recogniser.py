"""A trained recogniser, what users hold, and how one is trained: what makes its training the same as another."""

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
    """A method with everything decided that follows from the recordings to learn from.

    Raises:
        EventFileError: as of `field_of`.
        ModelError: the method cannot look at a field of this size.
    """
    return method.fitting(field_of(data))


def field_of(data: Recordings) -> tuple[int, int]:
    """Width and height of the field that recordings to learn from need, px.

    Raises:
        EventFileError: there are none, all are of one class, or one is damaged.
    """
    there = set(data.labels.tolist()) - {UNKNOWN}
    if len(there) < 2:
        only = f"has only the class '{data.classes[there.pop()]}'" if there else "has no recordings with a class"
        if data.layout == "recording":
            only = "is a single recording"
        raise EventFileError(data.path, f"{only}: expected recordings of at least two classes")
    return data.sensor_size(setting="--set size=[WIDTH, HEIGHT]")


def digest_of(fingerprint: str) -> str:
    """A short text that differs for other recordings."""
    return hashlib.blake2b(fingerprint.encode(), digest_size=16).hexdigest()


def training_record(method: Method, digest: str, recordings: int, seed: int, backend: str) -> dict[str, Any]:
    """The record of a training beside the settings."""
    return {"seed": seed, "backend": backend, "data": digest, "recordings": recordings, "code": code_of(method)}


def check_same(out: Path, there: tuple[Method, Training], now: tuple[Method, Training]) -> None:
    """Refuse to replace a recogniser by that of another training.

    Raises:
        ModelError: with the first thing that differs.
    """
    before, after = ({"method": one.called(), **one.as_words(), **training} for one, training in (there, now))
    for name in before | after:
        values = before.get(name), after.get(name)
        if values[0] != values[1]:
            was, found = (next(iter(value)) if isinstance(value, dict) else value for value in values)  # a part's name
            what = OTHER.get(name, f"{name} = {was}: found {found} now")
            raise ModelError(f"{out}: a recogniser that was trained with {what}", hint=REPLACE)


AT_MOST = 4
"""Kept ready; those that were not asked for longest go first."""

Ask: TypeAlias = Callable[[Features], Answer]


class Ready:
    """Functions that answer, of a few things learnt.

    Copies, also those for another process, begin with none.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, str], tuple[Learnt, Ask]] = OrderedDict()

    def asker(self, method: Method, learnt: Learnt, backend: str) -> Ask:
        """That of `Method.asker`, made where it is not there. One thing learnt is always asked by one method.

        Raises:
            ModelError: the method cannot run on the backend.
        """
        key = (id(learnt), backend)
        if key not in self._kept:
            method.check_backend(backend)
            # what was learnt is kept, too, so that no other gets its id
            self._kept[key] = learnt, method.asker(learnt, backend)
        self._kept.move_to_end(key)
        while len(self._kept) > AT_MOST:
            self._kept.popitem(last=False)
        return self._kept[key][1]

    def __reduce__(self) -> tuple[Any, ...]:
        return Ready, ()


Tell = Callable[[Progress], None]
FORMAT = "neuro recogniser 1"


@dataclass(frozen=True, slots=True, eq=False)
class Recogniser:
    """What training gives, and all that recognising needs.

    Attributes:
        method: settings of the training, with all that followed from the recordings.
        classes: names.
        learnt: arrays and texts by name.
        training: what it was trained on and with: seed, backend, number and hash of the recordings.
        early: what decisions while events arrive need; None where it was not learnt (see `learn_early`).
    """

    method: Method
    classes: tuple[str, ...]
    learnt: Learnt
    training: Mapping[str, Any] = field(default_factory=dict)
    early: Early | None = None
    _ready: Ready = field(default_factory=Ready, init=False, repr=False)

    def scores(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Floats:
        """What speaks for each class.

        Args:
            recordings: a data set, some recordings, or one.
            backend: runs networks.

        Returns:
            (recordings, classes), the larger, the more; NaN in all of a row where nothing speaks for any class.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: one does not fit the method, or the backend cannot run it.
        """
        return self.answer(recordings, backend).scores

    def predict(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Ints:
        """The class of each recording, an index into `classes`; -1 where nothing speaks for any. Errors as `scores`."""
        return choose(self.scores(recordings, backend))

    def scores_at(self, recording: Events, times_ms: Sequence[float], backend: str = "event") -> Floats:
        """What speaks for each class after the first milliseconds of a recording.

        Args:
            recording: its events.
            times_ms: from its first event on, >= 0, ascending.
            backend: runs networks.

        Returns:
            (times, classes), as of `scores`; what comes after a time has no influence on its row. Where beginnings
            were learnt apart (see `learn_early`), that of a beginning is asked.

        Raises:
            ModelError: a time is below 0 or they run back, or the recording does not fit the method.
        """
        times = np.asarray(times_ms, float)
        if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times, prepend=0.0) < 0):
            raise neuro.ModelError(f"times_ms = {list(times_ms)}: expected times >= 0 in ascending order, ms")
        times_us = [round(1000.0 * t) for t in times]
        evidence = self.method.observe_until(recording, times_us)
        if self.early is None or not self.early.learnt:
            return self.answer_shown(unlabelled(evidence, self.classes), backend).scores
        rows = [self._asked(backend)(time, one) for time, one in zip(times_us, evidence, strict=True)]
        return np.array(rows).reshape(-1, len(self.classes))

    def changed(self, values: Mapping[str, Any]) -> Recogniser:
        """What was learnt, with other settings of how recordings are looked at; without what `learn_early` learnt.

        Args:
            values: by name, of `Method.changeable`: a network that learnt from some frames may be asked about others.

        Raises:
            ModelError: what was learnt depends on a setting, or its value is wrong.
        """
        method = self.method.changed(values)
        was, now = self.method.as_words(), method.as_words()
        for name in now:
            if now[name] != was[name] and name not in method.changeable:
                known = ", ".join(method.changeable) or "none"
                raise neuro.ModelError(
                    f"{method.place()}: '{name}' cannot be changed after training, which depends on it",
                    hint=f"what can: {known}; or train anew",
                )
        return with_changes(self, method=method, early=None) if now != was else self

    def learnt_at(self, after_us: int) -> Learnt:
        """What is asked after so much of a recording, us."""
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
        """Decide while the events of a stream arrive.

        Args:
            every_ms: from moment to moment.
            allow: share of wrong decisions at which `Decision.settled` says that it can be stopped; needs `early`.
            assurance: probability with which no larger share is wrong, see `stopping_rule`.
            window_ms: after so long all is forgotten, and the next event begins anew; None takes the length of the
                longest recording that `early` was learnt from, else 1000 ms.
            gap_ms: likewise after a pause without events; None for no such pause.
            backend: runs networks.

        Raises:
            ModelError: a time is not above 0, or the held-out recordings do not support the allowed error.
        """
        seen = self.early.held.times_us[-1] / 1000.0 if self.early else WINDOW_MS
        every = _microseconds("every_ms", every_ms)
        window = _microseconds("window_ms", seen if window_ms is None else window_ms)
        gap = None if gap_ms is None else _microseconds("gap_ms", gap_ms)
        held, rule = self.early.held if self.early else None, None
        if allow is not None and held is None:
            raise neuro.ModelError(
                "the recogniser has not learnt when it may stop",
                hint="learn_early, or 'neuro recognise early MODEL --data FOLDER'",
            )
        if allow is not None and held is not None:
            rule = stopping_rule(held, allow, assurance)
        return Session(self.method.observer, self._asked(backend), every, window, gap, held, rule)

    def _asked(self, backend: str) -> Callable[[int, Evidence], Floats]:
        """A function of a time after the first event, us, and what was seen until then, that gives the scores."""

        def ask(after_us: int, evidence: Evidence) -> Floats:
            shown = unlabelled([evidence], self.classes)
            scores: Floats = self._ready.asker(self.method, self.learnt_at(after_us), backend)(shown).scores[0]
            return scores

        return ask

    def answer(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Answer:
        """Scores, those of other votes, and what it took to find them. Arguments and errors as of `scores`."""
        self._ready.asker(self.method, self.learnt, backend)  # what cannot run shows before recordings are read
        return self.answer_shown(self.shown(recordings), backend)

    def answer_shown(self, shown: Features, backend: str = "event") -> Answer:
        """Likewise of what was looked at before, see `shown`; of nothing there are no scores."""
        ask = self._ready.asker(self.method, self.learnt, backend)
        return ask(shown) if len(shown) else Answer(np.empty((0, len(self.classes))))

    def shown(self, recordings: Recordings | Iterable[Events] | Events) -> Features:
        """What recordings show to this recogniser."""
        if isinstance(recordings, Recordings):
            return observe(self.method, recordings)
        many = [recordings] if isinstance(recordings, Events) else recordings
        return observed(self.method, many, self.classes)

    def network(self) -> neuro.Network | None:
        """The learnt network, None for a method without."""
        return self.method.network(self.learnt)

    def save(self, path: Path) -> None:
        """Write a file, in the place of another recogniser of that name.

        ```
        /            attributes: format "neuro recogniser 1", method, settings and training (JSON), and the versions of
                     neuro, python, numpy and numba
        /classes     names of the classes
        /learnt      arrays and texts by name, as the method gives them
        /early       what decisions while events arrive need, where it was learnt: see `neuro_recognise.deciding`
        ```

        Raises:
            Unwritable: it cannot be written, or something else stands there.
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
        """Read a file.

        Raises:
            ModelError: there is no such file, it is something else or damaged, or of a method that is not there.
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
        method: its name, or one with settings of its own.
        seed: of everything random.
        backend: runs networks.
        out: file for the recogniser. What is reached is kept beside it, and the same call goes on from there to the
            same bits. A training that is complete is not done again.
        replace: whether `out` takes the place of a recogniser of another training.
        cache: folder for what is computed of the recordings; None takes the user's.
        report: called with the progress.

    Returns:
        The recogniser.

    Raises:
        ModelError: a setting or the backend is wrong, a recording does not fit, there is nothing to learn, or `out`
            belongs to another training.
        EventFileError: a recording is damaged, or all are of one class.
    """
    chosen = method if isinstance(method, Method) else method_of(method)
    chosen.check_backend(backend)
    fixed, fingerprint, tell = settled(chosen, data), data.fingerprint(), report or (lambda progress: None)
    digest = digest_of(fingerprint)
    training = training_record(fixed, digest, len(data), seed, backend)

    def look(done: int, n: int) -> None:
        tell(Progress("looking at recordings", done, n))

    shown = partial(observe, fixed, data, fingerprint=fingerprint, cache=cache, report=look)
    return _learn(fixed, shown, training, Course(seed, backend, None, tell), out, replace)


def learn(
    method: Method,
    shown: Features,
    digest: str,
    *,
    seed: int = 0,
    backend: str = "event",
    out: Path | None = None,
    replace: bool = False,
    report: Tell = lambda progress: None,
) -> Recogniser:
    """Train on what was observed before.

    Args:
        method: with all that follows from the sensor decided.
        shown: what the recordings show to it.
        digest: differs for other recordings.
        seed: of everything random.
        backend: runs networks.
        out: as of `fit`.
        replace: as of `fit`.
        report: called with the progress.

    Raises:
        ModelError: as of `fit`.
    """
    method.check_backend(backend)
    training = training_record(method, digest, len(shown), seed, backend)
    return _learn(method, lambda: shown, training, Course(seed, backend, None, report), out, replace)


def _learn(
    method: Method,
    look: Callable[[], Features],
    training: Training,
    course: Course,
    out: Path | None,
    replace: bool,
) -> Recogniser:
    """Train on what `look` gives, and write what was learnt to `out`; what is reached is kept beside it until then.

    Raises:
        ModelError: `out` cannot be written, or is of another training that is not to be replaced.
    """
    if out is None:
        shown = look()
        return Recogniser(method, shown.classes, method.fit(shown, course), training)
    asked = {"method": method.called(), "settings": method.fixed(), **training}
    checkpoint = Checkpoint(out, "neuro recogniser training 1", asked)
    # what stands in the way, or is done already, shows before long work
    check_output(out, hdf5.kind(FORMAT))
    if not replace and hdf5.has_format(out, FORMAT):
        made = Recogniser.load(out)
        check_same(out, (made.method, made.training), (method, training))
    else:
        shown = look()
        learnt = method.fit(shown, with_changes(course, checkpoint=checkpoint))
        made = Recogniser(method, shown.classes, learnt, training)
        made.save(out)
    checkpoint.remove()
    return made


def _microseconds(name: str, value: float) -> int:
    """A time in ms as whole us.

    Raises:
        ModelError: it is none above 0.
    """
    if not np.isfinite(value) or round(1000.0 * value) < 1:
        raise neuro.ModelError(f"{name} = {value:g}: expected a time above 0 ms")
    return round(1000.0 * value)
