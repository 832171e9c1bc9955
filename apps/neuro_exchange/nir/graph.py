"""NIR graphs as plain nodes without subgraphs: their fields and shapes, and what nodes in a row are together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import needed

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


Pair = tuple[int, int]
_HUGE = 2**40
"""What no stride, size or axis reaches."""


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """A convolution over a sheet (channels, height, width).

    Attributes:
        weight: (maps, channels that reach each, height, width).
        stride, padding: of rows and of columns; the padding is the border before the sheet.
        depthwise: whether map m is reached from channel m // (maps / channels) only.
    """

    weight: Floats
    stride: Pair
    padding: Pair
    depthwise: bool


@dataclass(frozen=True, slots=True, eq=False)
class Map:
    """A linear map between two shapes.

    Attributes:
        source, target: the shapes.
        diagonal: the factor of each element where elements are not mixed, else None.
        kernel: the convolution that it is, else None.
        matrix: as scipy sparse, target x source, where it is none of these.
    """

    source: Shape
    target: Shape
    diagonal: Floats | None = None
    kernel: Kernel | None = None
    matrix: Any = None

    def sparse(self) -> Any:
        """The matrix, target x source."""
        from scipy.sparse import diags_array

        if self.diagonal is not None:
            return diags_array(self.diagonal.reshape(-1)).tocsr()
        return _spelt_out(self) if self.kernel is not None else self.matrix

    def __call__(self, values: Floats) -> Floats:
        """Values of the source's shape, mapped."""
        return np.asarray(self.sparse() @ values.reshape(-1), dtype=np.float64).reshape(self.target)

    def onto(self, targets: NDArray[np.bool_]) -> Map:
        """The same map onto some elements of the target; the others receive nothing."""
        from scipy.sparse import diags_array

        mask = diags_array(targets.reshape(-1).astype(np.float64))
        matrix = (mask @ self.sparse()).tocsr()
        matrix.eliminate_zeros()
        return Map(self.source, self.target, matrix=matrix)


def sheet(shape: Shape) -> Shape:
    """A shape as (channels, height, width)."""
    return (shape[0], 1, shape[1]) if len(shape) == 2 else shape


def outcome(node: Node, shape: Shape) -> Shape:
    """The shape that a node gives for one that it receives.

    Raises:
        ModelError: it cannot receive that shape.
    """
    match node.kind:
        case "Linear" | "Affine":
            weight = np.asarray(node.fields["weight"])
            if weight.ndim == 2 and shape[-1] != weight.shape[1] == math.prod(shape):
                return (weight.shape[0],)  # Norse writes no Flatten
            if weight.ndim < 2 or shape[-1] != weight.shape[-1] or weight.ndim > 2:
                raise _unfit(node, shape, f"weights of shape {list(weight.shape)}")
            return (*shape[:-1], weight.shape[0])
        case "Conv1d" | "Conv2d":
            return _sliding_outcome(node, shape, np.asarray(node.fields["weight"]))
        case "SumPool2d" | "AvgPool2d":
            return _sliding_outcome(node, shape, None)
        case "Flatten":
            first, last = (_axis(node, word, len(shape)) for word in ("start_dim", "end_dim"))
            if first > last:
                raise _unfit(node, shape, f"axes {first} to {last}")
            return (*shape[:first], math.prod(shape[first : last + 1]), *shape[last + 1 :])
    return shape


def _axis(node: Node, word: str, axes: int) -> int:
    given = _whole(node, word)
    axis = given + axes if given < 0 else given
    if not 0 <= axis < axes:
        raise ModelError(f"node '{node.name}': {word} = {given} of {axes} axes")
    return axis


def _whole(node: Node, word: str) -> int:
    """A field that is one whole number."""
    numbers = wholes(node.fields[word])
    if len(numbers) != 1:
        raise ModelError(f"node '{node.name}': {word} = {shown(node.fields[word])}: expected a whole number")
    return numbers[0]


def wholes(value: Any) -> list[int]:
    """Whole numbers; none where a number is not whole, or beyond what a shape may be."""
    array = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if array.ndim > 1 or not np.all(np.abs(array) < _HUGE) or np.any(array != np.rint(array)):
        return []
    return [int(n) for n in array]


def shown(value: Any) -> str:
    """A field for messages."""
    return f"{np.asarray(value).tolist()!r:.60}"


def _unfit(node: Node, shape: Shape, of: str) -> ModelError:
    return ModelError(f"node '{node.name}' ({node.kind}) with {of} receives the shape {list(shape)}")


def _pair(node: Node, value: Any, word: str, least: int) -> Pair:
    """One whole number for each axis of a sheet; of one axis the columns."""
    numbers = wholes(value)
    first = 0 if word == "padding" else 1
    pair = (first, *numbers) if node.kind == "Conv1d" else tuple(numbers * 2 if len(numbers) == 1 else numbers)
    if len(pair) != 2 or min(pair) < least:
        raise ModelError(f"node '{node.name}': {word} = {shown(value)}: expected whole numbers >= {least}")
    return pair[0], pair[1]


def _extent(node: Node, weight: NDArray[Any] | None) -> tuple[Pair, Pair, Pair, Pair, Pair]:
    """Kernel, dilation, stride, and the border before and after."""
    if weight is None:
        kernel, dilation = _pair(node, node.fields["kernel_size"], "kernel_size", 1), (1, 1)
    else:
        kernel = (1, weight.shape[-1]) if node.kind == "Conv1d" else (weight.shape[-2], weight.shape[-1])
        dilation = _pair(node, node.fields["dilation"], "dilation", 1)
    stride = _pair(node, node.fields["stride"], "stride", 1)
    said = node.fields["padding"]
    if isinstance(said, (str, bytes)) or np.asarray(said).dtype.kind in "SU":
        word = str(np.asarray(said).astype(str).reshape(-1)[0])
        if word not in ("same", "valid") or (word == "same" and stride != (1, 1)):
            raise ModelError(
                f"node '{node.name}': padding '{word}': expected numbers, 'valid', or 'same' with stride 1"
            )
        total = [d * (k - 1) if word == "same" else 0 for d, k in zip(dilation, kernel, strict=True)]
        before = (total[0] // 2, total[1] // 2)
        after = (total[0] - before[0], total[1] - before[1])
    else:
        before = after = _pair(node, said, "padding", 0)
    return kernel, dilation, stride, before, after


def _sliding_outcome(node: Node, shape: Shape, weight: NDArray[Any] | None) -> Shape:
    axes = 2 if node.kind == "Conv1d" else 3
    if len(shape) != axes or (weight is not None and weight.ndim != axes + 1):
        raise _unfit(node, shape, f"{axes - 1} axes that it slides along")
    maps = shape[0]
    if weight is not None:
        groups = _groups(node)
        maps = weight.shape[0]
        if weight.shape[1] * groups != shape[0] or maps % groups:
            raise _unfit(node, shape, f"weights of shape {list(weight.shape)} in {groups} groups")
    kernel, dilation, stride, before, after = _extent(node, weight)
    _, *lengths = sheet(shape)
    sizes = []
    for n, k, d, s, b, a in zip(lengths, kernel, dilation, stride, before, after, strict=True):
        reach = d * (k - 1) + 1
        if n + b + a < reach:
            raise _unfit(node, shape, f"a kernel of {reach} lines")
        sizes.append((n + b + a - reach) // s + 1)
    return (maps, sizes[1]) if axes == 2 else (maps, *sizes)


def _groups(node: Node) -> int:
    groups = _whole(node, "groups")
    if groups < 1:
        raise ModelError(f"node '{node.name}': groups = {groups}: expected at least 1")
    return groups


def map_of(node: Node, source: Shape) -> Map:
    """What a node does to an array of a shape, without its bias.

    Raises:
        ModelError: it does not fit.
    """
    from scipy.sparse import csr_array, eye_array, kron

    target = outcome(node, source)
    match node.kind:
        case "Linear" | "Affine":
            weight = spread(node.fields["weight"], np.shape(node.fields["weight"]), f"node '{node.name}': weight")
            matrix = csr_array(weight)
            repeats = math.prod(source) // matrix.shape[1]
            return Map(source, target, matrix=kron(eye_array(repeats), matrix).tocsr() if repeats > 1 else matrix)
        case "Scale":
            return Map(source, target, diagonal=spread(node.fields["scale"], target, f"node '{node.name}': scale"))
        case "Conv1d" | "Conv2d":
            return Map(source, target, kernel=_kernel(node, source))
        case "SumPool2d" | "AvgPool2d":
            size, _, stride, padding, _ = _extent(node, None)
            share = 1.0 / math.prod(size) if node.kind == "AvgPool2d" else 1.0
            return Map(
                source, target, kernel=Kernel(np.full((source[0], 1, *size), share), stride, padding, depthwise=True)
            )
    return Map(source, target, diagonal=np.ones(target))


def _kernel(node: Node, source: Shape) -> Kernel:
    weight = spread(node.fields["weight"], np.shape(node.fields["weight"]), f"node '{node.name}': weight")
    if node.kind == "Conv1d":
        weight = weight[:, :, None, :]
    _, (dy, dx), stride, before, _ = _extent(node, np.asarray(node.fields["weight"]))
    if (dy, dx) != (1, 1):  # a dilated kernel is a larger one with zeros
        wide = np.zeros((*weight.shape[:2], dy * (weight.shape[2] - 1) + 1, dx * (weight.shape[3] - 1) + 1))
        wide[:, :, ::dy, ::dx] = weight
        weight = wide
    groups, depthwise = _groups(node), False
    if groups > 1:
        depthwise = weight.shape[1] == 1
        if not depthwise:  # channels of other groups reach a map with weight 0
            maps, depth = weight.shape[:2]
            full = np.zeros((maps, source[0], *weight.shape[2:]))
            for m in range(maps):
                first = m // (maps // groups) * depth
                full[m, first : first + depth] = weight[m]
            weight = full
    return Kernel(weight, stride, before, depthwise)


def together(maps: Sequence[Map]) -> Map:
    """Several maps in a row as one; a convolution where they are one."""
    return reduce(_then, maps)


def _then(first: Map, second: Map) -> Map:
    if first.diagonal is not None and np.all(first.diagonal == 1.0) and first.source == second.source:
        return second
    if second.diagonal is not None:
        if first.diagonal is not None:
            return Map(first.source, second.target, diagonal=first.diagonal.reshape(second.target) * second.diagonal)
        if np.all(second.diagonal == 1.0) and first.target == second.target:
            return first
        if (
            first.kernel is not None
            and (per_map := same_in_each_map(second.diagonal.reshape(first.target))) is not None
        ):
            kernel = replace(first.kernel, weight=first.kernel.weight * per_map[:, None, None, None])
            return Map(first.source, first.target, kernel=kernel)
    if first.kernel is not None and second.kernel is not None and first.target == second.source:
        pooled = _pooled(first, second)
        if pooled is not None:
            return Map(first.source, second.target, kernel=pooled)
    return Map(first.source, second.target, matrix=(second.sparse() @ first.sparse()).tocsr())


def same_in_each_map(values: Floats) -> Floats | None:
    """The value of each map of (maps, ...), None where a map has several."""
    rows = values.reshape(values.shape[0], -1)
    return rows[:, 0].copy() if np.all(rows == rows[:, :1]) else None


def _pooled(pool: Map, then: Map) -> Kernel | None:
    """The convolution that a pool and a convolution are together; None where they are none."""
    a, b = pool.kernel, then.kernel
    assert a is not None and b is not None  # noqa: PT018
    channels, height, width = sheet(pool.source)
    _, rows, columns = sheet(pool.target)
    size = a.weight.shape[2:]
    whole = (rows * size[0], columns * size[1]) == (height, width)
    one_each = a.depthwise and a.weight.shape[0] == channels
    if not (one_each and whole and size == a.stride and a.padding == (0, 0) and np.all(a.weight == a.weight.flat[0])):
        return None
    weight = np.repeat(np.repeat(b.weight * a.weight.flat[0], size[0], axis=2), size[1], axis=3)
    stride = b.stride[0] * size[0], b.stride[1] * size[1]
    padding = b.padding[0] * size[0], b.padding[1] * size[1]
    return Kernel(weight, stride, padding, b.depthwise)


def _spelt_out(part: Map) -> Any:
    """The matrix of a convolution."""
    from scipy.sparse import csr_array

    kernel = part.kernel
    assert kernel is not None
    (channels, height, width), (maps, rows, columns) = sheet(part.source), sheet(part.target)
    m, r, c, k, i, j = np.indices((maps, rows, columns, *kernel.weight.shape[1:])).reshape(6, -1)
    y, x = r * kernel.stride[0] + i - kernel.padding[0], c * kernel.stride[1] + j - kernel.padding[1]
    inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    channel = k + m // (maps // channels) if kernel.depthwise else k
    source = ((channel * height + y) * width + x)[inside]
    target = ((m * rows + r) * columns + c)[inside]
    weights = kernel.weight[m[inside], k[inside], i[inside], j[inside]]
    return csr_array((weights, (target, source)), shape=(math.prod(part.target), math.prod(part.source)))
