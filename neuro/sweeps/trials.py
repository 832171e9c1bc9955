"""What has come of a search so far: a row for each trial, in the order in which they were asked for."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.outputs import marked
from neuro.core.paths import file_path
from neuro.sweeps.asking import counted, point_of
from neuro.sweeps.folder import PRUNED, TUNING, Folder, RunOutcome
from neuro.sweeps.journal import trials_of
from neuro.sweeps.plan import SearchPlan, front, mean_metrics, worth
from neuro.sweeps.space import Point, RunItem
from neuro.sweeps.table import RunRows, SweepTable, as_text, names_of

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
            found.append(self._found(trial, each, outcomes))
        return found

    def _found(self, trial: Any, items: tuple[RunItem, ...], outcomes: list[RunOutcome]) -> FoundTrial:
        state = _OUTCOMES.get(trial.state.name, UNDER_WAY)
        metrics = mean_metrics([one.metrics for one in outcomes]) if len(outcomes) == len(items) else {}
        error = next((one.error for one in outcomes if one.failed), "")
        has_no_value = state == "failed" and not error
        if has_no_value:
            try:
                worth(metrics, self.plan.objectives)
            except ModelError as mistake:
                error = str(mistake)
        values = tuple(trial.values) if state == "done" else None
        return FoundTrial(
            trial.number, state, point_of(self.plan, trial.params), items, metrics, values, error, has_no_value
        )

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
