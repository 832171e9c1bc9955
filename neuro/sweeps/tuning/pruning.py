"""Whether a run is so much worse than others on its way that it ends: asked in the process that does the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from neuro.sweeps.folder import Folder
from neuro.sweeps.steps import Worse
from neuro.sweeps.tuning.journal import optuna, quietly, study_of
from neuro.sweeps.tuning.plan import Plan

if TYPE_CHECKING:
    from optuna.pruners import BasePruner


def pruner_of(prune: Mapping[str, Any] | None) -> BasePruner:
    """Optuna's pruner of a plan; one that never prunes if there is none.

    Sources: Golovin et al., KDD 2017, section 3.3 (median); Li et al., JMLR 18:185, 2018 (hyperband).
    """
    pruners = optuna().pruners
    words = dict(prune or {})
    by = words.pop("by", None)
    words.pop("at", None)
    made: BasePruner
    if by == "median":
        known = {"startup_trials": "n_startup_trials", "warmup_steps": "n_warmup_steps"}
        made = pruners.MedianPruner(**{known[word]: value for word, value in words.items()})
    elif by == "hyperband":
        known = {"min_steps": "min_resource", "max_steps": "max_resource", "factor": "reduction_factor"}
        made = pruners.HyperbandPruner(**{known[word]: value for word, value in words.items()})
    else:
        made = pruners.NopPruner()
    return made


class Pruner:
    """Says of the runs of one process whether they are to end.

    Args:
        folder: of the search.
    """

    def __init__(self, folder: Folder) -> None:
        plan = Plan.of(folder.read()["plan"])
        self._prune = plan.prune
        self._study = study_of(folder, tuple(plan.objectives.values()), sampler=optuna().samplers.RandomSampler())
        self._study.pruner = pruner_of(plan.prune)

    def of(self, trial: int) -> Worse | None:
        """What is told the steps of a trial; None where nothing is pruned."""
        if not self._prune:
            return None

        def worse(step: int, value: float) -> bool:
            return report(self._study, trial, step, value)

        return worse


def report(study: Any, number: int, step: int, value: float) -> bool:
    """Write down a step of a trial; whether others were better at it.

    A step that is there already, as of a run that is tried once more, stays.
    """
    storage = study._storage
    trial_id = storage.get_trial_id_from_study_id_trial_number(study._study_id, number)
    with quietly():
        if step not in storage.get_trial(trial_id).intermediate_values:
            storage.set_trial_intermediate_value(trial_id, step, value)
        return bool(study.pruner.prune(study, storage.get_trial(trial_id)))
