"""A method on the folds of a task: the same tries for every method, chosen by validation, tested once."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import JobResults, Registry, check, provenance, setting, unknown
from neuro_bench.artificial import CNN, GRU, QuantisedCNN
from neuro_bench.event_cameras import NMNIST, SHD, DVSGesture, PokerDVS
from neuro_bench.features import HATS, GradientBoosting, LogisticRegression
from neuro_bench.mackey_glass import MackeyGlass
from neuro_bench.primate_reaching import PrimateReaching
from neuro_bench.regression import LIFReadout, Perceptron, Wiener
from neuro_bench.series import EchoState, PopulationCode, SeriesMean, TanhRidge
from neuro_bench.sounds import Sounds, SpeechCommands, SpokenDigits
from neuro_bench.spiking import Converted, Delays, Dense, Recurrent, ReMuS
from neuro_bench.task import Fold, Method, Task, tries


def _registry(
    base: type[Any], kind: str, parts: tuple[type[Any], ...], group: str, method: str, words: tuple[str, ...]
) -> Registry[Any]:
    """Return a registry of subclasses; it refuses a class that lacks a word or a method."""

    def complete(part: Any) -> Any:
        for word in words:
            if not getattr(part, word):
                raise TypeError(f"{base.__name__.lower()} '{part.__name__}' has no {word}: expected a text")
        if getattr(part, method) is getattr(base, method):
            raise TypeError(f"{base.__name__.lower()} '{part.__name__}' has no method {method}")
        return part

    def takes(part: Any) -> bool:
        return isinstance(part, type) and issubclass(part, base)

    return Registry(kind, parts, takes=takes, group=group, complete=complete)


TASKS: Registry[type[Task]] = _registry(
    Task,
    "bench task",
    (SpokenDigits, Sounds, SpeechCommands, SHD, NMNIST, PokerDVS, DVSGesture, MackeyGlass, PrimateReaching),
    "neuro.bench_tasks",
    "folds",
    ("called_by", "title", "licence", "source"),
)
"""The tasks by name; a package registers its own by the entry points `neuro.bench_tasks`."""

METHODS: Registry[type[Method]] = _registry(
    Method,
    "bench method",
    (
        *(Converted, Recurrent, Delays, Dense, CNN, QuantisedCNN, GRU, LogisticRegression, GradientBoosting, HATS),
        *(ReMuS, PopulationCode, TanhRidge, EchoState, SeriesMean, LIFReadout, Wiener, Perceptron),
    ),
    "neuro.bench_methods",
    "fit",
    ("called_by", "title"),
)
"""The methods by name; a package registers its own by the entry points `neuro.bench_methods`."""


FORMAT = "neuro bench 1"
KEPT = JobResults("the folds of an unfinished 'neuro bench run'", "neuro bench folds 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What is asked for: all that a result follows from, beside the data and the version.

    Attributes:
        task: a name of `TASKS`.
        method: a name of `METHODS`.
        data: path of the data, None where the task makes them.
        split: of the task, its first if None.
        tries: settings that are tried in each fold, with the first seed.
        seeds: of the method, each on all folds.
        folds: the first so many only; all if None.
        changes: settings that are otherwise than the method's, in all tries.
        split_seed: of folds that are drawn.
    """

    task: str
    method: str
    data: Path | None = None
    split: str | None = None
    tries: int = 1
    seeds: tuple[int, ...] = (0,)
    folds: int | None = None
    changes: Mapping[str, Any] | None = None
    split_seed: int = 0

    def made(self) -> tuple[Task, Method]:
        """The task and the method.

        Raises:
            ModelError: there is none of that name, they do not suit each other, or a setting is unknown or
                of another kind.
        """
        for what, name, known in (("task", self.task, TASKS), ("method", self.method, METHODS)):
            if name not in known:
                raise unknown(what, name, known)
        kind, method = TASKS[self.task], METHODS[self.method]()
        if kind.kind != method.kind:
            suits = ", ".join(name for name in METHODS if METHODS[name].kind == kind.kind)
            message = f"method '{self.method}' is for {method.kind}, task '{self.task}' is of {kind.kind}"
            raise ModelError(f"{message}: expected one of {suits}")
        for name, value in (self.changes or {}).items():
            if name not in method.settings:
                raise unknown("setting", name, method.settings)
            default = method.settings[name]
            if isinstance(default, (bool, int, float, str)):
                like = setting(default, infinite=True).metadata["quantity"]
                check(like, value, f"method '{self.method}': {name}")
        return kind(self.data, self.split, self.split_seed), method


def run(
    request: Request,
    report: Callable[[str, int, int], None] = lambda what, done, total: None,
    kept: Path | None = None,
) -> dict[str, Any]:
    """Run a method on all folds of a task.

    Args:
        request: what is asked for.
        report: called with what is done, how much of it, and of how much.
        kept: a file of the folds that are done, from which the same request goes on; None: none.

    Returns:
        Ready for JSON: the request, each fold's settings, tries, score and costs, mean and 95 % interval, provenance.

    Raises:
        ModelError: as of `Request.made` and of the task.
    """
    task, method = request.made()
    folds = task.folds()[: request.folds]
    asked: dict[str, Any] = {
        "data": None if request.data is None else str(request.data),
        "tries": request.tries,
        "seeds": list(request.seeds),
        "folds": request.folds,
        "changes": dict(request.changes or {}),
        "split_seed": request.split_seed,
    }
    made = provenance()
    of = {"task": request.task, "split": task.split, "method": request.method, **asked}
    of |= {word: made[word] for word in ("neuro", "commit", "inputs")}
    found: list[dict[str, Any]] = [] if kept is None else KEPT.read(kept, of).get("folds", [])
    each = [(seed, k) for seed in request.seeds for k in range(len(folds))]
    for seed, k in each[len(found) :]:
        fold = folds[k]
        report(f"{fold.name}, seed {seed}", len(found), len(each))
        if len(found) >= len(folds):  # another seed: the settings that were chosen for this fold
            known = found[k]["settings"]
        else:  # or those of a fold with the same series to choose by
            same = (j for j in range(len(found)) if task.kind == "series" and folds[j].validation is fold.validation)
            known = next((found[j]["settings"] for j in same), None)
        tried = tries(method, asked["changes"], request.tries, seed) if known is None else [known]
        found.append(_fold(task, method, fold, tried, seed))
        if kept is not None:
            KEPT.write(kept, of, {"folds": found})
    scores = [each["score"] for each in found]
    mean, low, high = interval(scores)
    data = None if request.data is None else Path(request.data).absolute()
    return {
        "format": FORMAT,
        "task": {
            "name": request.task,
            "split": task.split,
            "metric": task.metric,
            "higher": task.higher,
            **{word: getattr(task, word) for word in ("title", "licence", "source")},
        },
        "method": {"name": request.method, "title": method.title, "spiking": method.spiking},
        "asked": asked,
        "data": sorted(made["inputs"][name] for name in made["inputs"] if data and Path(name).is_relative_to(data)),
        "mean": mean,
        "interval": [low, high],
        "folds": found,
        "costs": _mean_costs([each["costs"] for each in found]),
        "cpu_s": sum(each["cpu_s"] for each in found),
        "provenance": made,
    }


def _fold(task: Task, method: Method, fold: Fold, tried: Sequence[dict[str, Any]], seed: int) -> dict[str, Any]:
    began = time.process_time()
    told: list[dict[str, Any]] = []

    def size(part: Any) -> Any:
        return len(part) if task.kind == "series" else part

    parts = [(fold.train, fold.validation)]
    if task.kind == "series":
        parts = list(zip(fold.train, fold.validation, strict=True))
    if len(tried) > 1:
        for settings in tried:
            each = [task.score(method.fit(seen, settings, seed).predict(size(next)), next) for seen, next in parts]
            told.append({"settings": settings, "validation": float(np.mean(each))})
        sign = 1.0 if task.higher else -1.0
        best: dict[str, Any] = max(told, key=lambda one: sign * float(one["validation"]))["settings"]
    else:
        best = tried[0]
    model = method.fit(fold.both, best, seed)
    answered = time.process_time()
    predicted = model.predict(size(fold.test))
    spent = time.process_time()
    return {
        "fold": fold.name,
        "seed": seed,
        "score": task.score(predicted, fold.test),
        "n": len(fold.test),
        "settings": best,
        "tries": told,
        "costs": model.costs(size(fold.test)).as_words(),
        "ms_an_example": 1000.0 * (spent - answered) / len(fold.test),
        "cpu_s": time.process_time() - began,
    }


def interval(scores: Sequence[float]) -> tuple[float, float, float]:
    """Mean of scores, and its 95 % interval by Student's t; of one score no interval, so NaN."""
    from scipy.stats import t

    mean, n = float(np.mean(scores)), len(scores)
    if n < 2:
        return mean, float("nan"), float("nan")
    half = float(t.ppf(0.975, n - 1) * np.std(scores, ddof=1) / n**0.5)
    return mean, mean - half, mean + half


def _mean_costs(each: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in each[0]:
        values = [one[name] for one in each]
        if name == "refused":  # by a chip in one fold, so there is no bill of all
            found[name] = {key: why for one in values for key, why in one.items()}
        elif isinstance(values[0], Mapping):
            shared = (key for key in values[0] if all(key in one for one in values))
            found[name] = {key: float(np.mean([one[key] for one in values])) for key in shared}
        else:
            found[name] = None if None in values else float(np.mean(values))
    return found
