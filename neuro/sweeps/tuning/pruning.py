"""Whether a run is so much worse than others on its way that it ends: asked in the process that does the run."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import TYPE_CHECKING, Any

from neuro.sweeps.folder import Folder
from neuro.sweeps.steps import Worse
from neuro.sweeps.tuning.journal import Aside, optuna, quietly, study_of
from neuro.sweeps.tuning.plan import SearchPlan

if TYPE_CHECKING:
    from optuna.pruners import BasePruner
    from optuna.study import Study


def pruner_of(prune: Mapping[str, Any]) -> BasePruner:
    """Optuna's pruner of a plan, which is asked once: what it has seen before is in the journal.

    Sources: Golovin et al., KDD 2017, section 3.3 (median); Li et al., JMLR 18:185, 2018 (hyperband).
    """
    pruners = optuna().pruners
    words = dict(prune)
    by = words.pop("by")
    words.pop("at", None)
    made: BasePruner
    if by == "median":
        known = {"startup_trials": "n_startup_trials", "warmup_steps": "n_warmup_steps"}
        made = pruners.MedianPruner(**{known[word]: value for word, value in words.items()})
    else:
        known = {"min_steps": "min_resource", "max_steps": "max_resource", "factor": "reduction_factor"}
        made = pruners.HyperbandPruner(**{known[word]: value for word, value in words.items()})
    return made


class Pruner:
    """Says of the runs of one process whether they are to end.

    Args:
        folder: of the search.
    """

    def __init__(self, folder: Folder) -> None:
        plan = SearchPlan.of(folder.read()["plan"])
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
