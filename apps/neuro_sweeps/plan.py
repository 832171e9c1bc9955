"""How a search goes: space, objectives, sampler, pruner, the runs of a trial, and which trials no other one beats."""

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
from neuro_sweeps.space import Axis, Point, RunItem, axes, key_of, seeds_of

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
    """How a search goes.

    Attributes:
        axes: the parameters.
        objectives: "maximise" or "minimise" by the name of a metric.
        trials: how many are asked for.
        sampler: one of `SAMPLERS`.
        draw: its seed.
        seeds: with each of which a point is run; none where runs get no seed.
        folds: in how many parts data is divided, each point being run once for each; 0 for none.
        prune: words of `PRUNERS`, with "by" and of networks "at"; empty where nothing is pruned.
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
        """The parameters, in order."""
        return tuple(axis.name for axis in self.axes)

    @property
    def runs(self) -> int:
        """Of how many runs a trial is made."""
        return max(1, len(self.seeds)) * max(1, self.folds)

    @property
    def most(self) -> int:
        """How many trials there can be: a grid has no more than it has points."""
        points = math.prod(axis.count() for axis in self.axes) if self.sampler == "grid" else self.trials
        return min(self.trials, points)

    def same(self) -> dict[str, Any]:
        """What makes a search the same: all but how many trials, which may be more."""
        return {word: value for word, value in self.as_dict().items() if word != "trials"}

    def as_dict(self) -> dict[str, Any]:
        """As plain data, from which `from_dict` makes it."""
        plain = {word: getattr(self, word) for word in ("trials", "sampler", "draw", "folds", "prune")}
        space = {axis.name: _plain_axis(axis) for axis in self.axes}
        return {"parameters": space, "objectives": dict(self.objectives), **plain, "seeds": list(self.seeds)}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> SearchPlan:
        """What `as_dict` has written."""
        given = content["parameters"].items()
        space = tuple(Axis(name, **{**words, "values": tuple(words["values"])}) for name, words in given)
        rest = {word: content[word] for word in ("objectives", "trials", "sampler", "draw", "folds", "prune")}
        return cls(space, seeds=tuple(content["seeds"]), **rest)

    def items(self, before: str, point: Point, trial: int | None = None) -> tuple[RunItem, ...]:
        """The runs of a trial: for each fold all seeds.

        Args:
            before: what decides what comes of a run, beside its point and seed.
            point: the values of the parameters.
            trial: its number, where a run by itself may be pruned.
        """
        return self._items(before, point, range(self.folds), trial if self.runs == 1 else None)

    def tests(self, before: str, point: Point) -> tuple[RunItem, ...]:
        """The runs of a point on what is held out from all folds: `fold` is none."""
        return self._items(before, point, (None,), None)

    def _items(self, before: str, point: Point, folds: Sequence[int | None], trial: int | None) -> tuple[RunItem, ...]:
        points = [{**point, "fold": fold, "folds": self.folds} for fold in folds] if self.folds else [point]
        pairs = [(each, seed) for each in points for seed in self.seeds or (None,)]
        return tuple(RunItem(key_of(before, each, seed), each, seed, trial) for each, seed in pairs)


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
    """A checked plan; the arguments are those of `neuro.tune`.

    Raises:
        ModelError: the space is empty, or something is not said as it is there.
    """
    aims = objectives_of(objectives)
    chosen = sampler or ("tpe" if len(aims) == 1 else "nsga2")
    if chosen not in SAMPLERS:
        raise unknown("sampler", chosen, SAMPLERS, path=("sampler",))
    space = axes(parameters)
    if not space:
        raise ModelError("the space is empty: expected parameters with values")
    for axis in space:
        if axis.name in ("fold", "folds", "seed"):
            raise ModelError(f"{axis.name}: is given to runs by 'folds' and 'seeds': expected another parameter")
        if chosen == "grid" and not axis.values and not axis.number:
            raise ModelError(f"{axis.name}: a range of a grid needs 'number', how many values")
        if chosen != "grid" and axis.number:
            raise ModelError(f"{axis.name}.number = {axis.number}: has no meaning with sampler {chosen}")
        if axis.whole and chosen != "grid" and (axis.low % 1 or axis.high % 1):
            raise ModelError(
                f"{axis.name}: from {axis.low:g} to {axis.high:g}: expected whole numbers with 'whole: true'"
            )
    return SearchPlan(
        space,
        aims,
        _whole("trials", trials, 1, MOST_TRIALS),
        chosen,
        _whole("draw", draw, 0, 2**32 - 1),
        seeds_of(seeds),
        0 if folds is None else _whole("folds", folds, 2, 1000),
        _prune(prune, aims),
    )


def _prune(said: Any, objectives: Mapping[str, str]) -> dict[str, Any] | None:
    if said is None or said is False:
        return None
    words = {"by": said} if isinstance(said, str) else said
    if not isinstance(words, Mapping):
        message = f"prune = {shown(said)}: expected {' or '.join(PRUNERS)}, or words such as {{by: median}}"
        raise ModelError(message, path=("prune",))
    for word in words:
        if word not in _PRUNE:
            raise unknown("word of prune", word, _PRUNE, path=("prune",))
    by = words.get("by", "median")
    if by not in PRUNERS:
        raise unknown("pruner", by, PRUNERS, path=("prune",))
    if len(objectives) > 1:
        message = f"prune = {by}: trials of {len(objectives)} objectives cannot be compared on the way"
        raise ModelError(f"{message}: expected one objective, or no prune", path=("prune",))
    found: dict[str, Any] = {"by": by}
    for word, value in words.items():
        if word == "at":
            found["at"] = _times(value)
        elif word != "by" and word not in PRUNERS[by]:
            message = f"prune.{word}: has no meaning with {by}, which has {', '.join(PRUNERS[by])}"
            raise ModelError(message, path=("prune",))
        elif word != "by":
            found[word] = _whole(f"prune.{word}", value, _LEAST[word], 10**9)
    return found


def _times(said: Any) -> list[float]:
    many = said if isinstance(said, (list, tuple)) else [said]
    times = [float(in_ms(each, "prune.at")) for each in many]
    if not times or times[0] <= 0 or any(b <= a for a, b in pairwise(times)):
        message = f"prune.at = {shown(said)}: expected times > 0, each later than the one before"
        raise ModelError(message, path=("prune",))
    return times


def _whole(name: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        message = f"{name} = {shown(value)}: expected a whole number from {least:,} to {most:,}"
        raise ModelError(message, path=words_of(name))
    return value


def _plain_axis(axis: Axis) -> dict[str, Any]:
    words: dict[str, Any] = json.loads(json.dumps(asdict(axis)))
    del words["name"]
    return words


MAXIMISE, MINIMISE = "maximise", "minimise"
_WORDS = {
    **dict.fromkeys((MAXIMISE, "maximize", "max"), MAXIMISE),
    **dict.fromkeys((MINIMISE, "minimize", "min"), MINIMISE),
}

Floats = NDArray[np.float64]


def objectives_of(said: Any) -> dict[str, str]:
    """Objectives by name, each "maximise" or "minimise".

    Args:
        said: a mapping like `{"accuracy": "maximise", "energy.loihi": "minimise"}`; "maximize", "max" and others of
            Optuna and Ray mean the same.

    Raises:
        ModelError: it is none.
    """
    if not isinstance(said, Mapping) or not said:
        message = f"objectives = {shown(said)}: expected metrics, each maximise or minimise"
        raise ModelError(message, hint="write objectives: {accuracy: maximise}", path=("objectives",))
    found = {}
    for name, direction in said.items():
        if not isinstance(direction, str) or direction not in _WORDS:
            message = f"objectives.{name} = {shown(direction)}: expected {MAXIMISE} or {MINIMISE}"
            hint = nearest(direction, _WORDS) if isinstance(direction, str) else ""
            raise ModelError(message, hint=hint, path=("objectives",))
        found[str(name)] = _WORDS[direction]
    return found


def mean_metrics(each: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over runs of those metrics that are numbers in all; of a single run all that it has."""
    if len(each) == 1:
        return dict(each[0])
    names = [name for name in each[0] if all(is_number(one.get(name)) for one in each)] if each else []
    return {name: float(np.mean([one[name] for one in each])) for name in names}


def worth(metrics: Mapping[str, Any], objectives: Mapping[str, str]) -> list[float]:
    """The values of the objectives, in their order.

    Args:
        metrics: of a trial.
        objectives: by name.

    Raises:
        ModelError: one is not among the metrics, or no finite number.
    """
    found = []
    for name in objectives:
        if name not in metrics:
            raise unknown("objective", name, metrics)
        value = metrics[name]
        if not is_number(value) or not math.isfinite(value):
            raise ModelError(f"objective '{name}' = {shown(value)}: expected a finite number")
        found.append(float(value))
    return found


def front(values: Floats, directions: Sequence[str]) -> NDArray[np.bool_]:
    """Which points no other one beats: at least as good in all objectives, and better in one.

    Args:
        values: (points, objectives).
        directions: of each objective, "maximise" or "minimise".

    Returns:
        (points,); of equal points all or none. Of one objective: the best.
    """
    signs = np.array([-1.0 if each == MAXIMISE else 1.0 for each in directions])
    costs = np.asarray(values, float).reshape(-1, len(signs)) * signs
    kept = np.ones(len(costs), bool)
    for k, cost in enumerate(costs):
        beaten = (costs <= cost).all(axis=1) & (costs < cost).any(axis=1)
        kept[k] = not beaten.any()
    return kept


def so_far(values: Sequence[float] | Floats, direction: str) -> Floats:
    """The best value up to each."""
    best = np.maximum if direction == MAXIMISE else np.minimum
    return np.asarray(best.accumulate(np.asarray(values, float)))
