"""The superposition of gamma processes."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Generator, State
from neuro.model.neurons.generators import binomial

LARGEST_SHAPE = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class gamma_sup_generator(Generator):
    """Emits the spikes of many independent gamma processes together, as the input from a population of neurons.

    A process goes through `gamma_shape` stages and spikes when it leaves the last; in a step it leaves its stage with
    the probability rate gamma_shape h / 1000. All targets of one of its neurons see the same train.
    """

    equation: ClassVar[str] = (
        "in a step each of n_proc processes goes on to its next stage of gamma_shape with the probability "
        "rate gamma_shape h / 1000; from the last one it spikes"
    )
    source: ClassVar[str] = "NEST 3.10 gamma_sup_generator; Deger, Helias, Boucsein & Rotter 2012"
    timed: ClassVar[bool] = True
    fixed: ClassVar[tuple[str, ...]] = ("gamma_shape", "n_proc")
    states: ClassVar[tuple[State, ...]] = tuple(
        State(f"in_stage_{k}", "", "processes in a stage", hidden=True) for k in range(LARGEST_SHAPE)
    )

    rate: Value = quantity(0.0, "Hz", "mean rate of each process", at_least=0, arrays=True)
    gamma_shape: int = quantity(1, "", "stages of a process", kind="integer", at_least=1, at_most=LARGEST_SHAPE)
    n_proc: int = quantity(1, "", "number of processes", kind="integer", at_least=1)
    start: float = quantity(0.0, "ms", "emits after this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and up to this one", at_least=0, infinite=True)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """The processes are spread evenly over the stages, as in NEST; the first stages have what is left over."""
        stages, processes = int(parameters["gamma_shape"][0]), int(parameters["n_proc"][0])
        each, over = divmod(processes, stages)
        return {f"in_stage_{k}": np.array([float(each + (k < over))]) for k in range(stages)}


CHANCE, STAGES = range(2)


def constants(p, h, c):
    """The chance to leave a stage in a step; `p` are rate, gamma_shape and n_proc."""
    c[CHANCE], c[STAGES] = p[0] * p[1] * h / 1000.0, p[1]


def emit(s, c, u, step, lo, hi, out):
    """Binomial numbers leave each stage for the next; the stages share one uniform number."""
    stages = int(c[STAGES])
    for i in range(lo, hi):
        rest, came = u[i], 0
        for stage in range(stages):
            leave, rest = binomial(rest, int(s[stage, i]), c[CHANCE])
            s[stage, i] += came - leave
            came = leave
        s[0, i] += came
        out[i] = came
