"""Trials of a search: how they are asked for, and what has come of them so far.

Several may ask one journal. A trial is claimed by the process that asked for it; that of a dead process is taken over,
and its runs that are kept are not done again.

A sampler begins anew for each trial, with a seed from that of the search and the number of the trial. So what is asked
next depends on the search alone, not on how often it was interrupted. A grid is shuffled once. A trial is drawn in
memory and comes into the journal with all its parameters, in one line: a kill leaves it whole or not at all.
Whether a run ends early is decided in the process that does it.
"""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro import ModelError
from neuro.apps import file_path, marked
from neuro_sweeps.folder import PRUNED, TUNING, Claims, Folder, RunOutcome
from neuro_sweeps.function import IsWorse
from neuro_sweeps.journal import DraftStorage, locked, optuna, quietly, study_of, trials_of
from neuro_sweeps.plan import SearchPlan, front, mean_metrics, worth
from neuro_sweeps.space import Axis, Point, RunItem
from neuro_sweeps.table import RunRows, SweepTable, as_text, names_of

if TYPE_CHECKING:
    from optuna.pruners import BasePruner
    from optuna.samplers import BaseSampler
    from optuna.study import Study
    from optuna.trial import FrozenTrial


@dataclass
class OpenTrial:
    """A trial under way.

    Attributes:
        items: its runs.
        asked: hashes of those that were handed out.
    """

    items: tuple[RunItem, ...]
    asked: set[str] = field(default_factory=set)


class Asker:
    """Asks for trials of one search, and reports their outcome to Optuna.

    Args:
        plan: how the search goes.
        before: what decides what comes of a run, beside its point and seed.
        folder: of the search.
        share: how many trials this one asks for at most; as many as there are left if None.

    Raises:
        ModelError: Optuna is not installed, or the journal is damaged.
    """

    def __init__(self, plan: SearchPlan, before: str, folder: Folder, share: int | None = None) -> None:
        self._plan, self._before, self._folder = plan, before, folder
        self._left = plan.most if share is None else share
        self._claims = Claims(folder.claims)
        self._claims.beat()
        self._going: dict[int, OpenTrial] = {}
        self._queue: deque[RunItem] = deque()
        self._states = optuna().trial.TrialState
        with self._alone():
            self._study = study_of(folder, tuple(plan.objectives.values()))

    def close(self) -> None:
        """Leave trials under way to the next asker."""
        self._claims.close()

    def more(self, number: int) -> Sequence[RunItem]:
        """Up to so many runs that are next; trials are asked for where there are none left of those before."""
        while len(self._queue) < number and (asked := self._next()) is not None:
            trial, point = asked
            self._going[trial] = OpenTrial(self._plan.items(self._before, point, trial))
            self._advance(trial)
        return [self._queue.popleft() for _ in range(min(number, len(self._queue)))]

    def tell(self, key: str) -> None:
        """A run is there: trials that wait for it go on."""
        for number in [number for number, going in self._going.items() if key in going.asked]:
            self._advance(number)

    def finished(self) -> bool:
        """Whether all trials there can be are over, those of others too."""
        trials = self._study.get_trials(deepcopy=False)
        return len(trials) >= self._plan.most and all(trial.state.is_finished() for trial in trials)

    def others(self) -> list[str]:
        """The claims of trials that others have under way."""
        trials = self._study.get_trials(deepcopy=False)
        numbers = (trial.number for trial in trials if not trial.state.is_finished())
        return [_claim(number) for number in numbers if number not in self._going]

    def counts(self) -> dict[str, int]:
        """How many trials are done, failed, pruned, and left."""
        return counted(self._study.get_trials(deepcopy=False), self._plan.most)

    def _alone(self) -> Any:
        return locked(self._folder.claims / ".ask")

    def _next(self) -> tuple[int, Point] | None:
        """The number and the point of a trial that a dead process has left, or of a new one."""
        with self._alone():
            trials = self._study.get_trials(deepcopy=False)
            for trial in trials:
                waits = not trial.state.is_finished() and trial.number not in self._going
                if waits and self._claims.take(_claim(trial.number)):
                    return trial.number, point_of(self._plan, trial.params)
            number = len(trials)
            if self._left <= 0 or number >= self._plan.most:
                return None
            self._left -= 1
            self._claims.take(_claim(number))
            return number, draw(self._study, self._plan, number)

    def _advance(self, number: int) -> None:
        """Hand out the next runs of a trial, or end it."""
        going = self._going[number]
        there = self._folder.outcomes(item.key for item in going.items)
        each = [there[item.key] for item in going.items if item.key in there]
        worse = self._worse(number, there)
        if any(one.failed for one in each):
            self._end(number, self._states.FAIL)
        elif worse or any(one.outcome == PRUNED for one in each):
            self._end(number, self._states.PRUNED)
        elif len(there) == len({item.key for item in going.items}):
            metrics = mean_metrics([one.metrics for one in each])
            try:
                values = worth(metrics, self._plan.objectives)
            except ModelError:
                self._end(number, self._states.FAIL)
                if not all(name in metrics for name in self._plan.objectives):
                    raise
            else:
                self._end(number, self._states.COMPLETE, values)
        else:
            left = [item for item in going.items if item.key not in there and item.key not in going.asked]
            one_by_one = self._plan.prune and self._plan.runs > 1
            if not one_by_one or not going.asked - set(there):
                # Those that another trial waits for are not done twice.
                for item in left[:1] if one_by_one else left:
                    if not any(item.key in other.asked for other in self._going.values()):
                        self._queue.append(item)
                    going.asked.add(item.key)

    def _worse(self, number: int, there: Mapping[str, RunOutcome]) -> bool:
        """Whether others were better after so many runs of a trial; of a single run its steps are kept here, too."""
        if not self._plan.prune:
            return False
        way, items = TrialProgress(self._study, self._plan.prune, number), self._going[number].items
        if self._plan.runs == 1:
            for one in there.values():
                for step, value in one.steps.items():
                    way.worse(int(step), value)
            return False
        name, values = next(iter(self._plan.objectives)), list[float]()
        for k, item in enumerate(items):
            if item.key not in there:
                return False
            try:
                values += worth(there[item.key].metrics, {name: ""})
            except ModelError:
                return False
            if way.worse(k, sum(values) / len(values)) and k + 1 < len(items):
                return True
        return False

    def _end(self, number: int, state: Any, values: Sequence[float] | None = None) -> None:
        going = self._going.pop(number)
        mine = {item.key for item in going.items} - {key for other in self._going.values() for key in other.asked}
        self._queue = deque(item for item in self._queue if item.key not in mine)
        with quietly():
            self._study.tell(number, values, state=state, skip_if_finished=True)
        self._claims.give_up(_claim(number))


def counted(trials: Sequence[Any], most: int) -> dict[str, int]:
    """How many of Optuna's trials are done, failed and pruned, and how many of all that there can be are left."""
    names = [trial.state.name for trial in trials]
    found = {
        word: names.count(state) for word, state in (("done", "COMPLETE"), ("failed", "FAIL"), ("pruned", "PRUNED"))
    }
    return {**found, "left": max(0, most - sum(found.values()))}


def _claim(number: int) -> str:
    return f"trial-{number}"


POPULATION = 16
"""Of NSGA-II: so many trials are drawn at random before the first is bred."""

_PRUNERS = {
    "startup_trials": "n_startup_trials",
    "warmup_steps": "n_warmup_steps",
    "min_steps": "min_resource",
    "max_steps": "max_resource",
    "factor": "reduction_factor",
}
"""What Optuna calls the words of pruners."""


def sampler_of(plan: SearchPlan, number: int) -> BaseSampler:
    """The sampler that is asked for one trial.

    Sources: Bergstra et al., NeurIPS 2011 (TPE); Ozaki et al., JAIR 73:1209, 2022 (TPE of several objectives);
    Deb et al., IEEE TEC 6:182, 2002 (NSGA-II).
    """
    samplers = optuna().samplers
    seed = int(np.random.SeedSequence([plan.draw, number]).generate_state(1)[0])
    made: BaseSampler
    with quietly():
        if plan.sampler == "tpe":
            made = samplers.TPESampler(seed=seed, constant_liar=True)
        elif plan.sampler == "nsga2":
            made = _nsga2(seed)
        elif plan.sampler == "grid":
            made = samplers.GridSampler({axis.name: _choices(axis) for axis in plan.axes}, seed=plan.draw)
        else:
            made = samplers.RandomSampler(seed=seed)
    return made


def _nsga2(seed: int) -> BaseSampler:
    """NSGA-II whose parents have one order, that of their numbers.

    Optuna's first trial of a generation, which chooses its parents, has these by rank, and all others by number. So a
    search that was killed after the choice would go on otherwise.
    """
    from optuna.samplers import NSGAIISampler

    class InOrder(NSGAIISampler):
        def select_parent(self, study: Study, generation: int) -> list[FrozenTrial]:
            return sorted(super().select_parent(study, generation), key=lambda trial: trial.number)

    return InOrder(seed=seed, population_size=POPULATION)


def draw(study: Study, plan: SearchPlan, number: int) -> Point:
    """Let the trial of a number have all parameters.

    Args:
        study: gets the trial.
        plan: how the search goes.
        number: of the trial.
    """
    with quietly():
        trial = optuna().trial.create_trial(state=optuna().trial.TrialState.RUNNING)
        trial.number = trial._trial_id = number
        asked = DraftStorage(study._storage, trial).study(sampler=sampler_of(plan, number)).ask()
        for axis in plan.axes:
            if axis.values or (plan.sampler == "grid"):
                asked.suggest_categorical(axis.name, _choices(axis))
            elif axis.whole:
                asked.suggest_int(axis.name, int(axis.low), int(axis.high), log=axis.log)
            else:
                asked.suggest_float(axis.name, axis.low, axis.high, log=axis.log)
        study.add_trial(trial)
    return point_of(plan, trial.params)


def _read(axis: Axis, value: Any) -> Any:
    """A value of a parameter from what Optuna has of it: lists lie there as texts."""
    return next((one for one in axis.listed if _choice(one) == value), value) if axis.values else value


def point_of(plan: SearchPlan, params: Mapping[str, Any]) -> Point:
    """The values of those parameters that a trial of the journal has."""
    return {axis.name: _read(axis, params[axis.name]) for axis in plan.axes if axis.name in params}


def _choices(axis: Axis) -> list[Any]:
    return [_choice(value) for value in axis.listed]


def _choice(value: Any) -> Any:
    return value if value is None or isinstance(value, (bool, int, float, str)) else json.dumps(value)


def pruner_of(prune: Mapping[str, Any]) -> BasePruner:
    """Optuna's pruner of a plan, which is asked once: what it has seen before is in the journal.

    Sources: Golovin et al., KDD 2017, section 3.3 (median); Li et al., JMLR 18:185, 2018 (hyperband).
    """
    pruners = optuna().pruners
    words = {_PRUNERS[word]: value for word, value in prune.items() if word in _PRUNERS}
    made: BasePruner = {"median": pruners.MedianPruner, "hyperband": pruners.HyperbandPruner}[prune["by"]](**words)
    return made


class Pruner:
    """Decides for the runs of one process whether they end early.

    Args:
        folder: of the search.
    """

    def __init__(self, folder: Folder) -> None:
        plan = SearchPlan.from_dict(folder.read()["plan"])
        self._prune = plan.prune
        self._study = study_of(folder, tuple(plan.objectives.values()))

    def of(self, trial: int) -> IsWorse | None:
        """What gets the steps of a trial; None where nothing is pruned."""
        return TrialProgress(self._study, self._prune, trial).worse if self._prune else None


class TrialProgress:
    """The steps that a trial reports, from its first on, and whether others were better.

    Whether others were better depends on the steps reported here and on the other trials alone. So a trial that was
    killed on its way, of which the journal has later steps, is judged as it was at first.

    Args:
        study: which keeps the steps; one that is there already, as of a run that is tried once more, stays.
        prune: how the trial is judged.
        number: of the trial.
    """

    def __init__(self, study: Study, prune: Mapping[str, Any], number: int) -> None:
        self._storage, self._prune = study._storage, prune
        self._trial = copy(study.get_trials(deepcopy=False)[number])
        self._trial.intermediate_values, self._trial.system_attrs = {}, {}
        self._study = DraftStorage(self._storage, self._trial).study()

    def worse(self, step: int, value: float) -> bool:
        """Keep a step, and say whether others were better at it."""
        self._trial.intermediate_values[step] = value
        identifier = self._trial._trial_id
        there = self._storage.get_trial(identifier)
        with quietly():
            if step not in there.intermediate_values:
                self._storage.set_trial_intermediate_value(identifier, step, value)
            ends = pruner_of(self._prune).prune(self._study, self._trial)
            for name in self._trial.system_attrs.keys() - there.system_attrs.keys():
                self._storage.set_trial_system_attr(identifier, name, self._trial.system_attrs[name])
        return bool(ends)


UNDER_WAY = "under way"
_OUTCOMES = {"COMPLETE": "done", "FAIL": "failed", "PRUNED": PRUNED}


@dataclass(frozen=True, slots=True)
class FoundTrial:
    """One trial.

    Attributes:
        number: from 0 on.
        outcome: "done", "failed", "pruned" or "under way".
        point: the values of the parameters.
        items: its runs.
        metrics: means over them.
        values: of the objectives, where it is done.
        error: why it failed.
        has_no_value: whether it failed though all runs were done: an objective is missing or not finite.
    """

    number: int
    outcome: str
    point: Point
    items: tuple[RunItem, ...]
    metrics: Mapping[str, Any]
    values: tuple[float, ...] | None
    error: str
    has_no_value: bool


@dataclass(frozen=True, slots=True, eq=False)
class TuneTable(RunRows):
    """A row for each trial of a search; it is read from the folder each time, so it fills while others work.

    Columns are trial, outcome, the parameters, the metrics as means over the runs of the trial, `test.METRIC` where
    points were tested on what is held out, best (whether no other trial beats it) and error.

    Attributes:
        path: the folder.
        name: of the search.
        plan: how it goes.
        before: what decides what comes of a run, beside its point and seed.
    """

    kind = marked("a table of a tuning", "trial,outcome,")
    many = "trials"

    path: Path
    name: str
    plan: SearchPlan
    before: str

    def trials(self) -> list[FoundTrial]:
        """All trials.

        Raises:
            ModelError: the journal is damaged, or Optuna is not installed.
        """
        folder, found = Folder(self.path, TUNING), []
        trials = trials_of(folder)
        items = [self.plan.items(self.before, point_of(self.plan, trial.params)) for trial in trials]
        there = folder.outcomes({item.key: None for each in items for item in each})
        for trial, each in zip(trials, items, strict=True):
            outcomes = [there[item.key] for item in each if item.key in there]
            state = _OUTCOMES.get(trial.state.name, UNDER_WAY)
            metrics = mean_metrics([one.metrics for one in outcomes]) if len(outcomes) == len(each) else {}
            error = next((one.error for one in outcomes if one.failed), "")
            has_no_value = state == "failed" and not error
            if has_no_value:
                try:
                    worth(metrics, self.plan.objectives)
                except ModelError as mistake:
                    error = str(mistake)
            values = tuple(trial.values) if state == "done" else None
            found.append(
                FoundTrial(
                    trial.number, state, point_of(self.plan, trial.params), each, metrics, values, error, has_no_value
                )
            )
        return found

    def best(self) -> list[FoundTrial]:
        """The trials that no other beats, by the first objective: the best one, or the front of several objectives.

        Of several with the same values the first.
        """
        first = {trial.values: trial for trial in reversed(self._unbeaten(self.trials()))}
        return sorted(first.values(), key=lambda trial: trial.values or ())

    def counts(self) -> dict[str, int]:
        """How many trials are done, failed, pruned, and left of those that there can be."""
        return counted(trials_of(Folder(self.path, TUNING)), self.plan.most)

    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """A mapping for each trial.

        Args:
            times: whether also the seconds that its runs took together.
        """
        return list(self._rows(times))

    def _rows(self, times: bool) -> Iterator[dict[str, Any]]:
        trials = self.trials()
        folder = Folder(self.path, TUNING)
        best = {trial.values for trial in self._unbeaten(trials)}
        tested = {trial.number: self._tested(folder, trial.point) for trial in trials if trial.values in best}
        names = names_of((self.plan.objectives, *(trial.metrics for trial in trials)))
        tests = names_of(tested.values())
        for trial in trials:
            row = {"trial": trial.number, "outcome": trial.outcome}
            row |= {name: trial.point.get(name) for name in self.plan.names}
            row |= {name: trial.metrics.get(name) for name in names}
            row |= {name: tested.get(trial.number, {}).get(name) for name in tests}
            if times:
                there = folder.outcomes(item.key for item in trial.items)
                row["seconds"] = sum(one.seconds for one in there.values())
            yield {**row, "best": trial.values in best if trial.values else False, "error": trial.error}

    def _unbeaten(self, trials: list[FoundTrial]) -> list[FoundTrial]:
        done = [trial for trial in trials if trial.values is not None]
        values = np.array([trial.values for trial in done], float).reshape(-1, len(self.plan.objectives))
        kept = front(values, tuple(self.plan.objectives.values()))
        return [trial for trial, stays in zip(done, kept, strict=True) if stays]

    def _tested(self, folder: Folder, point: Point) -> dict[str, Any]:
        if not self.plan.folds:
            return {}
        items = self.plan.tests(self.before, point)
        there = folder.outcomes(item.key for item in items)
        if len(there) < len(items) or any(one.failed for one in there.values()):
            return {}
        return {f"test.{name}": value for name, value in mean_metrics([o.metrics for o in there.values()]).items()}

    def runs(self) -> SweepTable:
        """A row for each run of the trials, as of a sweep."""
        items = {item.key: item for trial in self.trials() for item in trial.items}
        points = tuple((item.point, item.seed) for item in items.values())
        names = (*self.plan.names, *(("fold",) if self.plan.folds else ()))
        return SweepTable(self.path, self.name, names, bool(self.plan.seeds), tuple(items), points)

    def strays(self) -> int:
        """How many runs are kept that no trial of the journal asks for: a journal that was cut has lost theirs."""
        folder = Folder(self.path, TUNING)
        known = {item.key for trial in self.trials() for item in trial.items}
        known |= {item.key for trial in self.best() for item in self.plan.tests(self.before, trial.point)}
        names = os.listdir(folder.runs) if folder.runs.is_dir() else []
        return sum(not name.startswith(".") and name not in known and not _is_test(folder, name) for name in names)

    def __len__(self) -> int:
        return len(trials_of(Folder(self.path, TUNING)))

    def __repr__(self) -> str:
        return f"TuneTable({self.name!r}, {len(self):,} trials: {as_text(self.counts())})"


def tune_table_of(path: str | PathLike[str]) -> TuneTable:
    """The table of the search in a folder.

    Raises:
        ModelError: there is none.
    """
    folder = file_path(path, "path")
    content = Folder(folder, TUNING).read()
    try:
        return TuneTable(folder, content["name"], SearchPlan.from_dict(content["plan"]), content["before"])
    except (KeyError, TypeError, ValueError, AttributeError):
        raise ModelError(f"{folder / TUNING.file}: damaged: expected what 'neuro tune run' wrote") from None


def _is_test(folder: Folder, key: str) -> bool:
    outcome = folder.outcome(key)
    return outcome is None or ("folds" in outcome.point and outcome.point.get("fold") is None)
