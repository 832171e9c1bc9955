"""A NIR graph as plain nodes with shapes, without subgraphs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.extras import needed

Shape = tuple[int, ...]
Floats = NDArray[np.float64]

STATEFUL = ("IF", "LIF", "CubaLIF", "I", "LI", "CubaLI", "Threshold")
"""Types of nodes that become populations."""

_NEURON = {
    "IF": ("r", "v_threshold", "v_reset"),
    "LIF": ("tau", "r", "v_leak", "v_threshold", "v_reset"),
    "CubaLIF": ("tau_syn", "tau_mem", "r", "v_leak", "v_threshold", "v_reset", "w_in"),
    "I": ("r",),
    "LI": ("tau", "r", "v_leak"),
    "CubaLI": ("tau_syn", "tau_mem", "r", "v_leak", "w_in"),
    "Threshold": ("threshold",),
}
_SLIDING = ("stride", "padding")
_CONV = ("weight", "bias", *_SLIDING, "dilation", "groups")
FIELDS = _NEURON | {
    "Input": (),
    "Output": (),
    "Linear": ("weight",),
    "Affine": ("weight", "bias"),
    "Scale": ("scale",),
    "Delay": ("delay",),
    "Flatten": ("start_dim", "end_dim"),
    "Conv1d": _CONV,
    "Conv2d": _CONV,
    "SumPool2d": ("kernel_size", *_SLIDING),
    "AvgPool2d": ("kernel_size", *_SLIDING),
}
"""Types of nodes that can be read, and their fields."""


@dataclass(slots=True)
class Node:
    """One node.

    Attributes:
        name: its name; those of nodes in a subgraph begin with that of the subgraph and a dot.
        kind: its type in NIR.
        fields: its arrays and numbers by name.
        shape: of what it gives; () until `Graph` has found it.
        recurrent: whether weights lead from it back to it.
        problem: why it cannot be used, and the way out; ("", "") if it can.
    """

    name: str
    kind: str
    fields: dict[str, Any]
    shape: Shape = ()
    recurrent: bool = False
    problem: tuple[str, str] = ("", "")

    def array(self, word: str) -> Floats:
        """A field as an array of the node's shape."""
        return spread(self.fields[word], self.shape, f"node '{self.name}': {word}")


@dataclass(slots=True)
class Graph:
    """Nodes by name, and edges between them.

    Attributes:
        source: the file, or "graph".
        nodes: without subgraphs.
        edges: source and target of each.
        metadata: of the graph, e.g. who wrote it.
    """

    source: str
    nodes: dict[str, Node]
    edges: list[tuple[str, str]]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def before(self, name: str) -> list[str]:
        """The nodes whose output a node receives."""
        return [a for a, b in self.edges if b == name]

    def order(self) -> list[str]:
        """All nodes, each after those that it receives from; stateful nodes count as beginnings."""
        waits = {name: self.before(name) if node.kind not in STATEFUL else [] for name, node in self.nodes.items()}
        try:
            return list(TopologicalSorter(waits).static_order())
        except CycleError as error:
            loop = " -> ".join(error.args[1])
            raise ModelError(f"{self.source}: the loop {loop} has no neuron in it") from None


def spread(value: Any, shape: Shape, what: str) -> Floats:
    """An array of a shape from one of it, of as many elements, or of one that broadcasts to it.

    Raises:
        ModelError: it does not fit, or a number is not finite.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ModelError(f"{what}: found {value!r:.40}: expected numbers") from None
    if not np.isfinite(array).all():
        raise ModelError(f"{what}: found a number that is not finite")
    if array.size == math.prod(shape):
        return array.reshape(shape)
    try:
        return np.broadcast_to(array, shape).astype(np.float64)
    except ValueError:
        raise ModelError(f"{what} has the shape {list(array.shape)}: expected {list(shape)}") from None


def package(what: str) -> Any:
    """The package `nir`.

    Raises:
        ModelError: it is not installed.
    """
    return needed("nir", "nir", f"{what}: the package nir is not installed")


def shorten(depths: list[float], edges: Sequence[tuple[int, int, int]]) -> None:
    """Lower depths until no target is deeper than the source plus the steps between them (Bellman and Ford).

    Args:
        depths: one for each node, changed in place.
        edges: source, target and steps.
    """
    for _ in depths:
        before = list(depths)
        for source, target, steps in edges:
            depths[target] = min(depths[target], depths[source] + steps)
        if depths == before:
            break


def sources(graph: Graph, name: str) -> Iterator[list[str]]:
    """The paths that lead to a node from Input and stateful nodes, each with both ends."""
    stack = [[name]]
    while stack:
        path = stack.pop()
        for a in graph.before(path[0]):
            longer = [a, *path]
            if graph.nodes[a].kind in (*STATEFUL, "Input"):
                yield longer
            else:
                stack.append(longer)
