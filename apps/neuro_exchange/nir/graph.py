"""NIR graphs as plain nodes without subgraphs: fields, shapes, and products of consecutive linear nodes."""

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
    """A node of a graph.

    Attributes:
        name: name; a node of a subgraph is named "subgraph.node".
        kind: type in NIR, e.g. "LIF".
        fields: arrays and numbers by name.
        shape: shape of the output; () until `reading.read` has computed it.
        recurrent: whether the node is part of a loop of two nodes, e.g. a neuron and its recurrent weights.
        problem: reason why the node cannot be used, and the way out; ("", "") for a usable node.
    """

    name: str
    kind: str
    fields: dict[str, Any]
    shape: Shape = ()
    recurrent: bool = False
    problem: tuple[str, str] = ("", "")

    def array(self, word: str) -> Floats:
        """Return a field as an array of the node's shape."""
        return spread(self.fields[word], self.shape, f"node '{self.name}': {word}")


@dataclass(slots=True)
class Graph:
    """A graph of nodes without subgraphs.

    Attributes:
        source: name of the file, or "graph".
        nodes: nodes by name.
        edges: (source, target) of each edge.
        metadata: metadata of the graph, e.g. the tool that wrote the graph.
    """

    source: str
    nodes: dict[str, Node]
    edges: list[tuple[str, str]]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def before(self, name: str) -> list[str]:
        """Return the names of the nodes whose output a node receives."""
        return [a for a, b in self.edges if b == name]

    def order(self) -> list[str]:
        """Return the names of all nodes in topological order. Edges into stateful nodes are ignored.

        Raises:
            ModelError: a loop has no stateful node.
        """
        predecessors = {
            name: self.before(name) if node.kind not in STATEFUL else [] for name, node in self.nodes.items()
        }
        try:
            return list(TopologicalSorter(predecessors).static_order())
        except CycleError as error:
            loop = " -> ".join(error.args[1])
            raise ModelError(f"{self.source}: the loop {loop} has no neuron") from None


def spread(value: Any, shape: Shape, what: str) -> Floats:
    """Return the value as an array of a shape: reshaped if the number of elements is equal, else broadcast.

    `what` names the value in errors.

    Raises:
        ModelError: the value does not fit the shape, or a number is not finite.
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
        raise ModelError(f"{what}: found the shape {list(array.shape)}: expected {list(shape)}") from None


def package(what: str) -> Any:
    """Return the package `nir`.

    Raises:
        ModelError: the package is not installed.
    """
    return needed("nir", "nir", f"{what}: the package nir is not installed")


def shorten(depths: list[float], edges: Sequence[tuple[int, int, int]]) -> None:
    """Lower depths until no target is deeper than a source plus the steps of the edge (Bellman and Ford).

    Args:
        depths: depths of the nodes in steps, changed in place.
        edges: (source, target, steps) of each edge.
    """
    for _ in depths:
        old_depths = list(depths)
        for source, target, steps in edges:
            depths[target] = min(depths[target], depths[source] + steps)
        if depths == old_depths:
            break


def sources(graph: Graph, name: str) -> Iterator[list[str]]:
    """Yield the paths from Input and stateful nodes to a node. A path includes both ends."""
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
"""Upper bound of strides, sizes and axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """A convolution over a sheet (channels, height, width).

    Attributes:
        weight: weights, shape (maps, channels per map, height, width).
        stride: strides along rows and columns.
        padding: width of the border before the first row and the first column.
        depthwise: whether map m receives only from channel m // (maps / channels).
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
        diagonal: factor of each element, if the map is diagonal; else None.
        kernel: kernel, if the map is a convolution; else None.
        matrix: scipy sparse matrix, target x source, of all other maps; else None.
    """

    source: Shape
    target: Shape
    diagonal: Floats | None = None
    kernel: Kernel | None = None
    matrix: Any = None

    def sparse(self) -> Any:
        """Return the map as a sparse matrix, target x source."""
        from scipy.sparse import diags_array

        if self.diagonal is not None:
            return diags_array(self.diagonal.reshape(-1)).tocsr()
        return _convolution_matrix(self) if self.kernel is not None else self.matrix

    def __call__(self, values: Floats) -> Floats:
        """Apply the map to values of the source's shape."""
        return np.asarray(self.sparse() @ values.reshape(-1), dtype=np.float64).reshape(self.target)

    def onto(self, targets: NDArray[np.bool_]) -> Map:
        """Return the map restricted to some elements of the target. All other elements receive 0."""
        from scipy.sparse import diags_array

        mask = diags_array(targets.reshape(-1).astype(np.float64))
        matrix = (mask @ self.sparse()).tocsr()
        matrix.eliminate_zeros()
        return Map(self.source, self.target, matrix=matrix)


def sheet(shape: Shape) -> Shape:
    """Return a shape of two or three axes as (channels, height, width), e.g. (2, 1, 10) for (2, 10)."""
    return (shape[0], 1, shape[1]) if len(shape) == 2 else shape


def output_shape(node: Node, shape: Shape) -> Shape:
    """Return the shape of a node's output for an input of a shape.

    Raises:
        ModelError: the node cannot receive that shape.
    """
    match node.kind:
        case "Linear" | "Affine":
            weight = np.asarray(node.fields["weight"])
            if weight.ndim == 2 and shape[-1] != weight.shape[1] == math.prod(shape):
                return (weight.shape[0],)  # Norse does not write Flatten nodes
            if weight.ndim < 2 or shape[-1] != weight.shape[-1] or weight.ndim > 2:
                raise _unfit(node, shape, f"weights of shape {list(weight.shape)}")
            return (*shape[:-1], weight.shape[0])
        case "Conv1d" | "Conv2d":
            return _sliding_output_shape(node, shape, np.asarray(node.fields["weight"]))
        case "SumPool2d" | "AvgPool2d":
            return _sliding_output_shape(node, shape, None)
        case "Flatten":
            first, last = (_axis(node, word, len(shape)) for word in ("start_dim", "end_dim"))
            if first > last:
                raise _unfit(node, shape, f"axes {first} to {last}")
            return (*shape[:first], math.prod(shape[first : last + 1]), *shape[last + 1 :])
    return shape


def _axis(node: Node, word: str, axes: int) -> int:
    number = _whole(node, word)
    axis = number + axes if number < 0 else number
    if not 0 <= axis < axes:
        raise ModelError(f"node '{node.name}': {word} = {number}: expected an axis of {axes}")
    return axis


def _whole(node: Node, word: str) -> int:
    """Return a field that is a single whole number."""
    numbers = wholes(node.fields[word])
    if len(numbers) != 1:
        raise ModelError(f"node '{node.name}': {word} = {as_text(node.fields[word])}: expected a whole number")
    return numbers[0]


def wholes(value: Any) -> list[int]:
    """Return a list of whole numbers; an empty list if a number is not whole or not below 2^40."""
    array = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if array.ndim > 1 or not np.all(np.abs(array) < _HUGE) or np.any(array != np.rint(array)):
        return []
    return [int(n) for n in array]


def as_text(value: Any) -> str:
    """Return a field as text for messages, 60 characters at most."""
    return f"{np.asarray(value).tolist()!r:.60}"


def _unfit(node: Node, shape: Shape, expected: str) -> ModelError:
    return ModelError(f"node '{node.name}' ({node.kind}) with {expected} receives the shape {list(shape)}")


def _pair(node: Node, value: Any, word: str, least: int) -> Pair:
    """Return the numbers of a field for rows and columns.

    A Conv1d has one number, for columns. Its number for rows is 0 for the padding, else 1. Example: the stride 3 of a
    Conv1d is (1, 3).
    """
    numbers = wholes(value)
    number_for_rows = 0 if word == "padding" else 1
    pair = (
        (number_for_rows, *numbers) if node.kind == "Conv1d" else tuple(numbers * 2 if len(numbers) == 1 else numbers)
    )
    if len(pair) != 2 or min(pair) < least:
        raise ModelError(f"node '{node.name}': {word} = {as_text(value)}: expected whole numbers >= {least}")
    return pair[0], pair[1]


def _extent(node: Node, weight: NDArray[Any] | None) -> tuple[Pair, Pair, Pair, Pair, Pair]:
    """Return kernel size, dilation, stride, and the borders before and after, each for rows and columns."""
    if weight is None:
        kernel, dilation = _pair(node, node.fields["kernel_size"], "kernel_size", 1), (1, 1)
    else:
        kernel = (1, weight.shape[-1]) if node.kind == "Conv1d" else (weight.shape[-2], weight.shape[-1])
        dilation = _pair(node, node.fields["dilation"], "dilation", 1)
    stride = _pair(node, node.fields["stride"], "stride", 1)
    padding = node.fields["padding"]
    if isinstance(padding, (str, bytes)) or np.asarray(padding).dtype.kind in "SU":
        word = str(np.asarray(padding).astype(str).reshape(-1)[0])
        if word not in ("same", "valid") or (word == "same" and stride != (1, 1)):
            raise ModelError(
                f"node '{node.name}': padding '{word}': expected numbers, 'valid', or 'same' with stride 1"
            )
        total = [d * (k - 1) if word == "same" else 0 for d, k in zip(dilation, kernel, strict=True)]
        begin = (total[0] // 2, total[1] // 2)
        end = (total[0] - begin[0], total[1] - begin[1])
    else:
        begin = end = _pair(node, padding, "padding", 0)
    return kernel, dilation, stride, begin, end


def _sliding_output_shape(node: Node, shape: Shape, weight: NDArray[Any] | None) -> Shape:
    """Return the output shape of a convolution, or of a pool, which has no weight."""
    axes = 2 if node.kind == "Conv1d" else 3
    if len(shape) != axes or (weight is not None and weight.ndim != axes + 1):
        raise _unfit(node, shape, f"a kernel of {'one axis' if axes == 2 else 'two axes'}")
    maps = shape[0]
    if weight is not None:
        groups = _groups(node)
        maps = weight.shape[0]
        if weight.shape[1] * groups != shape[0] or maps % groups:
            raise _unfit(node, shape, f"weights of shape {list(weight.shape)} in {groups} groups")
    kernel, dilation, stride, begin, end = _extent(node, weight)
    _, *lengths = sheet(shape)
    sizes = []
    for n, k, d, s, b, a in zip(lengths, kernel, dilation, stride, begin, end, strict=True):
        extent = d * (k - 1) + 1
        if n + b + a < extent:
            raise _unfit(node, shape, f"a kernel of {extent} lines")
        sizes.append((n + b + a - extent) // s + 1)
    return (maps, sizes[1]) if axes == 2 else (maps, *sizes)


def _groups(node: Node) -> int:
    groups = _whole(node, "groups")
    if groups < 1:
        raise ModelError(f"node '{node.name}': groups = {groups}: expected at least 1")
    return groups


def map_of(node: Node, source: Shape) -> Map:
    """Return the linear map of a node without its bias, for an input of the shape `source`.

    The map of a node without weights, such as Flatten, is the identity.

    Raises:
        ModelError: a field does not fit the shape.
    """
    from scipy.sparse import csr_array, eye_array, kron

    target = output_shape(node, source)
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
            factor = 1.0 / math.prod(size) if node.kind == "AvgPool2d" else 1.0
            return Map(
                source, target, kernel=Kernel(np.full((source[0], 1, *size), factor), stride, padding, depthwise=True)
            )
    return Map(source, target, diagonal=np.ones(target))


def _kernel(node: Node, source: Shape) -> Kernel:
    weight = spread(node.fields["weight"], np.shape(node.fields["weight"]), f"node '{node.name}': weight")
    if node.kind == "Conv1d":
        weight = weight[:, :, None, :]
    _, (dy, dx), stride, before, _ = _extent(node, np.asarray(node.fields["weight"]))
    if (dy, dx) != (1, 1):  # a dilated kernel is a larger kernel with zeros, e.g. [a, b] dilated by 2 is [a, 0, b]
        dilated = np.zeros((*weight.shape[:2], dy * (weight.shape[2] - 1) + 1, dx * (weight.shape[3] - 1) + 1))
        dilated[:, :, ::dy, ::dx] = weight
        weight = dilated
    groups, depthwise = _groups(node), False
    if groups > 1:
        depthwise = weight.shape[1] == 1
        if not depthwise:  # `grid` has no groups, so channels of other groups get weights of 0
            maps, depth = weight.shape[:2]
            dense = np.zeros((maps, source[0], *weight.shape[2:]))
            for m in range(maps):
                first = m // (maps // groups) * depth
                dense[m, first : first + depth] = weight[m]
            weight = dense
    return Kernel(weight, stride, before, depthwise)


def compose(maps: Sequence[Map]) -> Map:
    """Return the product of consecutive maps: diagonal or a convolution where possible, else a matrix."""
    return reduce(_compose_two, maps)


def _compose_two(first: Map, second: Map) -> Map:
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
        pooled = _compose_pool(first, second)
        if pooled is not None:
            return Map(first.source, second.target, kernel=pooled)
    return Map(first.source, second.target, matrix=(second.sparse() @ first.sparse()).tocsr())


def same_in_each_map(values: Floats) -> Floats | None:
    """Return the value of each map from values of shape (maps, ...), or None if values differ within a map."""
    rows = values.reshape(values.shape[0], -1)
    return rows[:, 0].copy() if np.all(rows == rows[:, :1]) else None


def _compose_pool(first: Map, second: Map) -> Kernel | None:
    """Return the product of a pool and a convolution as one convolution.

    A pool of 2 x 2 without overlap before a 3 x 3 kernel of stride 1 is a 6 x 6 kernel of stride 2. Returns None if the
    first map is not such a pool.
    """
    pool, kernel = first.kernel, second.kernel
    assert pool is not None and kernel is not None  # noqa: PT018
    channels, height, width = sheet(first.source)
    _, rows, columns = sheet(first.target)
    size = pool.weight.shape[2:]
    is_per_channel = pool.depthwise and pool.weight.shape[0] == channels
    is_tiling = (
        (rows * size[0], columns * size[1]) == (height, width) and size == pool.stride and pool.padding == (0, 0)
    )
    if not (is_per_channel and is_tiling and np.all(pool.weight == pool.weight.flat[0])):
        return None
    weight = np.repeat(np.repeat(kernel.weight * pool.weight.flat[0], size[0], axis=2), size[1], axis=3)
    stride = kernel.stride[0] * size[0], kernel.stride[1] * size[1]
    padding = kernel.padding[0] * size[0], kernel.padding[1] * size[1]
    return Kernel(weight, stride, padding, kernel.depthwise)


def _convolution_matrix(part: Map) -> Any:
    from scipy.sparse import csr_array

    kernel = part.kernel
    assert kernel is not None
    (channels, height, width), (maps, rows, columns) = sheet(part.source), sheet(part.target)
    m, r, c, k, i, j = np.indices((maps, rows, columns, *kernel.weight.shape[1:])).reshape(6, -1)
    y, x = r * kernel.stride[0] + i - kernel.padding[0], c * kernel.stride[1] + j - kernel.padding[1]
    is_inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    channel = k + m // (maps // channels) if kernel.depthwise else k
    source = ((channel * height + y) * width + x)[is_inside]
    target = ((m * rows + r) * columns + c)[is_inside]
    weights = kernel.weight[m[is_inside], k[is_inside], i[is_inside], j[is_inside]]
    return csr_array((weights, (target, source)), shape=(math.prod(part.target), math.prod(part.source)))
