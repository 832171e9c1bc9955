"""The plan of a search: space, objectives, sampler, pruner and the runs of a trial; the Pareto front of trials."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import in_ms, is_number, nearest, shown, unknown, words_of
from neuro_sweeps.space import Axis, Point, RunItem, axes, check_numbers, key_of, seeds_of

SAMPLERS = ("tpe", "nsga2", "random", "grid")
PRUNERS = {
    "median": ("startup_trials", "warmup_steps"),
    "hyperband": ("min_steps", "max_steps", "factor"),
}
MOST_TRIALS = 100_000
_PRUNE = ("by", "at", *(word for words in PRUNERS.values() for word in words))
_LEAST = {"startup_trials": 0, "warmup_steps": 0, "min_steps": 1, "max_steps": 1, "factor": 2}


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """The plan of a search.

    Attributes:
        axes: the parameters with their values.
        objectives: "maximise" or "minimise" by name of a metric.
        trials: number of trials.
        sampler: one of `SAMPLERS`.
        draw: seed of the sampler.
        seeds: seeds of the runs at each point; empty for runs without a seed.
        folds: number of parts of the data in cross-validation, with a run for each part; 0 without cross-validation.
        prune: pruner ("by"), its settings (see `PRUNERS`), and for networks the times of comparison ("at"); None
            without pruning.
    """

    axes: tuple[Axis, ...]
    objectives: Mapping[str, str]
    trials: int
    sampler: str = "tpe"
    draw: int = 0
    seeds: tuple[int, ...] = ()
    folds: int = 0
    prune: Mapping[str, Any] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters, in order."""
        return tuple(axis.name for axis in self.axes)

    @property
    def runs(self) -> int:
        """The number of runs of a trial."""
        return max(1, len(self.seeds)) * max(1, self.folds)

    @property
    def most(self) -> int:
        """The largest number of trials: `trials`, or the number of points of a smaller grid."""
        points = math.prod(axis.count() for axis in self.axes) if self.sampler == "grid" else self.trials
        return min(self.trials, points)

    def identity(self) -> dict[str, Any]:
        """Return all settings but the number of trials. A search can be continued with another number of trials."""
        return {word: value for word, value in self.as_dict().items() if word != "trials"}

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, for `from_dict`."""
        plain = {word: getattr(self, word) for word in ("trials", "sampler", "draw", "folds", "prune")}
        space = {axis.name: _plain_axis(axis) for axis in self.axes}
        return {"parameters": space, "objectives": dict(self.objectives), **plain, "seeds": list(self.seeds)}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> SearchPlan:
        """Return the plan for the data of `as_dict`."""
        axes = content["parameters"].items()
        space = tuple(Axis(name, **{**fields, "values": tuple(fields["values"])}) for name, fields in axes)
        settings = {word: content[word] for word in ("objectives", "trials", "sampler", "draw", "folds", "prune")}
        return cls(space, seeds=tuple(content["seeds"]), **settings)

    def items(self, key_prefix: str, point: Point, trial: int | None = None) -> tuple[RunItem, ...]:
        """Return the runs of a trial: all seeds for each fold.

        Args:
            key_prefix: all inputs of a run but point and seed, see `key_of`.
            point: values of the parameters.
            trial: number of the trial, if a single run may be pruned.
        """
        return self._items(key_prefix, point, range(self.folds), trial if self.runs == 1 else None)

    def tests(self, key_prefix: str, point: Point) -> tuple[RunItem, ...]:
        """Return the runs of a point on the data that is held out from all folds; their `fold` is None."""
        return self._items(key_prefix, point, (None,), None)

    def _items(
        self, key_prefix: str, point: Point, folds: Sequence[int | None], trial: int | None
    ) -> tuple[RunItem, ...]:
        points = [{**point, "fold": fold, "folds": self.folds} for fold in folds] if self.folds else [point]
        pairs = [(p, seed) for p in points for seed in self.seeds or (None,)]
        return tuple(RunItem(key_of(key_prefix, p, seed), p, seed, trial) for p, seed in pairs)


def plan_of(
    parameters: Any,
    objectives: Any,
    trials: Any,
    sampler: str | None = None,
    draw: Any = 0,
    seeds: int | Sequence[int] | None = None,
    folds: Any = None,
    prune: Any = None,
) -> SearchPlan:
    """Return a checked plan; the arguments are those of `neuro.tune`.

    Raises:
        ModelError: the space is empty, or an argument has another form.
    """
    directions = objectives_of(objectives)
    chosen = sampler or ("tpe" if len(directions) == 1 else "nsga2")
    if chosen not in SAMPLERS:
        raise unknown("sampler", chosen, SAMPLERS, path=("sampler",))
    space = axes(parameters)
    if not space:
        raise ModelError("the space is empty: expected parameters with values")
    check_numbers(space, chosen, f"sampler {chosen}")
    for axis in space:
        if axis.name in ("fold", "folds", "seed"):
            raise ModelError(f"{axis.name}: set by 'folds' and 'seeds': expected another parameter")
        if axis.whole and chosen != "grid" and (axis.low % 1 or axis.high % 1):
            raise ModelError(
                f"{axis.name}: from {axis.low:g} to {axis.high:g}: expected whole numbers with 'whole: true'"
            )
    return SearchPlan(
        space,
        directions,
        _whole("trials", trials, 1, MOST_TRIALS),
        chosen,
        _whole("draw", draw, 0, 2**32 - 1),
        seeds_of(seeds),
        0 if folds is None else _whole("folds", folds, 2, 1000),
        _prune(prune, directions),
    )


def _prune(prune: Any, objectives: Mapping[str, str]) -> dict[str, Any] | None:
    if prune is None or prune is False:
        return None
    settings_given = {"by": prune} if isinstance(prune, str) else prune
    if not isinstance(settings_given, Mapping):
        message = f"prune = {shown(prune)}: expected {' or '.join(PRUNERS)}, or settings such as {{by: median}}"
        raise ModelError(message, path=("prune",))
    for word in settings_given:
        if word not in _PRUNE:
            raise unknown("word of prune", word, _PRUNE, path=("prune",))
    pruner = settings_given.get("by", "median")
    if pruner not in PRUNERS:
        raise unknown("pruner", pruner, PRUNERS, path=("prune",))
    if len(objectives) > 1:
        message = f"prune = {pruner}: running trials cannot be compared by {len(objectives)} objectives"
        raise ModelError(f"{message}: expected one objective, or no prune", path=("prune",))
    settings: dict[str, Any] = {"by": pruner}
    for word, value in settings_given.items():
        if word == "at":
            settings["at"] = _times(value)
        elif word != "by" and word not in PRUNERS[pruner]:
            message = f"prune.{word}: not used with {pruner}: expected {', '.join(PRUNERS[pruner])}"
            raise ModelError(message, path=("prune",))
        elif word != "by":
            settings[word] = _whole(f"prune.{word}", value, _LEAST[word], 10**9)
    return settings


def _times(value: Any) -> list[float]:
    times = [float(in_ms(t, "prune.at")) for t in (value if isinstance(value, (list, tuple)) else [value])]
    if not times or times[0] <= 0 or any(b <= a for a, b in pairwise(times)):
        message = f"prune.at = {shown(value)}: expected times > 0 in ascending order"
        raise ModelError(message, path=("prune",))
    return times


def _whole(name: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        message = f"{name} = {shown(value)}: expected a whole number from {least:,} to {most:,}"
        raise ModelError(message, path=words_of(name))
    return value


def _plain_axis(axis: Axis) -> dict[str, Any]:
    fields: dict[str, Any] = json.loads(json.dumps(asdict(axis)))
    del fields["name"]
    return fields


MAXIMISE, MINIMISE = "maximise", "minimise"
_WORDS = {
    **dict.fromkeys((MAXIMISE, "maximize", "max"), MAXIMISE),
    **dict.fromkeys((MINIMISE, "minimize", "min"), MINIMISE),
}

Floats = NDArray[np.float64]


def objectives_of(objectives: Any) -> dict[str, str]:
    """Return the objectives by name, each "maximise" or "minimise".

    Args:
        objectives: a mapping such as `{"accuracy": "maximise", "energy.loihi": "minimise"}`. "maximize" and "max",
            "minimize" and "min" are accepted, too.

    Raises:
        ModelError: the argument has another form.
    """
    if not isinstance(objectives, Mapping) or not objectives:
        message = f"objectives = {shown(objectives)}: expected metrics, each maximise or minimise"
        raise ModelError(message, hint="write objectives: {accuracy: maximise}", path=("objectives",))
    directions = {}
    for name, direction in objectives.items():
        if not isinstance(direction, str) or direction not in _WORDS:
            message = f"objectives.{name} = {shown(direction)}: expected {MAXIMISE} or {MINIMISE}"
            hint = nearest(direction, _WORDS) if isinstance(direction, str) else ""
            raise ModelError(message, hint=hint, path=("objectives",))
        directions[str(name)] = _WORDS[direction]
    return directions


def mean_metrics(metrics_of_runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the means over runs of the metrics that are numbers in all runs; for a single run all its metrics."""
    if len(metrics_of_runs) == 1:
        return dict(metrics_of_runs[0])
    first = metrics_of_runs[0] if metrics_of_runs else {}
    names = [name for name in first if all(is_number(metrics.get(name)) for metrics in metrics_of_runs)]
    return {name: float(np.mean([metrics[name] for metrics in metrics_of_runs])) for name in names}


def worth(metrics: Mapping[str, Any], objectives: Mapping[str, str]) -> list[float]:
    """Return the values of the objectives in their order.

    Args:
        metrics: metrics of a trial.
        objectives: objectives by name.

    Raises:
        ModelError: an objective is not among the metrics, or is not a finite number.
    """
    values = []
    for name in objectives:
        if name not in metrics:
            raise unknown("objective", name, metrics)
        value = metrics[name]
        if not is_number(value) or not math.isfinite(value):
            raise ModelError(f"objective '{name}' = {shown(value)}: expected a finite number")
        values.append(float(value))
    return values


def front(values: Floats, directions: Sequence[str]) -> NDArray[np.bool_]:
    """Return a mask of the points on the Pareto front.

    A point beats another point by being at least as good in all objectives, and better in one. The front has the points
    that no other point beats. With one objective the front is the best point.

    Args:
        values: values of the objectives, shape (points, objectives).
        directions: "maximise" or "minimise" for each objective.

    Returns:
        A mask of shape (points,). Equal points are all on the front, or none of them.
    """
    signs = np.array([-1.0 if direction == MAXIMISE else 1.0 for direction in directions])
    costs = np.asarray(values, float).reshape(-1, len(signs)) * signs
    is_unbeaten = np.ones(len(costs), bool)
    for k, cost in enumerate(costs):
        beats = (costs <= cost).all(axis=1) & (costs < cost).any(axis=1)
        is_unbeaten[k] = not beats.any()
    return is_unbeaten


def so_far(values: Sequence[float] | Floats, direction: str) -> Floats:
    """Return the best value up to each value, e.g. [1, 1, 3] for [1, 0, 3] and "maximise"."""
    accumulate = np.maximum if direction == MAXIMISE else np.minimum
    return np.asarray(accumulate.accumulate(np.asarray(values, float)))
