"""Trials of a search: requests to Optuna, and the table of trials.

Several processes may use one journal. A trial is claimed by the process that asked for it. The trial of a dead process
is taken over, and its kept runs are not repeated.

Each trial has a new sampler, seeded by the seed of the search and the number of the trial. So the next point depends
only on the search, not on interruptions. A grid is shuffled once. A trial is drawn in memory, and enters the journal
with all parameters in one line, so a kill leaves the complete trial or none. The worker process of a run decides
whether the run ends early.
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
from neuro_sweeps.folder import PRUNED, TUNING, Claims, Folder, RunOutcome, locked
from neuro_sweeps.function import IsWorse
from neuro_sweeps.journal import DraftStorage, optuna, study_of, trials_of, without_warnings
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
    """A trial that is not finished.

    Attributes:
        items: the runs of the trial.
        requested: hashes of the runs that were queued.
    """

    items: tuple[RunItem, ...]
    requested: set[str] = field(default_factory=set)


class Asker:
    """Source of runs for `execute`: asks Optuna for trials, queues their runs, and reports results to Optuna.

    Args:
        plan: plan of the search.
        key_prefix: all inputs of a run but point and seed, see `key_of`.
        folder: folder of the search.
        share: largest number of trials that this process asks for, without waiting for other processes; None for all
            remaining trials.

    Raises:
        ModelError: Optuna is not installed, or the journal is damaged.
    """

    def __init__(self, plan: SearchPlan, key_prefix: str, folder: Folder, share: int | None = None) -> None:
        self._plan, self._key_prefix, self._folder = plan, key_prefix, folder
        self._has_share, self._remaining = share is not None, plan.most if share is None else share
        self._claims = Claims(folder.claims)
        self._claims.beat()
        self._open: dict[int, OpenTrial] = {}
        self._queue: deque[RunItem] = deque()
        self._states = optuna().trial.TrialState
        with self._locked():
            self._study = study_of(folder, tuple(plan.objectives.values()))

    def close(self) -> None:
        """Release unfinished trials to other processes."""
        self._claims.close()

    def next_runs(self, number: int) -> Sequence[RunItem]:
        """Return up to `number` runs. New trials are requested when the queue is too short."""
        while len(self._queue) < number and (request := self._next_trial()) is not None:
            trial, point = request
            self._open[trial] = OpenTrial(self._plan.items(self._key_prefix, point, trial))
            self._advance(trial)
        return [self._queue.popleft() for _ in range(min(number, len(self._queue)))]

    def on_run(self, key: str, failed: bool) -> None:
        """Advance the trials that wait for a finished run."""
        for number in [number for number, trial in self._open.items() if key in trial.requested]:
            self._advance(number)

    def finished(self) -> bool:
        """Return whether all trials are finished, also those of other processes; True with a share."""
        if self._has_share:
            return True
        trials = self._study.get_trials(deepcopy=False)
        return len(trials) >= self._plan.most and all(trial.state.is_finished() for trial in trials)

    def claims_of_others(self) -> list[str]:
        """Return the claims of unfinished trials of other processes."""
        trials = self._study.get_trials(deepcopy=False)
        numbers = (trial.number for trial in trials if not trial.state.is_finished())
        return [_claim(number) for number in numbers if number not in self._open]

    def counts(self) -> dict[str, int]:
        """Return the numbers of trials that are done, failed, pruned and left."""
        return count_trials(self._study.get_trials(deepcopy=False), self._plan.most)

    def _locked(self) -> Any:
        return locked(self._folder.claims / ".ask")

    def _next_trial(self) -> tuple[int, Point] | None:
        """Return number and point of a trial to take over from a dead process, or of a new trial, or None."""
        with self._locked():
            trials = self._study.get_trials(deepcopy=False)
            for trial in trials:
                is_of_others = not trial.state.is_finished() and trial.number not in self._open
                if is_of_others and self._claims.take(_claim(trial.number)):
                    return trial.number, point_of(self._plan, trial.params)
            number = len(trials)
            if self._remaining <= 0 or number >= self._plan.most:
                return None
            self._remaining -= 1
            self._claims.take(_claim(number))
            return number, draw(self._study, self._plan, number)

    def _advance(self, number: int) -> None:
        """Queue the next runs of a trial, or end the trial."""
        trial = self._open[number]
        outcomes = self._folder.outcomes(item.key for item in trial.items)
        finished = [outcomes[item.key] for item in trial.items if item.key in outcomes]
        is_pruned = self._is_pruned(number, outcomes)
        if any(outcome.failed for outcome in finished):
            self._end(number, self._states.FAIL)
        elif is_pruned or any(outcome.outcome == PRUNED for outcome in finished):
            self._end(number, self._states.PRUNED)
        elif len(outcomes) == len({item.key for item in trial.items}):
            metrics = mean_metrics([outcome.metrics for outcome in finished])
            try:
                values = worth(metrics, self._plan.objectives)
            except ModelError:
                self._end(number, self._states.FAIL)
                if not all(name in metrics for name in self._plan.objectives):
                    raise
            else:
                self._end(number, self._states.COMPLETE, values)
        else:
            pending = [item for item in trial.items if item.key not in outcomes and item.key not in trial.requested]
            one_by_one = self._plan.prune and self._plan.runs > 1
            if not one_by_one or not trial.requested - set(outcomes):
                for item in pending[:1] if one_by_one else pending:
                    # Another trial may have requested the same run.
                    if not any(item.key in open_trial.requested for open_trial in self._open.values()):
                        self._queue.append(item)
                    trial.requested.add(item.key)

    def _is_pruned(self, number: int, outcomes: Mapping[str, RunOutcome]) -> bool:
        """Return whether a trial of several runs ends, since other trials were better after the same number of runs.

        The steps of a trial with a single run are only written to the journal, since its worker decides.
        """
        if not self._plan.prune:
            return False
        progress, items = TrialProgress(self._study, self._plan.prune, number), self._open[number].items
        if self._plan.runs == 1:
            for outcome in outcomes.values():
                for step, value in outcome.steps.items():
                    progress.is_worse(int(step), value)
            return False
        name, values = next(iter(self._plan.objectives)), list[float]()
        for k, item in enumerate(items):
            if item.key not in outcomes:
                return False
            try:
                values += worth(outcomes[item.key].metrics, {name: ""})
            except ModelError:
                return False
            if progress.is_worse(k, sum(values) / len(values)) and k + 1 < len(items):
                return True
        return False

    def _end(self, number: int, state: Any, values: Sequence[float] | None = None) -> None:
        trial = self._open.pop(number)
        foreign_keys = {key for open_trial in self._open.values() for key in open_trial.requested}
        obsolete = {item.key for item in trial.items} - foreign_keys
        self._queue = deque(item for item in self._queue if item.key not in obsolete)
        with without_warnings():
            self._study.tell(number, values, state=state, skip_if_finished=True)
        self._claims.give_up(_claim(number))


def count_trials(trials: Sequence[Any], most: int) -> dict[str, int]:
    """Return the numbers of Optuna's trials that are done, failed and pruned, and the number left of `most`."""
    names = [trial.state.name for trial in trials]
    counts = {
        word: names.count(state) for word, state in (("done", "COMPLETE"), ("failed", "FAIL"), ("pruned", "PRUNED"))
    }
    return {**counts, "left": max(0, most - sum(counts.values()))}


def _claim(number: int) -> str:
    return f"trial-{number}"


POPULATION = 16
"""Size of a generation of NSGA-II; the first generation is random."""

_PRUNERS = {
    "startup_trials": "n_startup_trials",
    "warmup_steps": "n_warmup_steps",
    "min_steps": "min_resource",
    "max_steps": "max_resource",
    "factor": "reduction_factor",
}
"""Optuna's names of the settings of pruners."""


def sampler_of(plan: SearchPlan, number: int) -> BaseSampler:
    """Return the sampler of a trial.

    Sources: Bergstra et al., NeurIPS 2011 (TPE); Ozaki et al., JAIR 73:1209, 2022 (TPE of several objectives);
    Deb et al., IEEE TEC 6:182, 2002 (NSGA-II).
    """
    samplers = optuna().samplers
    seed = int(np.random.SeedSequence([plan.draw, number]).generate_state(1)[0])
    sampler: BaseSampler
    with without_warnings():
        if plan.sampler == "tpe":
            sampler = samplers.TPESampler(seed=seed, constant_liar=True)
        elif plan.sampler == "nsga2":
            sampler = _nsga2(seed)
        elif plan.sampler == "grid":
            sampler = samplers.GridSampler({axis.name: _choices(axis) for axis in plan.axes}, seed=plan.draw)
        else:
            sampler = samplers.RandomSampler(seed=seed)
    return sampler


def _nsga2(seed: int) -> BaseSampler:
    """Return NSGA-II with parents sorted by number.

    In Optuna the first trial of a generation chooses the parents, and has them sorted by rank, while later trials have
    them sorted by number. So a search that is killed after the choice would continue differently.
    """
    from optuna.samplers import NSGAIISampler

    class InOrder(NSGAIISampler):
        def select_parent(self, study: Study, generation: int) -> list[FrozenTrial]:
            return sorted(super().select_parent(study, generation), key=lambda trial: trial.number)

    return InOrder(seed=seed, population_size=POPULATION)


def draw(study: Study, plan: SearchPlan, number: int) -> Point:
    """Draw all parameters of a trial, add the trial to the study, and return its point.

    Args:
        study: the study.
        plan: plan of the search.
        number: number of the trial.
    """
    with without_warnings():
        trial = optuna().trial.create_trial(state=optuna().trial.TrialState.RUNNING)
        trial.number = trial._trial_id = number
        draft = DraftStorage(study._storage, trial).study(sampler=sampler_of(plan, number)).ask()
        for axis in plan.axes:
            if axis.values or (plan.sampler == "grid"):
                draft.suggest_categorical(axis.name, _choices(axis))
            elif axis.whole:
                draft.suggest_int(axis.name, int(axis.low), int(axis.high), log=axis.log)
            else:
                draft.suggest_float(axis.name, axis.low, axis.high, log=axis.log)
        study.add_trial(trial)
    return point_of(plan, trial.params)


def _value_of(axis: Axis, value: Any) -> Any:
    """Return the value of a parameter for Optuna's value, in which a list is a text."""
    return next((item for item in axis.grid_values if _choice(item) == value), value) if axis.values else value


def point_of(plan: SearchPlan, params: Mapping[str, Any]) -> Point:
    """Return the point of a trial in the journal."""
    return {axis.name: _value_of(axis, params[axis.name]) for axis in plan.axes if axis.name in params}


def _choices(axis: Axis) -> list[Any]:
    return [_choice(value) for value in axis.grid_values]


def _choice(value: Any) -> Any:
    return value if value is None or isinstance(value, (bool, int, float, str)) else json.dumps(value)


def pruner_of(prune: Mapping[str, Any]) -> BasePruner:
    """Return Optuna's pruner of a plan for one decision. All earlier data are in the journal.

    Sources: Golovin et al., KDD 2017, section 3.3 (median); Li et al., JMLR 18:185, 2018 (hyperband).
    """
    pruners = optuna().pruners
    settings = {_PRUNERS[word]: value for word, value in prune.items() if word in _PRUNERS}
    pruner: BasePruner = {"median": pruners.MedianPruner, "hyperband": pruners.HyperbandPruner}[prune["by"]](**settings)
    return pruner


class Pruner:
    """The pruner of a worker process.

    Args:
        folder: folder of the search.
    """

    def __init__(self, folder: Folder) -> None:
        plan = SearchPlan.from_dict(folder.read()["plan"])
        self._prune = plan.prune
        self._study = study_of(folder, tuple(plan.objectives.values()))

    def for_trial(self, trial: int) -> IsWorse | None:
        """Return the function that decides at each step whether a trial ends; None without pruning."""
        return TrialProgress(self._study, self._prune, trial).is_worse if self._prune else None


class TrialProgress:
    """The reported steps of a running trial, and the comparison with other trials.

    The comparison uses the steps reported here and all other trials. So a killed trial that is repeated, with later
    steps in the journal already, is judged as in the first attempt.

    Args:
        study: study, to which the steps are added; steps of an earlier attempt are not replaced.
        prune: settings of the pruner.
        number: number of the trial.
    """

    def __init__(self, study: Study, prune: Mapping[str, Any], number: int) -> None:
        self._storage, self._prune = study._storage, prune
        self._trial = copy(study.get_trials(deepcopy=False)[number])
        self._trial.intermediate_values, self._trial.system_attrs = {}, {}
        self._study = DraftStorage(self._storage, self._trial).study()

    def is_worse(self, step: int, value: float) -> bool:
        """Add a step to the journal, and return whether other trials were so much better that this one ends."""
        self._trial.intermediate_values[step] = value
        identifier = self._trial._trial_id
        stored = self._storage.get_trial(identifier)
        with without_warnings():
            if step not in stored.intermediate_values:
                self._storage.set_trial_intermediate_value(identifier, step, value)
            ends = pruner_of(self._prune).prune(self._study, self._trial)
            for name in self._trial.system_attrs.keys() - stored.system_attrs.keys():
                self._storage.set_trial_system_attr(identifier, name, self._trial.system_attrs[name])
        return bool(ends)


UNDER_WAY = "under way"
_OUTCOMES = {"COMPLETE": "done", "FAIL": "failed", "PRUNED": PRUNED}


@dataclass(frozen=True, slots=True)
class TrialRow:
    """A trial with its results.

    Attributes:
        number: number of the trial, from 0.
        outcome: "done", "failed", "pruned" or "under way".
        point: values of the parameters.
        items: the runs of the trial.
        metrics: means over the runs.
        values: values of the objectives; None for a trial that is not done.
        error: error message of a failed trial.
        has_no_value: the trial failed although its runs are done, since an objective is missing or not finite.
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
    """The table of a search, with a row per trial. Each access reads the folder, so the table grows during a search.

    The columns are trial, outcome, the parameters, the metrics (means over the runs of the trial), `test.METRIC` for
    points that were tested on held-out data, best (True if no other trial beats the trial) and error.

    Attributes:
        path: folder of the search.
        name: name of the search.
        plan: plan of the search.
        key_prefix: all inputs of a run but point and seed, see `key_of`.
    """

    kind = marked("a table of a tuning", "trial,outcome,")
    many = "trials"

    path: Path
    name: str
    plan: SearchPlan
    key_prefix: str

    def trials(self) -> list[TrialRow]:
        """Return all trials.

        Raises:
            ModelError: the journal is damaged, or Optuna is not installed.
        """
        folder, rows = Folder(self.path, TUNING), []
        trials = trials_of(folder)
        items = [self.plan.items(self.key_prefix, point_of(self.plan, trial.params)) for trial in trials]
        outcomes_by_key = folder.outcomes({item.key: None for trial_items in items for item in trial_items})
        for trial, trial_items in zip(trials, items, strict=True):
            outcomes = [outcomes_by_key[item.key] for item in trial_items if item.key in outcomes_by_key]
            state = _OUTCOMES.get(trial.state.name, UNDER_WAY)
            metrics = mean_metrics([run.metrics for run in outcomes]) if len(outcomes) == len(trial_items) else {}
            error = next((run.error for run in outcomes if run.failed), "")
            has_no_value = state == "failed" and not error
            if has_no_value:
                try:
                    worth(metrics, self.plan.objectives)
                except ModelError as mistake:
                    error = str(mistake)
            values = tuple(trial.values) if state == "done" else None
            point = point_of(self.plan, trial.params)
            rows.append(TrialRow(trial.number, state, point, trial_items, metrics, values, error, has_no_value))
        return rows

    def best(self) -> list[TrialRow]:
        """Return the best trial, or the Pareto front of several objectives, sorted by the first objective.

        Of trials with the same values only the first is returned.
        """
        first = {trial.values: trial for trial in reversed(self._unbeaten(self.trials()))}
        return sorted(first.values(), key=lambda trial: trial.values or ())

    def counts(self) -> dict[str, int]:
        """Return the numbers of trials that are done, failed, pruned and left."""
        return count_trials(trials_of(Folder(self.path, TUNING)), self.plan.most)

    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """Return a mapping for each trial.

        Args:
            times: add the total seconds of the trial's runs.
        """
        return list(self._rows(times))

    def _rows(self, times: bool) -> Iterator[dict[str, Any]]:
        trials = self.trials()
        folder = Folder(self.path, TUNING)
        front = {trial.values for trial in self._unbeaten(trials)}
        test_metrics = {trial.number: self._tested(folder, trial.point) for trial in trials if trial.values in front}
        names = names_of((self.plan.objectives, *(trial.metrics for trial in trials)))
        test_names = names_of(test_metrics.values())
        for trial in trials:
            row = {"trial": trial.number, "outcome": trial.outcome}
            row |= {name: trial.point.get(name) for name in self.plan.names}
            row |= {name: trial.metrics.get(name) for name in names}
            row |= {name: test_metrics.get(trial.number, {}).get(name) for name in test_names}
            if times:
                outcomes = folder.outcomes(item.key for item in trial.items)
                row["seconds"] = sum(run.seconds for run in outcomes.values())
            yield {**row, "best": trial.values in front if trial.values else False, "error": trial.error}

    def _unbeaten(self, trials: list[TrialRow]) -> list[TrialRow]:
        finished = [trial for trial in trials if trial.values is not None]
        values = np.array([trial.values for trial in finished], float).reshape(-1, len(self.plan.objectives))
        is_unbeaten = front(values, tuple(self.plan.objectives.values()))
        return [trial for trial, unbeaten in zip(finished, is_unbeaten, strict=True) if unbeaten]

    def _tested(self, folder: Folder, point: Point) -> dict[str, Any]:
        if not self.plan.folds:
            return {}
        items = self.plan.tests(self.key_prefix, point)
        outcomes = folder.outcomes(item.key for item in items)
        if len(outcomes) < len(items) or any(run.failed for run in outcomes.values()):
            return {}
        metrics = mean_metrics([run.metrics for run in outcomes.values()])
        return {f"test.{name}": value for name, value in metrics.items()}

    def runs(self) -> SweepTable:
        """Return the table of all runs of the trials, as for a sweep."""
        items = {item.key: item for trial in self.trials() for item in trial.items}
        names = (*self.plan.names, *(("fold",) if self.plan.folds else ()))
        return SweepTable(self.path, self.name, names, tuple(items.values()))

    def strays(self) -> int:
        """Return the number of kept runs without a trial in the journal, e.g. after the journal was cut."""
        folder = Folder(self.path, TUNING)
        keys = {item.key for trial in self.trials() for item in trial.items}
        keys |= {item.key for trial in self.best() for item in self.plan.tests(self.key_prefix, trial.point)}
        names = os.listdir(folder.runs) if folder.runs.is_dir() else []
        return sum(not name.startswith(".") and name not in keys and not _is_test(folder, name) for name in names)

    def __len__(self) -> int:
        return len(trials_of(Folder(self.path, TUNING)))

    def __repr__(self) -> str:
        return f"TuneTable({self.name!r}, {len(self):,} trials: {as_text(self.counts())})"


def tune_table_of(path: str | PathLike[str]) -> TuneTable:
    """Return the table of the search in a folder.

    Raises:
        ModelError: the folder has no search.
    """
    folder = file_path(path, "path")
    content = Folder(folder, TUNING).read()
    try:
        return TuneTable(folder, content["name"], SearchPlan.from_dict(content["plan"]), content["before"])
    except (KeyError, TypeError, ValueError, AttributeError):
        raise ModelError(f"{folder / TUNING.file}: damaged: expected the file that 'neuro tune run' wrote") from None


def _is_test(folder: Folder, key: str) -> bool:
    outcome = folder.outcome(key)
    return outcome is None or ("folds" in outcome.point and outcome.point.get("fold") is None)
