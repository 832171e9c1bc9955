"""Relearning experiment: the labels are permuted after some epochs, training continues, and accuracy is measured.

FOLDER/METHOD-SEED.json    accuracies of a method with one seed; a result of the same code is not computed again
FOLDER/relearn.png         accuracy of all methods after each epoch
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError, apps
from neuro.apps import setting
from neuro_events import Recordings
from neuro_recognise.compare import Contestant, contestants, telling
from neuro_recognise.method import Answer, Course, Learnt, Progress, choose
from neuro_recognise.methods.framewise import Framewise, frames_to_learn_from
from neuro_recognise.observations import code_of, observe
from neuro_recognise.parts.frames import Frames
from neuro_recognise.recogniser import field_of
from neuro_recognise.shown import Array, Features, Floats, Ints

RESULTS = apps.JobResults("a result of 'neuro recognise relearn'", "neuro recognise relearn 1")
RULES = ("remus", "remus:relearns", "remus:adapted", "remus:thesis", "mozafari", "linear")
"""Default methods."""


@dataclass(frozen=True)
class Linear(Framewise):
    """Softmax regression on the spikes of a frame, trained online. An earlier spike is a larger input.

    Attributes:
        rate: learning rate; each frame is one step of gradient descent.
    """

    title = "softmax regression, online"
    source = "the linear twin of ReMuS: same frames, order and epochs"
    spikes = False
    order: str = setting("frames", "", "items to shuffle in each epoch", "as ReMuS", words=("frames",))
    rate: float = setting(0.01, "", "learning rate of gradient descent", "not tuned", above=0)

    def fit(self, features: Features, course: Course) -> Learnt:
        """Return ``weights`` (inputs, classes) and ``history`` (epochs,), the share of right decisions on frames.

        Raises:
            ModelError: there are no frames to learn from.
        """
        frames, state = frames_to_learn_from(features, self.segmenter), course.resume()
        labels, values = features.labels[frames.recording], self._values(frames)
        weights = state.get("weights", np.zeros((int(np.prod(self.inputs.shape)), len(features.classes))))
        history = [*state.get("history", ())]
        for epoch in range(len(history), self.epochs):
            n_right = 0
            for frame in np.random.default_rng([course.seed, epoch]).permutation(len(frames)):
                spikes, label = slice(*frames.offsets[frame : frame + 2]), labels[frame]
                ids, x = frames.ids[spikes], values[spikes]
                scores = x @ weights[ids]
                n_right += int(scores.argmax() == label)
                error = np.exp(scores - scores.max())
                error /= error.sum()
                error[label] -= 1.0
                weights[ids] -= self.rate * np.outer(x, error)
            history.append(n_right / len(frames))
            course.keep(weights=weights, history=np.array(history))
            course.report(Progress(f"epoch {epoch + 1} of {self.epochs}", len(frames), len(frames), history[-1]))
        return {"weights": weights, "history": np.array(history)}

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Prepare scoring by the sum over the scores of all frames."""

        def ask(features: Features) -> Answer:
            frames, sums = Frames.of(features), np.zeros((len(features), len(features.classes)))
            products = self._values(frames)[:, None] * np.asarray(learnt["weights"])[frames.ids]
            np.add.at(sums, np.repeat(frames.recording, np.diff(frames.offsets)), products)
            return Answer(np.where(sums.any(axis=1, keepdims=True), sums, np.nan))

        return ask

    def _values(self, frames: Frames) -> Floats:
        """Return the input of each spike, (spikes,): 1 at the start of its frame, 0 at the end."""
        return 1.0 - self.encoder.times(frames.codes, {}) / self.inputs.window


@dataclass(frozen=True)
class Remembered(Course):
    """A course whose state is kept in memory, so that each epoch continues from the last one."""

    reached: dict[str, Any] = field(default_factory=dict)

    def resume(self) -> dict[str, Any]:
        """Return the last state that `keep` stored."""
        return self.reached

    def keep(self, **parts: Array | Mapping[str, Array]) -> None:
        """Store the state of the training, and replace the previous state."""
        self.reached.update(parts)


@dataclass(frozen=True, slots=True, eq=False)
class Relearner:
    """A training of one seed, a job of `neuro.apps.grid`.

    Attributes:
        name: name in progress reports.
        method: the method with its settings.
        learning, testing: evidence of the recordings to train on, and of the recordings to test on.
        of: conditions that determine the result, as plain data.
        file: file of the result.
    """

    name: str
    method: Framewise
    learning: Features
    testing: Features
    of: Mapping[str, Any]
    file: Path

    def work(self, report: Callable[[tuple[str, Progress | None]], None]) -> dict[str, Any]:
        """Train epoch by epoch, and test after each epoch."""
        seed, backend, epochs_before = self.of["seed"], self.of["backend"], self.of["before"]
        course = Remembered(seed, backend, None, lambda progress: report((self.name, progress)))
        train_features, test_features, accuracies, silent = self.learning, self.testing, [], []
        for epoch in range(epochs_before + self.of["after"]):
            if epoch == epochs_before:
                train_features, test_features = self._permuted(train_features), self._permuted(test_features)
            learnt = self.method.changed({"epochs": epoch + 1}).fit(train_features, course)
            decisions = choose(self.method.answer(learnt, test_features, backend).scores)
            accuracies.append(float(np.mean(decisions == test_features.labels)))
            silent.append(float(np.mean(decisions < 0)))
        report((self.name, None))
        return {
            "provenance": apps.provenance(backend=backend, seed=seed),
            "accuracies": accuracies,
            "silent": silent,
            "history": np.asarray(learnt["history"]).tolist(),
        }

    def _permuted(self, features: Features) -> Features:
        return replace(features, labels=permuted(features.labels, len(features.classes), self.of["seed"]))


@dataclass(frozen=True, slots=True)
class Relearning:
    """The plan of a relearning experiment.

    Attributes:
        contestants: methods.
        before: number of epochs with the true labels.
        after: number of epochs with permuted labels.
        folds: number of folds for each seed. The first fold is tested, and the other folds are used to train.
        seeds: seeds of folds, permutations and trainings.
        folder: folder for results.
        backend: backend that runs networks.
        jobs: number of trainings that run in parallel; None for one per core.
    """

    contestants: tuple[Contestant, ...]
    before: int
    after: int
    folds: int
    seeds: tuple[int, ...]
    folder: Path
    backend: str = "event"
    jobs: int | None = None


def rules(names: Sequence[str] = (), values: Mapping[str, Any] | None = None) -> tuple[Contestant, ...]:
    """Return methods that learn from labels epoch by epoch.

    Args:
        names: names of methods, see `neuro_recognise.compare.contestants`, or ``linear``; `RULES` if empty.
        values: settings for all of these methods.

    Raises:
        ModelError: a method does not exist, does not learn from labels epoch by epoch, or a value is wrong.
    """
    chosen = []
    for name in names or RULES:
        entry = Contestant(name, Linear()) if name == "linear" else contestants([name])[0]
        if not isinstance(entry.method, Framewise) or not entry.method.layer.supervised:
            raise ModelError(f"{entry.method.place()} does not learn from labels epoch by epoch", hint=", ".join(RULES))
        chosen.append(replace(entry, method=entry.method.changed(values or {})))
    return tuple(chosen)


def permuted(labels: Ints, classes: int, seed: int) -> Ints:
    """Permute the labels so that no class keeps its label. Each class gets the label of the class before it in a cycle.

    The seed determines the cycle. E.g. the cycle 2, 0, 1 gives class 2 the label 1, class 0 the label 2, and class 1
    the label 0.
    """
    circle = np.random.default_rng([seed, 57]).permutation(classes)
    permutation = np.empty(classes, np.int64)
    permutation[circle] = np.roll(circle, 1)
    return permutation[labels]


def relearn(
    data: Recordings, plan: Relearning, report: Callable[[Progress], None] = lambda progress: None
) -> dict[str, Floats]:
    """Train, permute the labels, and continue the training. Results that are already in the folder are reused.

    Args:
        data: labelled recordings.
        plan: plan of the experiment.
        report: function that is called with the progress.

    Returns:
        (seeds, epochs) accuracy on the held-out fold after each epoch, by method name. From epoch `plan.before` on, the
        labels of the held-out recordings are permuted as well.

    Raises:
        EventFileError: a recording is damaged, or all recordings are of one class.
        ModelError: the backend does not exist, recordings do not fit, or a file in the folder has another origin.
    """
    apps.find_backend(plan.backend)
    apps.make_folder(plan.folder)
    fingerprint, jobs = data.fingerprint(), []
    for entry in plan.contestants:
        method = entry.method if any(entry.method.size) else entry.method.fitting(field_of(data))
        assert isinstance(method, Framewise)
        look = lambda done, n, name=entry.name: report(Progress(f"{name}: looking", done, n))  # noqa: E731
        features = observe(method, data, fingerprint=fingerprint, report=look)
        for seed in plan.seeds:
            train_rows, test_rows = data.folds(plan.folds, seed=seed)[0]
            key: dict[str, Any] = {"method": method.called(), "settings": dict(method.fixed()), "code": code_of(method)}
            key |= {"data": fingerprint[:32], "backend": plan.backend, "seed": seed, "folds": plan.folds}
            key |= {"before": plan.before, "after": plan.after}
            file = plan.folder / f"{entry.name.replace(':', '-')}-{seed}.json"
            jobs.append(
                Relearner(
                    f"{entry.name}, seed {seed}", method, features.take(train_rows), features.take(test_rows), key, file
                )
            )
    queue = sorted(
        jobs, key=lambda job: job.of["seed"]
    )  # an interrupted run has about equally many seeds of each method
    results = apps.grid(RESULTS, queue, plan.jobs, telling(report, len(jobs)))
    lookup = {job.file: result["accuracies"] for job, result in zip(queue, results, strict=True)}
    rates = np.array([lookup[job.file] for job in jobs]).reshape(len(plan.contestants), len(plan.seeds), -1)
    return {entry.name: rows for entry, rows in zip(plan.contestants, rates, strict=True)}
