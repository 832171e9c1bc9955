"""How much each parameter matters for an objective."""

from __future__ import annotations

from neuro.sweeps.tuning.journal import optuna, quietly, trials_of
from neuro.sweeps.tuning.table import TuneTable


def importance(table: TuneTable, objective: str) -> dict[str, float]:
    """Shares of the parameters in what makes a trial good; together 1.

    Args:
        table: of the search.
        objective: by name.

    Raises:
        ModelError: the journal is damaged, or Optuna is not installed.

    Source: Watanabe et al., IJCAI 2023 (PED-ANOVA), as Optuna has it.
    """
    from neuro.sweeps.folder import TUNING, Folder

    package = optuna()
    k = list(table.plan.objectives).index(objective)
    way = {"maximise": "maximize", "minimise": "minimize"}[table.plan.objectives[objective]]
    with quietly():
        study = package.create_study(direction=way)
        for trial in trials_of(Folder(table.path, TUNING)):
            if trial.state.name == "COMPLETE":
                words = {"params": trial.params, "distributions": trial.distributions, "value": trial.values[k]}
                study.add_trial(package.trial.create_trial(**words))
        evaluator = package.importance.PedAnovaImportanceEvaluator()
        found = package.importance.get_param_importances(study, evaluator=evaluator)
    return {name: float(found.get(name, 0.0)) for name in table.plan.names}
