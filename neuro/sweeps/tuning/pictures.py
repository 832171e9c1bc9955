"""A search drawn as figures of matplotlib: history, front, how much parameters matter, parallel coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from neuro.core.errors import ModelError, unknown
from neuro.core.values import literal
from neuro.plots._canvas import Picture, colours, tidy
from neuro.sweeps.pictures import pictures as of_runs
from neuro.sweeps.tuning.journal import optuna, quietly, trials_of
from neuro.sweeps.tuning.objectives import MAXIMISE, so_far
from neuro.sweeps.tuning.table import FoundTrial, TuneTable

KINDS = ("history", "front", "importance", "parallel")
_COLOURS = list(islice(colours(), 8))
ENOUGH = 8
"""Trials from which on something can be said of how much a parameter matters."""


def pictures(table: TuneTable, kinds: Sequence[str] = ()) -> dict[str, Figure]:
    """Figures by the name of a file.

    Args:
        table: of the search.
        kinds: some of `KINDS`; those that have something to show if none is given.

    Raises:
        ModelError: no trial is done yet, or a kind has nothing to show.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise unknown("kind of picture", kind, KINDS)
    done = [trial for trial in table.trials() if trial.values is not None]
    if not done:
        raise ModelError(f"{table.path}: no trial is done yet: nothing to draw")
    several = len(table.plan.objectives) > 1
    if "front" in kinds and not several:
        raise ModelError(f"a front needs two objectives: found {next(iter(table.plan.objectives))} alone")
    chosen = kinds or [kind for kind in KINDS if _shows(kind, several, len(done), len(table.plan.names))]
    drawn: dict[str, Figure] = {}
    for kind in chosen:
        if kind == "parallel":
            of_objectives = of_runs(table.runs(), tuple(table.plan.objectives), table.plan.names, "parallel")
            drawn |= of_objectives
        else:
            drawn[kind] = {"history": _history, "front": _front, "importance": _importance}[kind](table, done)
    return drawn


def _shows(kind: str, several: bool, done: int, parameters: int) -> bool:
    return {"front": several, "importance": done >= ENOUGH and parameters > 1}.get(kind, True)


def _figure(table: TuneTable, rows: int = 1) -> tuple[Figure, list[Any]]:
    figure = Picture(figsize=(7.0, 4.4 if rows == 1 else 2.6 * rows), layout="constrained", dpi=150)
    figure.suptitle(literal(table.name), fontsize=12)
    axes = list(np.atleast_1d(figure.subplots(rows, sharex=rows > 1)))
    for axis in axes:
        tidy(axis)
    return figure, axes


def _history(table: TuneTable, done: Sequence[FoundTrial]) -> Figure:
    """Each trial's value, and the best so far."""
    figure, axes = _figure(table, len(table.plan.objectives))
    numbers = [trial.number for trial in done]
    for axis, (k, (name, direction)) in zip(axes, enumerate(table.plan.objectives.items()), strict=True):
        values = _column(done, k)
        axis.plot(numbers, values, "o", color="0.65", markersize=4, label="trials")
        axis.step(
            numbers, so_far(values, direction), where="post", color=_COLOURS[0], linewidth=1.4, label="best so far"
        )
        axis.set_ylabel(literal(name))
    axes[0].legend(frameon=False, fontsize="small")
    axes[-1].set_xlabel("trial")
    return figure


def _front(table: TuneTable, done: Sequence[FoundTrial]) -> Figure:
    """Two objectives against each other, and the trials that no other beats, joined in steps."""
    figure, (axis,) = _figure(table)
    (x_name, _), (y_name, y_way) = _pair(table)
    at = list(table.plan.objectives)
    x, y = (_column(done, at.index(name)) for name in (x_name, y_name))
    best = table.best()
    front_x, front_y = (_column(best, at.index(name)) for name in (x_name, y_name))
    order = np.lexsort((front_y if y_way == MAXIMISE else -front_y, front_x))
    axis.plot(x, y, "o", color="0.7", markersize=4, label="trials")
    if len(at) == 2:
        x_way = table.plan.objectives[x_name]
        where = "post" if x_way != MAXIMISE else "pre"
        axis.step(front_x[order], front_y[order], where=where, color=_COLOURS[0], linewidth=1.2)
    axis.plot(front_x, front_y, "o", color=_COLOURS[0], markersize=6, label="no other beats these")
    tests = _tests(table, x_name, y_name)
    if tests:
        axis.plot(*zip(*tests, strict=True), "x", color=_COLOURS[1], markersize=7, label="the same, held out")
    axis.set_xlabel(literal(f"{x_name} ({table.plan.objectives[x_name]})"))
    axis.set_ylabel(literal(f"{y_name} ({table.plan.objectives[y_name]})"))
    axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


def _pair(table: TuneTable) -> list[tuple[str, str]]:
    """The first two objectives; what is minimised, a cost, to the right."""
    first, second = list(table.plan.objectives.items())[:2]
    return [second, first] if first[1] == MAXIMISE else [first, second]


def _tests(table: TuneTable, x_name: str, y_name: str) -> list[tuple[float, float]]:
    found = [(row.get(f"test.{x_name}"), row.get(f"test.{y_name}")) for row in table.rows()]
    return [(x, y) for x, y in found if x is not None and y is not None]


def _importance(table: TuneTable, done: Sequence[FoundTrial]) -> Figure:
    """A bar for each parameter and objective."""
    figure, (axis,) = _figure(table)
    found = {name: importance(table, name) for name in table.plan.objectives}
    names = list(table.plan.names)[::-1]
    tall = 0.8 / len(found)
    for k, (objective, shares) in enumerate(found.items()):
        places = np.arange(len(names)) + 0.4 - (k + 0.5) * tall
        axis.barh(places, [shares[name] for name in names], tall * 0.9, color=_COLOURS[k], label=literal(objective))
    axis.set_yticks(range(len(names)), [literal(name) for name in names])
    axis.set_xlim(0.0, 1.0)
    axis.set_xlabel("share in what makes a trial one of the best tenth")
    if len(found) > 1:
        axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


def _column(trials: Sequence[FoundTrial], k: int) -> Any:
    return np.array([trial.values[k] for trial in trials if trial.values], float)


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
