"""What Optuna decides: the next point, and whether a run is so much worse than others on its way that it ends.

A sampler begins anew for each trial, with a seed from that of the search and the number of the trial. So what is asked
next depends on the search alone, not on how often it was interrupted. A grid is shuffled once. A trial is drawn in
memory and comes into the journal with all its parameters, in one line: a kill leaves it whole or not at all.

Pruning is decided in the process that does the run.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.sweeps.folder import Folder
from neuro.sweeps.metrics import Worse
from neuro.sweeps.space import Axis, Point
from neuro.sweeps.tuning.journal import Aside, optuna, quietly, study_of
from neuro.sweeps.tuning.plan import SearchPlan

if TYPE_CHECKING:
    from optuna.pruners import BasePruner
    from optuna.samplers import BaseSampler
    from optuna.study import Study
    from optuna.trial import FrozenTrial, Trial

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
        asked = Aside(study._storage, trial).study(sampler=sampler_of(plan, number)).ask()
        for axis in plan.axes:
            _suggest(asked, axis, plan.sampler == "grid")
        study.add_trial(trial)
    return point_of(plan, trial.params)


def _suggest(trial: Trial, axis: Axis, is_grid: bool) -> None:
    if axis.values or is_grid:
        trial.suggest_categorical(axis.name, _choices(axis))
    elif axis.whole:
        trial.suggest_int(axis.name, int(axis.low), int(axis.high), log=axis.log)
    else:
        trial.suggest_float(axis.name, axis.low, axis.high, log=axis.log)


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
    """Says of the runs of one process whether they are to end.

    Args:
        folder: of the search.
    """

    def __init__(self, folder: Folder) -> None:
        plan = SearchPlan.from_dict(folder.read()["plan"])
        self._prune = plan.prune
        self._study = study_of(folder, tuple(plan.objectives.values()))

    def of(self, trial: int) -> Worse | None:
        """What is told the steps of a trial; None where nothing is pruned."""
        return Way(self._study, self._prune, trial).worse if self._prune else None


class Way:
    """What a trial tells on its way, from its first step on.

    Whether others were better depends on the steps told here and on the other trials alone. So a trial that was killed
    on its way, of which the journal has later steps, is judged as it was at first.

    Args:
        study: which keeps the steps; one that is there already, as of a run that is tried once more, stays.
        prune: how the trial is judged.
        number: of the trial.
    """

    def __init__(self, study: Study, prune: Mapping[str, Any], number: int) -> None:
        self._storage, self._prune = study._storage, prune
        self._trial = copy(study.get_trials(deepcopy=False)[number])
        self._trial.intermediate_values, self._trial.system_attrs = {}, {}
        self._study = Aside(self._storage, self._trial).study()

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
