"""Synapses that the compiler does not draw: synapses listed in a file, or drawn by a backend with its own rules."""

from __future__ import annotations

import math
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Blocks, expected_synapses
from neuro.compiler.connections import Connections
from neuro.compiler.drawn_values import LONGEST_DELAY, check_distribution, too_long_delay
from neuro.compiler.draws import check_degree, connections_of_pairs
from neuro.compiler.pairs import check_number
from neuro.compiler.shapes import End
from neuro.compiler.synapses import Synapses
from neuro.compiler.values import one_delay
from neuro.core.clock import Clock
from neuro.core.keyed_random import generator
from neuro.core.values import plain
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.parts import Population, Projection, refuse
from neuro.model.rules import (
    BACKEND,
    NamedRule,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    from_file,
    one_to_one,
)
from neuro.model.synapses import static
from neuro.model.wiring.edges import Counted, Edges, End as Named, read_edges, shuffle_edges
from neuro.program.program import Floats, Undrawn

_MAX_DEVIATIONS = 9.0
"""Largest distance from the mean, in standard deviations, of a normal number made of 53 random bits."""

_WAY_OUT = "draw: neuro, or leave it out"


def undrawn(part: Projection, n_pre: int, n_post: int, clock: Clock) -> tuple[Undrawn, Synapses]:
    """Return the description of a projection that the backend draws, and a placeholder for its synapses.

    The placeholder has the number of synapses, and the bounds of weights and delays.

    Raises:
        ModelError: backends cannot draw the synapses, because the projection has a view, a synapse that is not static,
            or a value for each synapse.
    """
    if part.source_view is not None or part.target_view is not None:
        _refuse(part, "a view", "whole populations")
    if not isinstance(part.synapse, static):
        _refuse(part, part.synapse.name, "static synapses")
    weight, delay = (_described(part, word) for word in ("weight", "delay"))
    if isinstance(delay, Distribution):
        check_distribution(delay, clock, "delay")
        steps = np.maximum(np.rint(np.array(bounds(delay)) / clock.resolution), 1.0)
        if steps.max() > LONGEST_DELAY:
            hint = f"lower {delay.name}.high: backends must know the longest delay before they draw"
            raise too_long_delay("the longest delay that may be drawn", int(steps.max()), clock).but(hint=hint)
        delays = steps.astype(np.int32)
    else:
        delays = one_delay(delay, clock, "delay").astype(np.int32)
    assert isinstance(part.rule, NamedRule)
    excluded = int((part.source == part.target) and not getattr(part.rule, "autapses", True))
    match part.rule:
        case one_to_one():
            Blocks(part.rule, (n_pre,), (n_post,), None, None, (0, "", ""), _no_distance).whole()
        case fixed_indegree():
            check_degree(part.rule.n, n_pre - excluded, part.rule.multapses, "sources")
        case fixed_outdegree():
            check_degree(part.rule.n, n_post - excluded, part.rule.multapses, "targets")
        case fixed_total_number():
            check_number(part.rule.n, n_pre * n_post - excluded * n_pre, part.rule.multapses)
    number = part.rule.synapses(n_pre, n_post, part.source == part.target)
    connections = Connections(
        "undrawn",
        expected_synapses(part.rule, n_pre, n_post) if number is None else number,
        np.zeros(n_pre + 1, dtype=np.int64),
    )
    extremes = np.array(bounds(weight)) if isinstance(weight, Distribution) else np.array([weight])
    described = Undrawn(part.rule, weight, delay)
    return described, Synapses(connections, delays, extremes, part.synapse, False, connections.layout)


def _no_distance() -> NoReturn:
    raise NotImplementedError


def bounds(value: Distribution) -> tuple[float, float]:
    """Return the smallest and the largest possible draw."""
    match value:
        case uniform():
            return value.low, value.high
        case normal():
            lowest, most = value.mean - _MAX_DEVIATIONS * value.std, value.mean + _MAX_DEVIATIONS * value.std
        case lognormal():
            lowest, most = (math.exp(min(value.mean + side * _MAX_DEVIATIONS * value.std, 700.0)) for side in (-1, 1))
        case _:
            raise NotImplementedError(value)
    return max(lowest, value.low), min(most, value.high)


def _described(part: Projection, word: str) -> float | Distribution:
    """Return the weight or the delay: a number or a built-in distribution."""
    value: Any = plain(getattr(part, word))
    if type(value) in (uniform, normal, lognormal):
        value.checked_sample(np.random.default_rng(0), 1)  # raises an error if hardly any draw lies within the bounds
        return value  # type: ignore[no-any-return]
    if isinstance(value, Distribution) or not np.isscalar(value):
        actual = f"the distribution {value.name}" if isinstance(value, Distribution) else f"a {word} for each synapse"
        _refuse(part, actual, f"as {word} a number, uniform, normal or lognormal")
    return float(value)


def _refuse(part: Projection, actual: str, expected: str) -> None:
    refuse(part, f"draw = {BACKEND}: found {actual}: expected {expected}", _WAY_OUT, "draw")


def wired(
    part: Projection, rule: from_file, ends: tuple[Population, Population], views: tuple[End, End]
) -> Connections:
    """Return the synapses listed in a file.

    Args:
        part: the projection.
        rule: rule of the projection.
        ends: the populations.
        views: the neurons of the populations.

    Raises:
        ModelError: the file or the table of neurons cannot be read, or does not fit. The message names the cell.
    """
    tables = [_neuron_table(population, view.size) for population, view in zip(ends, views, strict=True)]
    edges = read_edges(rule, *tables)
    if rule.shuffle is not None:
        rng = generator(rule.shuffle_seed, f"shuffle {rule.shuffle}", part.name)
        edges = shuffle_edges(edges, rule.shuffle, rng, part.source == part.target)
    edges = _within(edges, *views)
    factors = {"weight": edges.weight, "delay": edges.delay}
    return connections_of_pairs(
        edges.pre, edges.post, views[0].size, views[1].size, {k: v for k, v in factors.items() if v is not None}
    )


def _neuron_table(population: Population, n: int) -> Named:
    if population.neurons is None:
        return Counted(n, population.name)
    return population.neurons.neurons


def _within(edges: Edges, source: End, target: End) -> Edges:
    """Return the edges between the neurons of two views."""
    if source.ids is None and target.ids is None:
        return edges
    inside = _mask(source)[edges.pre] & _mask(target)[edges.post]

    def select(values: Floats | None) -> Floats | None:
        return None if values is None else values[inside]

    return Edges(edges.pre[inside], edges.post[inside], select(edges.weight), select(edges.delay), edges.sign)


def _mask(end: End) -> NDArray[Any]:
    mask = np.zeros(end.size, dtype=bool)
    mask[slice(None) if end.ids is None else end.ids] = True
    return mask
