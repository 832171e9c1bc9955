"""Edges from files as synapses: those between the neurons of two views, in the order of source, then target."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Connections, listed
from neuro.compiler.views import End
from neuro.core.keyed_random import generator
from neuro.model.parts import Population, Projection
from neuro.model.rules import from_file
from neuro.model.wiring.edges import Counted, Edges, End as Named, read_edges
from neuro.model.wiring.shuffling import shuffle_edges
from neuro.program.program import Floats


def wired(
    part: Projection, rule: from_file, ends: tuple[Population, Population], views: tuple[End, End]
) -> Connections:
    """The synapses that a file lists.

    Args:
        part: the projection.
        rule: its rule.
        ends: the populations.
        views: which of their neurons.

    Raises:
        ModelError: the file, or the table of neurons, cannot be read or does not fit; it names the cell.
    """
    named = [_named(population, view.size) for population, view in zip(ends, views, strict=True)]
    edges = read_edges(rule, *named)
    if rule.shuffle is not None:
        rng = generator(rule.shuffle_seed, f"shuffle {rule.shuffle}", part.name)
        edges = shuffle_edges(edges, rule.shuffle, rng, part.source == part.target)
    edges = _within(edges, *views)
    factors = {"weight": edges.weight, "delay": edges.delay}
    return listed(
        edges.pre, edges.post, views[0].size, views[1].size, {k: v for k, v in factors.items() if v is not None}
    )


def _named(population: Population, n: int) -> Named:
    if population.neurons is None:
        return Counted(n, population.name)
    return population.neurons.neurons


def _within(edges: Edges, source: End, target: End) -> Edges:
    """The edges between the neurons of two views."""
    if source.ids is None and target.ids is None:
        return edges
    inside = _among(source)[edges.pre] & _among(target)[edges.post]

    def some(values: Floats | None) -> Floats | None:
        return None if values is None else values[inside]

    return Edges(edges.pre[inside], edges.post[inside], some(edges.weight), some(edges.delay), edges.sign)


def _among(end: End) -> NDArray[Any]:
    among = np.zeros(end.size, dtype=bool)
    among[slice(None) if end.ids is None else end.ids] = True
    return among
