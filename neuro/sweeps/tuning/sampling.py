"""Points from Optuna's samplers: the parameters of a space as its distributions, and one sampler for each trial.

A sampler begins anew for each trial, with a seed from that of the search and the number of the trial. So what is asked
next depends on the search alone, not on how often it was interrupted. A grid is shuffled once.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.sweeps.space import Axis, Point
from neuro.sweeps.tuning.journal import optuna, quietly
from neuro.sweeps.tuning.plan import Plan

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler
    from optuna.trial import Trial

POPULATION = 16
"""Of NSGA-II: so many trials are drawn at random before the first is bred."""


def sampler_of(plan: Plan, number: int) -> BaseSampler:
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
            made = samplers.NSGAIISampler(seed=seed, population_size=POPULATION)
        elif plan.sampler == "grid":
            made = samplers.GridSampler({axis.name: _choices(axis) for axis in plan.axes}, seed=plan.draw)
        else:
            made = samplers.RandomSampler(seed=seed)
    return made


def suggested(trial: Trial, plan: Plan) -> Point:
    """The values of all parameters; those that the trial has already stay."""
    with quietly():
        return {axis.name: _suggested(trial, axis, plan.sampler == "grid") for axis in plan.axes}


def _suggested(trial: Trial, axis: Axis, is_grid: bool) -> Any:
    if axis.values or is_grid:
        return read(axis, trial.suggest_categorical(axis.name, _choices(axis)))
    if axis.whole:
        return trial.suggest_int(axis.name, int(axis.low), int(axis.high), log=axis.log)
    return trial.suggest_float(axis.name, axis.low, axis.high, log=axis.log)


def read(axis: Axis, value: Any) -> Any:
    """A value of a parameter from what Optuna has of it: lists lie there as texts."""
    return next((one for one in axis.listed if _choice(one) == value), value) if axis.values else value


def point_of(plan: Plan, params: Mapping[str, Any]) -> Point:
    """The values of those parameters that a trial of the journal has."""
    return {axis.name: read(axis, params[axis.name]) for axis in plan.axes if axis.name in params}


def _choices(axis: Axis) -> list[Any]:
    return [_choice(value) for value in axis.listed]


def _choice(value: Any) -> Any:
    return value if value is None or isinstance(value, (bool, int, float, str)) else json.dumps(value)
