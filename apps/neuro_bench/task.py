"""Base classes of tasks, which provide folds of data in one form, and of methods, which fit a model to a fold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import install
from neuro_bench.costs import Costs

Floats = npt.NDArray[np.float32]
Series = npt.NDArray[np.float64]
"""Values of a series at equal intervals, shape (values,)."""
Ints = npt.NDArray[np.int64]
Kind = Literal["classes", "series", "regression"]
"""Kind of a task, and of the methods for it."""


@dataclass(frozen=True, slots=True, eq=False)
class Spikes:
    """Spikes of examples, at most one for each neuron and step.

    Attributes:
        shape: shape of the input, (sheets, rows, columns).
        steps: number of steps of an example.
        step: length of a step, ms.
        example: index of the example of each spike, ascending.
        at: step of each spike, from 0.
        neuron: neuron of each spike, as an index into the shape in C order.
    """

    shape: tuple[int, int, int]
    steps: int
    step: float
    example: Ints
    at: Ints
    neuron: Ints

    @classmethod
    def of_dense(cls, spikes: Any, step: float) -> Spikes:
        """Convert an array of shape (examples, steps, sheets, rows, columns), in which all values but 0 are spikes."""
        dense = np.asarray(spikes)
        if dense.ndim != 5:
            message = f"spikes: found the shape {dense.shape}"
            raise ModelError(f"{message}: expected (examples, steps, sheets, rows, columns)")
        example, step_index, neuron = dense.reshape(*dense.shape[:2], -1).nonzero()
        _, steps, sheets, rows, columns = dense.shape
        return cls((sheets, rows, columns), steps, step, example, step_index, neuron)

    def take(self, chosen: Ints, examples: int) -> Spikes:
        """Return the spikes of some examples.

        Args:
            chosen: indices of these examples, in the order of the result.
            examples: number of all examples.
        """
        ends = np.searchsorted(self.example, np.arange(examples + 1))
        lengths = ends[chosen + 1] - ends[chosen]
        ranges = [np.arange(ends[k], ends[k + 1]) for k in chosen]
        index = np.concatenate([np.zeros(0, np.int64), *ranges])
        example = np.repeat(np.arange(len(chosen)), lengths)
        return replace(self, example=example, at=self.at[index], neuron=self.neuron[index])


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Labelled examples in two forms: frames for non-spiking networks and spikes for spiking ones.

    Attributes:
        frames: shape (examples, channels, rows, columns). For sounds a row is a frequency band and a column a time.
        labels: class of each example, from 0, shape (examples,).
        classes: names of the classes.
        spikes: the same examples as spikes.
        versions: number of augmented versions of each recording, for training. With n recordings, example v n + k is
            version v of recording k. Version 0 is the original.
    """

    frames: Floats
    labels: Ints
    classes: tuple[str, ...]
    spikes: Spikes
    versions: int = 1

    def __post_init__(self) -> None:
        if self.frames.ndim != 4 or len(self.frames) != len(self.labels):
            message = f"frames: found the shape {self.frames.shape}"
            raise ModelError(f"{message}: expected ({len(self.labels)}, channels, rows, columns), one for each label")
        if len(self.labels) and not 0 <= self.labels.min() <= self.labels.max() < len(self.classes):
            raise ModelError(
                f"labels: found {self.labels.min()} to {self.labels.max()}: expected 0 to {len(self.classes) - 1}"
            )

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def recordings(self) -> int:
        """Number of recordings; each has `versions` examples."""
        return len(self) // self.versions

    def take(self, chosen: Ints, versions: int | None = None) -> Examples:
        """Return some recordings.

        Args:
            chosen: indices of these recordings, in the order of the result.
            versions: number of versions of each recording, from the first; None for all.
        """
        count = self.versions if versions is None else versions
        index = (np.arange(count)[:, None] * self.recordings + np.asarray(chosen, np.int64)).reshape(-1)
        spikes = self.spikes.take(index, len(self))
        return Examples(self.frames[index], self.labels[index], self.classes, spikes, count)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Spikes and target values of each step, for regression.

    Attributes:
        spikes: whether a channel spikes in a step, bool, shape (steps, channels).
        targets: values to predict at the end of each step, shape (steps, values).
        step: length of a step, ms.
    """

    spikes: npt.NDArray[np.bool_]
    targets: Floats
    step: float

    def __post_init__(self) -> None:
        if self.spikes.ndim != 2 or self.targets.ndim != 2 or len(self.spikes) != len(self.targets):
            message = f"spikes of the shape {self.spikes.shape} and targets of the shape {self.targets.shape}"
            raise ModelError(f"{message}: expected (steps, channels) and (steps, values) with equal steps")

    def __len__(self) -> int:
        return len(self.spikes)

    def take(self, steps: Any) -> Recording:
        """Return the given steps, a slice or an index array."""
        return Recording(self.spikes[steps], self.targets[steps], self.step)


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """Training, validation and test part of a data set, each as `Examples`, `Series` or `Recording`.

    Attributes:
        name: name of the fold in the results.
        train: training part for the choice of settings. For series, a list of series.
        validation: part whose score chooses the settings. For series, a list with the continuation of each series in
            `train`. Folds with the same list object share one choice of settings.
        both: data for the final training with the chosen settings: `train` and `validation` together. For series, the
            values before `test`.
        test: test part, used once.
    """

    name: str
    train: Any
    validation: Any
    both: Any
    test: Any


class Task:
    """Base class of tasks.

    Class attributes:
        kind: "classes", "series" or "regression". A regression predicts values at each step from the spikes so far.
        called_by: name on the command line.
        title: one-line description.
        licence: licence of the data.
        source: address of the data, and publication of the task.
        metric: name of the reported score, with its unit.
        higher: whether a higher score is better.
        needs_data: whether the user must specify the path of the data.
        splits: names of the splits into folds, the default first.

    Args:
        data: path of the data; nothing is downloaded.
        split: name of a split; by default the first of `splits`.
        seed: seed of random folds.

    Raises:
        ModelError: the data are missing or the split is unknown.
    """

    kind: ClassVar[Kind] = "classes"
    called_by: ClassVar[str] = ""
    title: ClassVar[str] = ""
    licence: ClassVar[str] = ""
    source: ClassVar[str] = ""
    metric: ClassVar[str] = "accuracy, %"
    higher: ClassVar[bool] = True
    needs_data: ClassVar[bool] = True
    splits: ClassVar[tuple[str, ...]] = ("random",)

    def __init__(self, data: Path | None = None, split: str | None = None, seed: int = 0) -> None:
        self.data, self.split, self.seed = data, split or self.splits[0], seed
        if self.split not in self.splits:
            raise ModelError(f"--split {self.split}: expected one of {', '.join(self.splits)}")
        if self.needs_data and data is None:
            raise ModelError(f"task '{self.called_by}' has no data: expected --data PATH", hint=self.source)
        if data is not None and not data.exists():
            raise ModelError(f"{data}: no such file or folder: expected data of '{self.called_by}'", hint=self.source)

    @classmethod
    def called(cls) -> str:
        """The name on the command line."""
        return cls.called_by

    def folds(self) -> Sequence[Fold]:
        """Return all folds of the split."""
        raise NotImplementedError

    def score(self, predicted: Any, expected: Any) -> float:
        """Return the score of predictions: by default the accuracy in %.

        Args:
            predicted: result of `Model.predict`.
            expected: the part of a fold that was predicted.
        """
        return 100.0 * float(np.mean(np.asarray(predicted) == expected.labels))


class Folds(Sequence[Fold]):
    """Folds of examples. Each fold is created on access, because all folds together may not fit in memory.

    The training part has all versions of a recording, the validation and the test part only version 0.

    Args:
        examples: the recordings.
        parts: for each fold its name, and three boolean masks of shape (recordings,): training, validation, test.
    """

    def __init__(self, examples: Examples, parts: Sequence[tuple[str, Any, Any, Any]]) -> None:
        self._examples, self._parts = examples, parts

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, k: Any) -> Any:
        """Return fold k, or the folds of a slice."""
        if isinstance(k, slice):
            return Folds(self._examples, self._parts[k])
        name, *masks = self._parts[k]
        train, validation, test = (np.flatnonzero(mask) for mask in masks)
        both = np.flatnonzero(masks[0] | masks[1])
        take = self._examples.take
        return Fold(name, take(train), take(validation, 1), take(both), take(test, 1))


def random_folds(examples: Examples, count: int, seed: int) -> Folds:
    """Draw folds, stratified by class, so that each recording is in one test part.

    A tenth of the recordings outside the test part is the validation part of a fold.

    Args:
        examples: the recordings.
        count: number of folds.
        seed: seed of the draws.

    Raises:
        ModelError: there are fewer than two recordings for each fold.
    """
    n = examples.recordings
    if n < 2 * count:
        raise ModelError(f"found {n} examples: expected at least {2 * count} for {count} folds")
    rng = np.random.default_rng((seed, 1))
    fold_of = np.empty(n, dtype=np.int64)  # index of the fold that tests each recording
    first = 0
    for label in range(len(examples.classes)):
        members = np.flatnonzero(examples.labels[:n] == label)
        fold_of[rng.permutation(members)] = (first + np.arange(len(members))) % count
        first += len(members)
    parts = []
    for k in range(count):
        test, validation = fold_of == k, np.zeros(n, dtype=np.bool_)
        not_tested = np.random.default_rng((seed, 2, k)).permutation(np.flatnonzero(~test))
        validation[not_tested[: max(1, len(not_tested) // 10)]] = True
        parts.append((f"random {k + 1}", ~test & ~validation, validation, test))
    return Folds(examples, parts)


def grouped_folds(examples: Examples, groups: Sequence[str]) -> Folds:
    """Return a fold for each group, such as a speaker, with this group as the test part.

    The validation part is the next group in alphabetical order.

    Args:
        examples: the recordings.
        groups: name of the group of each recording.

    Raises:
        ModelError: there are fewer than three groups.
    """
    names = sorted(set(groups))
    if len(names) < 3:
        raise ModelError(f"found {len(names)} groups: expected at least 3, for training, validation and test")
    group_of = np.asarray(groups)
    parts = []
    for k, name in enumerate(names):
        test, validation = group_of == name, group_of == names[(k + 1) % len(names)]
        parts.append((f"without {name}", ~test & ~validation, validation, test))
    return Folds(examples, parts)


class Model(Protocol):
    """A trained model.

    The argument `data` is `Examples` for classes, a `Recording` for regression, and for series the number of values.
    """

    def predict(self, data: Any) -> Any:
        """Return the class of each example, the next values of the series, or the values of each step."""

    def costs(self, data: Any) -> Costs:
        """Return the mean costs of an example of the data."""


class Method:
    """Base class of methods.

    Class attributes:
        kind: kind of the tasks for which the method can be used.
        called_by: name on the command line.
        title: one-line description.
        spiking: whether the method is a spiking network.
        settings: all settings with their default values, which are the first try.
        space: for some settings, the values from which further tries are drawn.
    """

    kind: ClassVar[Kind] = "classes"
    called_by: ClassVar[str] = ""
    title: ClassVar[str] = ""
    spiking: ClassVar[bool] = False
    settings: ClassVar[Mapping[str, Any]] = {}
    space: ClassVar[Mapping[str, Sequence[Any]]] = {}

    @classmethod
    def called(cls) -> str:
        """The name on the command line."""
        return cls.called_by

    def fit(self, train: Any, settings: Mapping[str, Any], seed: int) -> Model:
        """Train a model.

        Args:
            train: `Examples`, a `Series` or a `Recording`.
            settings: a value for each name in the class attribute `settings`.
            seed: seed of all random numbers.
        """
        raise NotImplementedError


NEEDED = {"torch": ("PyTorch", "torch"), "sklearn": ("scikit-learn", "bench")}
"""Title of each optional module, and the extra of neuro that installs it."""


def check_installed(method: Method, module: str) -> None:
    """Check that an optional module is installed.

    Args:
        method: the method that needs the module.
        module: a key of `NEEDED`.

    Raises:
        ModelError: the module is not installed.
    """
    if find_spec(module) is None:
        title, extra = NEEDED[module]
        raise ModelError(f"method '{method.called_by}' needs {title}, which is not installed", hint=install(extra))


def tries(method: Method, changes: Mapping[str, Any], count: int, seed: int) -> list[dict[str, Any]]:
    """Return different settings for each try: first the defaults, then random draws from the method's space.

    A small space may give fewer than `count` settings.

    Args:
        method: the method.
        changes: settings that are changed in all tries.
        count: number of tries.
        seed: seed of the draws.
    """
    rng = np.random.default_rng((seed, 7))
    candidates = [{**method.settings, **changes}]
    for _ in range(100 * count):
        if len(candidates) == count:
            break
        draw = {name: values[int(rng.integers(len(values)))] for name, values in method.space.items()}
        if (candidate := {**method.settings, **draw, **changes}) not in candidates:
            candidates.append(candidate)
    return candidates
