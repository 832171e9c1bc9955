"""One projection whose synapses NEST draws, by its own connection rules and parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.rules import (
    NamedRule,
    all_to_all,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    pairwise_bernoulli,
)
from neuro.program.program import Floats, Program
from neuro_nest.clock import NestClock

_HUGE = float(np.finfo(np.float64).max)

MODEL = "static_synapse"
OF_A_MODEL = 1 << 26
"""Synapses of a copy of NEST's model: a thread has room for 2^27 - 1 of each."""


class RuleProjection:
    """A projection that NEST draws; it is neither read nor set.

    Args:
        program: the network.
        index: which projection.
        weights: the least and the largest that may be drawn.
        before: how many synapses NEST draws for earlier projections.
    """

    def __init__(self, program: Program, index: int, weights: Floats, before: int) -> None:
        self.part, self.index, self.weights = program.projections[index], index, weights
        self._model = f"neuro_static_{before // OF_A_MODEL}"

    def connect(self, nest: Any, source: Any, target: Any, clock: NestClock) -> None:
        """Let NEST draw the synapses.

        Args:
            nest: the module.
            source: the nodes that send.
            target: the nodes that are reached.
            clock: of the network.
        """
        asked = self.part.undrawn
        assert asked is not None
        if self._model not in nest.synapse_models:
            nest.CopyModel(MODEL, self._model)
        weight, delay = (drawn_by_nest(nest, value) for value in (asked.weight, asked.delay))
        negated = self.part.receptor is not None and self.part.receptor.negated
        # What rounds to no step is one step, as in this language.
        late = max(delay, clock.ms(1)) if isinstance(delay, float) else nest.math.max(delay, clock.ms(1))
        words = {"synapse_model": self._model, "weight": weight * -1.0 if negated else weight, "delay": late}
        nest.Connect(source, target, in_words_of_nest(asked.rule), words)

    def ran(self) -> None:
        """Nothing is kept that steps could change."""


def in_words_of_nest(rule: NamedRule) -> dict[str, Any]:
    """A rule as NEST takes it."""
    words: dict[str, Any] = {"rule": rule.name}
    match rule:
        case fixed_indegree(n=n):
            words["indegree"] = n
        case fixed_outdegree(n=n):
            words["outdegree"] = n
        case fixed_total_number(n=n):
            words["N"] = n
        case pairwise_bernoulli(p=p):
            words["p"] = p
    if isinstance(rule, all_to_all | fixed_indegree | fixed_outdegree | fixed_total_number | pairwise_bernoulli):
        words["allow_autapses"] = rule.autapses
    if isinstance(rule, fixed_indegree | fixed_outdegree | fixed_total_number):
        words["allow_multapses"] = rule.multapses
    return words


def drawn_by_nest(nest: Any, value: float | Distribution) -> Any:
    """A number, or the parameter of NEST that draws a distribution."""
    match value:
        case uniform():
            return value.low if value.low == value.high else nest.random.uniform(value.low, value.high)
        case normal(std=0.0):
            return value.mean
        case normal():
            drawn = nest.random.normal(mean=value.mean, std=value.std)
        case lognormal(std=0.0):
            return float(np.exp(value.mean))
        case lognormal():
            drawn = nest.random.lognormal(mean=value.mean, std=value.std)
        case _:
            return value
    if np.isinf(value.low) and np.isinf(value.high):
        return drawn
    return nest.math.redraw(drawn, min=max(value.low, -_HUGE), max=min(value.high, _HUGE))
