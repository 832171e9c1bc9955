"""What a task is: folds of data in one form for all methods; and what a method is: settings, a space, and `fit`."""

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
"""Values of a series at even times, shape (values,)."""
Ints = npt.NDArray[np.int64]
Kind = Literal["classes", "series", "regression"]
"""Of a task, and of the methods that suit it."""


@dataclass(frozen=True, slots=True, eq=False)
class Spikes:
    """Spikes of examples, each neuron at most once in a step.

    Attributes:
        shape: of the input: (sheets, rows, columns).
        steps: of each example.
        step: length of one, ms.
        example: of each spike, ascending.
        at: the step of each, from 0.
        neuron: that emits it, in C order of the shape.
    """

    shape: tuple[int, int, int]
    steps: int
    step: float
    example: Ints
    at: Ints
    neuron: Ints

    @classmethod
    def of_dense(cls, spikes: Any, step: float) -> Spikes:
        """Those of an array that is not 0 where there is a spike, shape (examples, steps, sheets, rows, columns)."""
        dense = np.asarray(spikes)
        if dense.ndim != 5:
            message = f"spikes: found the shape {dense.shape}"
            raise ModelError(f"{message}: expected (examples, steps, sheets, rows, columns)")
        example, at, neuron = dense.reshape(*dense.shape[:2], -1).nonzero()
        _, steps, sheets, rows, columns = dense.shape
        return cls((sheets, rows, columns), steps, step, example, at, neuron)

    def take(self, chosen: Ints, examples: int) -> Spikes:
        """Those of some of the examples, in the order given."""
        ends = np.searchsorted(self.example, np.arange(examples + 1))
        lengths = ends[chosen + 1] - ends[chosen]
        places = [np.arange(ends[k], ends[k + 1]) for k in chosen]
        index = np.concatenate([np.zeros(0, np.int64), *places])
        example = np.repeat(np.arange(len(chosen)), lengths)
        return replace(self, example=example, at=self.at[index], neuron=self.neuron[index])


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Labelled examples in two forms, of the same data.

    Attributes:
        frames: what artificial networks see, shape (examples, channels, rows, columns); time runs along the columns
            where a row is a band of a sound.
        labels: the class of each, from 0, shape (examples,).
        classes: names.
        spikes: what spiking networks see.
        versions: of each recording, for who learns: of n recordings, example v n + k is version v of the one k, and
            version 0 is the recording as it is.
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
        """How many there are, each in all versions."""
        return len(self) // self.versions

    def take(self, chosen: Ints, versions: int | None = None) -> Examples:
        """Some of the recordings, in the order given, in so many of their versions; in all if not given."""
        count = self.versions if versions is None else versions
        index = (np.arange(count)[:, None] * self.recordings + np.asarray(chosen, np.int64)).reshape(-1)
        spikes = self.spikes.take(index, len(self))
        return Examples(self.frames[index], self.labels[index], self.classes, spikes, count)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Spikes, and values that they say step by step.

    Attributes:
        spikes: which channel spikes in which step, bool, (steps, channels).
        targets: the values wanted after each step, (steps, values).
        step: length of one, ms.
    """

    spikes: npt.NDArray[np.bool_]
    targets: Floats
    step: float

    def __post_init__(self) -> None:
        if self.spikes.ndim != 2 or self.targets.ndim != 2 or len(self.spikes) != len(self.targets):
            message = f"spikes of the shape {self.spikes.shape} and targets of the shape {self.targets.shape}"
            raise ModelError(f"{message}: expected (steps, channels) and (steps, values), as many steps")

    def __len__(self) -> int:
        return len(self.spikes)

    def take(self, steps: Any) -> Recording:
        """Some of the steps, as an index of arrays."""
        return Recording(self.spikes[steps], self.targets[steps], self.step)


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """Data to learn from, to choose settings by, and to be judged by: `Examples`, `Series` or `Recording`.

    Attributes:
        name: in the results.
        train: to learn from while settings are chosen; of a task of series a list of these.
        validation: to choose them by; of a task of series for each of `train` how it goes on. Folds that share this
            list share the settings.
        both: to learn from when they are chosen: `train` and `validation`; of series the one that `test` continues.
        test: is asked once.
    """

    name: str
    train: Any
    validation: Any
    both: Any
    test: Any


class Task:
    """Base of the tasks.

    Class attributes:
        kind: "classes", "series", or "regression": values of each step by the spikes until then.
        called_by: the name on the command line.
        title: in one line.
        licence: of the data.
        source: where the data come from, and who published the task.
        metric: what is reported.
        higher: whether more of it is better.
        needs_data: whether the user gives the path of the data.

    Args:
        data: path of the data; nothing is ever downloaded.
        split: one of `splits`, the first if not given.
        seed: of folds that are drawn.

    Raises:
        ModelError: there are no such data, or no such split.
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
            raise ModelError(f"{data}: is not there: expected the data of '{self.called_by}'", hint=self.source)

    @classmethod
    def called(cls) -> str:
        """The name on the command line."""
        return cls.called_by

    def folds(self) -> Sequence[Fold]:
        """All folds of the split."""
        raise NotImplementedError

    def score(self, predicted: Any, wanted: Any) -> float:
        """The metric of what was predicted for a test part: the share of right classes in %."""
        return 100.0 * float(np.mean(np.asarray(predicted) == wanted.labels))


class Folds(Sequence[Fold]):
    """Folds of examples, each made when it is asked for: all at once may need more memory than there is.

    Learning sees all versions of a recording, validation and test see version 0.

    Args:
        examples: the recordings.
        parts: of each fold its name, and which recordings learn, validate and test, each of shape (recordings,).
    """

    def __init__(self, examples: Examples, parts: Sequence[tuple[str, Any, Any, Any]]) -> None:
        self._examples, self._parts = examples, parts

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, k: Any) -> Any:
        """The fold k, or some of the folds."""
        if isinstance(k, slice):
            return Folds(self._examples, self._parts[k])
        name, train, held, tested = self._parts[k]
        take = self._examples.take
        learnt, validated, both, asked = (np.flatnonzero(part) for part in (train, held, train | held, tested))
        return Fold(name, take(learnt), take(validated, 1), take(both), take(asked, 1))


def random_folds(examples: Examples, count: int, seed: int) -> Folds:
    """Folds that test on each recording once, drawn within the classes; a tenth of the others is the validation part.

    Raises:
        ModelError: there are fewer recordings than folds.
    """
    n = examples.recordings
    if n < 2 * count:
        raise ModelError(f"found {n} examples: expected at least {2 * count} for {count} folds")
    rng = np.random.default_rng((seed, 1))
    part = np.empty(n, dtype=np.int64)
    first = 0
    for label in range(len(examples.classes)):
        own = np.flatnonzero(examples.labels[:n] == label)
        part[rng.permutation(own)] = (first + np.arange(len(own))) % count
        first += len(own)
    parts = []
    for k in range(count):
        tested, held = part == k, np.zeros(n, dtype=np.bool_)
        rest = np.random.default_rng((seed, 2, k)).permutation(np.flatnonzero(~tested))
        held[rest[: max(1, len(rest) // 10)]] = True
        parts.append((f"random {k + 1}", ~tested & ~held, held, tested))
    return Folds(examples, parts)


def grouped_folds(examples: Examples, groups: Sequence[str]) -> Folds:
    """Folds that test on one group each, such as a speaker; the validation part is the group that follows it.

    Args:
        examples: the recordings.
        groups: that of each recording.

    Raises:
        ModelError: there are fewer than three groups.
    """
    names = sorted(set(groups))
    if len(names) < 3:
        raise ModelError(f"found {len(names)} groups: expected at least 3, to learn, to choose and to test by")
    own = np.asarray(groups)
    parts = []
    for k, name in enumerate(names):
        tested, held = own == name, own == names[(k + 1) % len(names)]
        parts.append((f"without {name}", ~tested & ~held, held, tested))
    return Folds(examples, parts)


class Model(Protocol):
    """What was learnt."""

    def predict(self, shown: Any) -> Any:
        """The class of each of `Examples`, so many next values of a series, or the values of each step."""

    def costs(self, shown: Any) -> Costs:
        """What an example of these takes."""


class Method:
    """Base of the methods.

    Class attributes:
        kind: of the tasks that it suits.
        called_by: the name on the command line.
        title: in one line.
        spiking: whether it is a spiking network.
        settings: what may be chosen, with the values of the first try.
        space: of some settings the values that further tries are drawn from.
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
        """Learn from `Examples`, a `Series` or a `Recording`.

        Args:
            train: what to learn from.
            settings: a value for each of `settings`.
            seed: of all that is random.
        """
        raise NotImplementedError


NEEDED = {"torch": ("PyTorch", "torch"), "sklearn": ("scikit-learn", "bench")}
"""By module what it is called, and the extra that has it."""


def check_installed(method: Method, module: str) -> None:
    """Refuse a method where a module that it learns by is not installed.

    Args:
        method: the method.
        module: a name of `NEEDED`.

    Raises:
        ModelError: it is not.
    """
    if find_spec(module) is None:
        title, extra = NEEDED[module]
        raise ModelError(f"method '{method.called_by}' learns by {title}, which is not installed", hint=install(extra))


def tries(method: Method, changes: Mapping[str, Any], count: int, seed: int) -> list[dict[str, Any]]:
    """The settings of each try: the first as they are, the others drawn from the space, none twice in a small space.

    Args:
        method: whose settings they are.
        changes: settings that are otherwise than the method's, in all tries.
        count: how many tries.
        seed: of the draws.
    """
    rng = np.random.default_rng((seed, 7))
    found = [{**method.settings, **changes}]
    for _ in range(100 * count):
        if len(found) == count:
            break
        drawn = {name: values[int(rng.integers(len(values)))] for name, values in method.space.items()}
        if (one := {**method.settings, **drawn, **changes}) not in found:
            found.append(one)
    return found
