"""A trained recogniser: what users hold, and its file.

```
/            attributes: format "neuro recogniser 1", method, settings and training (JSON), and the versions of neuro,
             python, numpy and numba
/classes     names of the classes
/learnt      arrays and texts by name, as the method gives them
```
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import neuro
from neuro.apps import Checkpoint, check_output, hdf5, unknown
from neuro.events import EventFileError, Events, Recordings
from neuro_recognise.method import Answer, Course, Learnt, Method, Progress, choose
from neuro_recognise.methods import METHODS
from neuro_recognise.observations import observe, observed
from neuro_recognise.shown import Floats, Ints, Shown

__all__ = ["FORMAT", "Recogniser", "fit", "method_of"]

FORMAT = "neuro recogniser 1"
Tell = Callable[[Progress], None]


def method_of(name: str, settings: str = "", values: Mapping[str, Any] | None = None) -> Method:
    """A method by its name.

    Args:
        name: see `neuro recognise list`.
        settings: the name of one of its presets; "" for the defaults.
        values: what differs from these, by name.

    Raises:
        ModelError: there is no such method or preset, or a value is wrong.
    """
    if name not in METHODS:
        raise unknown("method", name, METHODS)
    method = METHODS[name]()
    return (method.preset(settings) if settings else method).changed(values or {})


@dataclass(frozen=True, slots=True, eq=False)
class Recogniser:
    """What training gives, and all that recognising needs.

    Attributes:
        method: settings of the training, with all that followed from the recordings.
        classes: names.
        learnt: arrays and texts by name.
        training: what it was trained on and with: seed, backend, number and hash of the recordings.
    """

    method: Method
    classes: tuple[str, ...]
    learnt: Learnt
    training: Mapping[str, Any] = field(default_factory=dict)

    def scores(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Floats:
        """What speaks for each class.

        Args:
            recordings: a data set, some recordings, or one.
            backend: runs networks.

        Returns:
            (recordings, classes), the larger, the more; NaN in all of a row where nothing speaks for any class.

        Raises:
            EventFileError: a recording is damaged or does not fit the method.
            ModelError: the same of recordings that are in memory.
        """
        return self.answer(recordings, backend).scores

    def predict(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Ints:
        """The class of each recording, an index into `classes`; -1 where nothing speaks for any. Errors as `scores`."""
        return choose(self.scores(recordings, backend))

    def scores_at(self, recording: Events, times_ms: Sequence[float]) -> Floats:
        """What speaks for each class after the first milliseconds of a recording.

        Args:
            recording: its events.
            times_ms: from its first event on, ascending.

        Returns:
            (times, classes), as of `scores`; what comes after a time has no influence on its row.

        Raises:
            ModelError: the times run back, or the recording does not fit the method.
        """
        times = np.asarray(times_ms, float)
        if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) < 0):
            raise neuro.ModelError(f"times_ms = {list(times_ms)}: expected times in ascending order, ms")
        evidence = self.method.observe_until(recording, [round(1000.0 * t) for t in times])
        return self.method.answer(self.learnt, _unlabelled(evidence, self.classes)).scores

    def answer(self, recordings: Recordings | Iterable[Events] | Events, backend: str = "event") -> Answer:
        """Scores, those of other votes, and what it took to find them. Arguments and errors as of `scores`."""
        return self.method.answer(self.learnt, self.shown(recordings), backend)

    def shown(self, recordings: Recordings | Iterable[Events] | Events) -> Shown:
        """What recordings show to this recogniser."""
        if isinstance(recordings, Recordings):
            return observe(self.method, recordings)
        many = [recordings] if isinstance(recordings, Events) else recordings
        return observed(self.method, many, self.classes)

    def network(self) -> neuro.Network | None:
        """The learnt network, None for a method without."""
        return self.method.network(self.learnt)

    def save(self, path: Path) -> None:
        """Write the file; another recogniser of that name is replaced once the new one is complete."""
        with hdf5.writing(path, FORMAT) as file:
            file.attrs["method"] = self.method.called()
            file.attrs["settings"] = json.dumps(self.method.as_words())
            file.attrs["training"] = json.dumps(dict(self.training))
            file.attrs.update(_versions())
            file["classes"] = list(self.classes)
            group = file.create_group("learnt")
            for name, part in self.learnt.items():
                group[name] = part

    @classmethod
    def load(cls, path: Path) -> Recogniser:
        """Read a file.

        Raises:
            ModelError: there is no such file, it is something else or damaged, or of a method that is not there.
        """
        with hdf5.reading(path, FORMAT) as file:
            method = method_of(str(file.attrs["method"])).from_words(json.loads(file.attrs["settings"]))
            classes = tuple(file["classes"].asstr()[:].tolist())
            learnt = {name: _part(data) for name, data in file["learnt"].items()}
            return cls(method, classes, learnt, json.loads(file.attrs["training"]))


def fit(
    data: Recordings,
    method: str | Method = "remus",
    *,
    seed: int = 0,
    backend: str = "event",
    out: Path | None = None,
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
        cache: folder for what is computed of the recordings; None takes the user's.
        report: is told the progress.

    Returns:
        The recogniser.

    Raises:
        ModelError: a setting is wrong, there is nothing to learn, or `out` belongs to another training.
        EventFileError: a recording is damaged or does not fit.
    """
    told = method if isinstance(method, Method) else method_of(method)
    _enough(data)
    settled = told.fitting(_size(data))
    tell: Tell = report or (lambda progress: None)
    shown = observe(settled, data, cache=cache, report=lambda done, n: tell(Progress("looking at recordings", done, n)))
    return learn(settled, shown, _digest(data), seed=seed, backend=backend, out=out, report=tell)


def learn(
    method: Method,
    shown: Shown,
    digest: str,
    *,
    seed: int = 0,
    backend: str = "event",
    out: Path | None = None,
    report: Tell = lambda progress: None,
) -> Recogniser:
    """Train on what was observed before.

    Args:
        method: with all that follows from the sensor decided.
        shown: what the recordings show to it.
        digest: tells these recordings from others.
        seed: of everything random.
        backend: runs networks.
        out: as of `fit`.
        report: is told the progress.

    Raises:
        ModelError: as of `fit`.
    """
    training = {"seed": seed, "backend": backend, "data": digest, "recordings": len(shown)}
    if out is None:
        return Recogniser(method, shown.classes, method.fit(shown, Course(seed, backend, None, report)), training)
    told = {"method": method.called(), "settings": method.fixed(), **training}
    checkpoint = Checkpoint(out, "neuro recogniser training 1", told)
    if (made := _made(out, method, training)) is None:
        check_output(out, hdf5.kind(FORMAT))
        learnt = method.fit(shown, Course(seed, backend, checkpoint, report))
        made = Recogniser(method, shown.classes, learnt, training)
        made.save(out)
    checkpoint.remove()
    return made


def _made(out: Path, method: Method, training: Mapping[str, Any]) -> Recogniser | None:
    """The finished recogniser of this very training, if it is there."""
    if not hdf5.has_format(out, FORMAT):
        return None
    there = Recogniser.load(out)
    same = there.method.as_words() == method.as_words() and type(there.method) is type(method)
    return there if same and dict(there.training) == training else None


def _enough(data: Recordings) -> None:
    """Refuse data from which nothing can be told apart."""
    there = {item.label for item in data}
    if len(there) < 2:
        only = f"only the class '{data.classes[there.pop()]}'" if there else "no recordings"
        raise EventFileError(data.path, f"has {only}: expected recordings of at least two classes")


def _size(data: Recordings) -> tuple[int, int]:
    """Width and height of the sensor, px."""
    return data[0].load().sensor_size


def _digest(data: Recordings) -> str:
    return hashlib.blake2b(data.fingerprint().encode(), digest_size=16).hexdigest()


def _unlabelled(evidence: list[Any], classes: tuple[str, ...]) -> Shown:
    return Shown(evidence, np.full(len(evidence), -1, np.int64), tuple(map(str, range(len(evidence)))), classes)


def _part(data: Any) -> Any:
    return data.asstr()[()] if data.dtype.kind == "O" else data[()]


def _versions() -> dict[str, str]:
    """What a file was written with."""
    packages = {"neuro": neuro.__version__} | {name: version(name) for name in ("numpy", "numba")}
    return {"python": platform.python_version()} | packages
