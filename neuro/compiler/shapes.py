"""Shapes of populations, with `auto` computed from grids, and the neurons at the ends of projections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from neuro.model.network import Network
from neuro.model.parts import AUTO, Projection, refuse
from neuro.model.rules import grid
from neuro.model.views import View
from neuro.program.program import Grid, Ints

Shape = tuple[int, ...]


def resolve_shapes(net: Network, resolved: Mapping[str, Shape]) -> dict[str, Shape]:
    """Return the shape of every population. Each `auto` is computed along chains of grids.

    Args:
        net: the network.
        resolved: shapes that are known already, by population.

    Raises:
        ModelError: an `auto` has no grid projection that determines it.
    """
    shapes: dict[str, Shape] = dict(resolved)
    for name in net.populations:
        _shape(net, name, shapes, ())
    return shapes


def size(shape: Shape) -> int:
    """Return the number of neurons of a shape."""
    return math.prod(shape)


def grid_of(part: Projection, shapes: Mapping[str, Shape]) -> Grid:
    """Return the sizes of a grid projection.

    Raises:
        ModelError: the kernel does not fit, or the target's shape does not match the grid.
    """
    channels, height, width = _source_shape(part, shapes[part.source])
    rows, columns = _output_size(part, height, width)
    target = shapes[part.target]
    rule = part.rule
    assert isinstance(rule, grid)
    if len(target) != 3 or target[1:] != (rows, columns):
        text = f"grid onto '{part.target}' of shape {list(target)}: expected [maps, {rows}, {columns}]"
        refuse(part, text, f"give '{part.target}' the shape [maps, auto, auto], and its grids one size", "grid")
    if rule.depthwise and target[0] % channels:
        text = f"depthwise grid from {channels} channels onto {target[0]} maps of '{part.target}'"
        refuse(part, f"{text}: expected a multiple of {channels}", word="rule")
    return Grid(
        channels=channels,
        height=height,
        width=width,
        maps=target[0],
        rows=rows,
        columns=columns,
        kernel_height=rule.kernel[0],
        kernel_width=rule.kernel[1],
        stride=rule.stride,
        top=_padding_before(rule, 0, height),
        left=_padding_before(rule, 1, width),
        depthwise=rule.depthwise,
        mean=rule.changes == "mean",
    )


def _padding_before(rule: grid, axis: int, length: int) -> int:
    """Return the lines of padding before the source."""
    if rule.border is not None:
        return rule.border[axis]
    return max(0, (math.ceil(length / rule.stride) - 1) * rule.stride + rule.kernel[axis] - length) // 2


def _shape(net: Network, name: str, shapes: dict[str, Shape], pending: tuple[str, ...]) -> Shape:
    if name in shapes:
        return shapes[name]
    part = net.populations[name]
    if AUTO not in part.shape:
        shapes[name] = tuple(int(s) for s in part.shape)
        return shapes[name]
    label = f"shape {list(part.shape)}"
    if name in pending:
        refuse(part, f"{label}: its grids form a cycle: expected numbers in one of its shapes", word="shape")
    # The first grid decides; `grid_of` then refuses grids with another size.
    deciding = [p for p in net.projections.values() if p.target == name and isinstance(p.rule, grid)]
    if not deciding:
        refuse(part, f"{label}: 'auto' needs a grid projection onto it, found none", "write the numbers", "shape")
    if len(part.shape) != 3 or part.shape[0] == AUTO:
        refuse(part, f"{label}: expected [maps, auto, auto] with a number of maps", word="shape")
    source = _shape(net, deciding[0].source, shapes, (*pending, name))
    _, height, width = _source_shape(deciding[0], source)
    sizes = _output_size(deciding[0], height, width)
    declared = part.shape[1:]
    shapes[name] = (int(part.shape[0]), *(n if w == AUTO else int(w) for n, w in zip(sizes, declared, strict=True)))
    return shapes[name]


def _source_shape(part: Projection, source: Shape) -> Shape:
    if len(source) == 2:
        return (1, *source)
    if len(source) != 3:
        text = f"grid from '{part.source}' of shape {list(source)}"
        refuse(part, f"{text}: expected [height, width] or [channels, height, width]", word="grid")
    return source


def _output_size(part: Projection, height: int, width: int) -> tuple[int, int]:
    rule = part.rule
    assert isinstance(rule, grid)
    if rule.border is None:
        return math.ceil(height / rule.stride), math.ceil(width / rule.stride)
    high, wide = (n + 2 * b for n, b in zip((height, width), rule.border, strict=True))
    if rule.kernel[0] > high or rule.kernel[1] > wide:
        text = f"grid.kernel = {list(rule.kernel)}: expected at most [{high}, {wide}], the size of '{part.source}'"
        hint = "use a smaller kernel or more padding"
        refuse(part, f"{text} with its padding", hint, "grid.kernel", about=("padding",))
    return (high - rule.kernel[0]) // rule.stride + 1, (wide - rule.kernel[1]) // rule.stride + 1


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """Neurons of a population at one end of a projection.

    Attributes:
        shape: sizes of the axes.
        ids: the neurons in the population, None for all of them in order.
        size: size of the population.
    """

    shape: Shape
    ids: Ints | None
    size: int

    @property
    def neurons(self) -> Ints:
        """The ids of the neurons, also for a whole population."""
        return np.arange(self.size) if self.ids is None else self.ids

    @property
    def ascends(self) -> bool:
        """True if the neurons are in the order of the population."""
        return self.ids is None or bool(np.all(self.ids[1:] > self.ids[:-1]))


def end_of(view: View | None, shape: Shape) -> End:
    """Return the neurons of a view, or of a whole population of a shape.

    Raises:
        ModelError: the view has neurons beyond the shape.
    """
    n = size(shape)
    if view is None:
        return End(shape, None, n)
    ids, sizes = view.within(shape)
    is_whole = ids.size == n and bool(np.array_equal(ids, np.arange(n)))
    return End(sizes, None if is_whole else ids, n)


def own_places(source: End, target: End) -> Ints:
    """Return the index of each source neuron in the target, else -1. Both ends are of the same population."""
    target_index = np.full(source.size, -1, dtype=np.int64)
    target_index[target.neurons] = np.arange(size(target.shape))
    places_of_source: Ints = target_index[source.neurons]
    return places_of_source
