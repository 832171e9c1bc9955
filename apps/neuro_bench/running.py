"""Runs of a method on the folds of a task. Settings are chosen on the validation part and tested once."""

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
    base: type[Any], kind: str, parts: tuple[type[Any], ...], group: str, method: str, attributes: tuple[str, ...]
) -> Registry[Any]:
    """Return a registry of subclasses, which refuses a class without the method or without one of the attributes.

    Args:
        base: base class of the parts.
        kind: name of a part, for messages.
        parts: the classes of this package.
        group: entry points of other packages.
        method: name of the method that each class must define.
        attributes: names of the class attributes that each class must define.
    """

    def complete(part: Any) -> Any:
        for attribute in attributes:
            if not getattr(part, attribute):
                raise TypeError(f"{base.__name__.lower()} '{part.__name__}' has no {attribute}: expected a text")
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
"""The tasks by name. Other packages register tasks by the entry points `neuro.bench_tasks`."""

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
"""The methods by name. Other packages register methods by the entry points `neuro.bench_methods`."""


FORMAT = "neuro bench 1"
KEPT = JobResults("the folds of an unfinished 'neuro bench run'", "neuro bench folds 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A benchmark run. Equal requests on equal data with the same version give the same result.

    Attributes:
        task: name of a task in `TASKS`.
        method: name of a method in `METHODS`.
        data: path of the data; None if the task computes its data.
        split: name of a split of the task; None for the first split.
        tries: number of settings tried in each fold, with the first seed.
        seeds: seeds of the method, each for all folds.
        folds: number of folds, from the first; None for all.
        changes: settings of the method that are changed in all tries.
        split_seed: seed of random folds.
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
        """Create the task and the method.

        Raises:
            ModelError: the task or the method is unknown, the method is for another kind of task, or a setting is
                unknown or has another type.
        """
        for role, name, registry in (("task", self.task, TASKS), ("method", self.method, METHODS)):
            if name not in registry:
                raise unknown(role, name, registry)
        kind, method = TASKS[self.task], METHODS[self.method]()
        if kind.kind != method.kind:
            alternatives = ", ".join(name for name in METHODS if METHODS[name].kind == kind.kind)
            message = f"method '{self.method}' is for {method.kind}, task '{self.task}' is of {kind.kind}"
            raise ModelError(f"{message}: expected one of {alternatives}")
        for name, value in (self.changes or {}).items():
            if name not in method.settings:
                raise unknown("setting", name, method.settings)
            default = method.settings[name]
            if isinstance(default, (bool, int, float, str)):
                quantity = setting(default, infinite=True).metadata["quantity"]
                check(quantity, value, f"method '{self.method}': {name}")
        return kind(self.data, self.split, self.split_seed), method


def run(
    request: Request,
    report: Callable[[str, int, int], None] = lambda label, n_done, n_total: None,
    file: Path | None = None,
) -> dict[str, Any]:
    """Run a method on all folds of a task.

    Args:
        request: the task, the method and their options.
        report: called before each fold with its label, the number of finished folds and the number of all folds.
        file: file of the finished folds, from which the same request resumes; None for no file.

    Returns:
        data for JSON: the request, the settings, tries, score and costs of each fold, the mean score with its 95 %
        confidence interval, and the provenance.

    Raises:
        ModelError: see `Request.made` and the folds of the task.
    """
    task, method = request.made()
    folds = task.folds()[: request.folds]
    options: dict[str, Any] = {
        "data": None if request.data is None else str(request.data),
        "tries": request.tries,
        "seeds": list(request.seeds),
        "folds": request.folds,
        "changes": dict(request.changes or {}),
        "split_seed": request.split_seed,
    }
    source = provenance()
    identity = {"task": request.task, "split": task.split, "method": request.method, **options}
    identity |= {field: source[field] for field in ("neuro", "commit", "inputs")}
    results: list[dict[str, Any]] = [] if file is None else KEPT.read(file, identity).get("folds", [])
    trainings = [(seed, k) for seed in request.seeds for k in range(len(folds))]
    for seed, k in trainings[len(results) :]:
        fold = folds[k]
        report(f"{fold.name}, seed {seed}", len(results), len(trainings))
        if len(results) >= len(folds):  # a further seed: use the settings that the first seed chose for this fold
            settings = results[k]["settings"]
        else:  # the first seed: folds with the same validation series share their settings
            peers = (j for j in range(len(results)) if task.kind == "series" and folds[j].validation is fold.validation)
            settings = next((results[j]["settings"] for j in peers), None)
        candidates = tries(method, options["changes"], request.tries, seed) if settings is None else [settings]
        results.append(_run_fold(task, method, fold, candidates, seed))
        if file is not None:
            KEPT.write(file, identity, {"folds": results})
    scores = [result["score"] for result in results]
    mean, low, high = interval(scores)
    data = None if request.data is None else Path(request.data).absolute()
    return {
        "format": FORMAT,
        "task": {
            "name": request.task,
            "split": task.split,
            "metric": task.metric,
            "higher": task.higher,
            **{field: getattr(task, field) for field in ("title", "licence", "source")},
        },
        "method": {"name": request.method, "title": method.title, "spiking": method.spiking},
        "asked": options,
        "data": sorted(source["inputs"][name] for name in source["inputs"] if data and Path(name).is_relative_to(data)),
        "mean": mean,
        "interval": [low, high],
        "folds": results,
        "costs": _mean_costs([result["costs"] for result in results]),
        "cpu_s": sum(result["cpu_s"] for result in results),
        "provenance": source,
    }


def _run_fold(
    task: Task, method: Method, fold: Fold, candidates: Sequence[dict[str, Any]], seed: int
) -> dict[str, Any]:
    """Choose the best settings by the score on the validation part, train with them, and test."""
    start_s = time.process_time()
    try_results: list[dict[str, Any]] = []

    def question(part: Any) -> Any:
        """Return the argument of `predict` for a part: the number of values of a series, else the part itself."""
        return len(part) if task.kind == "series" else part

    parts = [(fold.train, fold.validation)]
    if task.kind == "series":
        parts = list(zip(fold.train, fold.validation, strict=True))
    if len(candidates) > 1:
        for settings in candidates:
            scores = []
            for train, validation in parts:
                predicted = method.fit(train, settings, seed).predict(question(validation))
                scores.append(task.score(predicted, validation))
            try_results.append({"settings": settings, "validation": float(np.mean(scores))})
        sign = 1.0 if task.higher else -1.0
        best_try: dict[str, Any] = max(try_results, key=lambda result: sign * float(result["validation"]))["settings"]
    else:
        best_try = candidates[0]
    model = method.fit(fold.both, best_try, seed)
    test_start_s = time.process_time()
    predicted = model.predict(question(fold.test))
    test_s = time.process_time() - test_start_s
    return {
        "fold": fold.name,
        "seed": seed,
        "score": task.score(predicted, fold.test),
        "n": len(fold.test),
        "settings": best_try,
        "tries": try_results,
        "costs": model.costs(question(fold.test)).as_words(),
        "ms_an_example": 1000.0 * test_s / len(fold.test),
        "cpu_s": time.process_time() - start_s,
    }


def interval(scores: Sequence[float]) -> tuple[float, float, float]:
    """Return the mean score, and low and high end of its 95 % confidence interval by Student's t; NaN for one score."""
    from scipy.stats import t

    mean, n = float(np.mean(scores)), len(scores)
    if n < 2:
        return mean, float("nan"), float("nan")
    half_width = float(t.ppf(0.975, n - 1) * np.std(scores, ddof=1) / n**0.5)
    return mean, mean - half_width, mean + half_width


def _mean_costs(costs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Average the costs of the folds. A chip that refuses a fold has no mean, and a cost unknown in a fold is None."""
    means: dict[str, Any] = {}
    for name in costs[0]:
        values = [cost[name] for cost in costs]
        if name == "refused":
            means[name] = {key: reason for cost in values for key, reason in cost.items()}
        elif isinstance(values[0], Mapping):
            shared = (key for key in values[0] if all(key in cost for cost in values))
            means[name] = {key: float(np.mean([cost[key] for cost in values])) for key in shared}
        else:
            means[name] = None if None in values else float(np.mean(values))
    return means
