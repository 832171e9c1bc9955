"""Grids of a network as convolutions and pools of NIR."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from neuro.exchange.nir.graph import Floats
from neuro.exchange.nir.importing import LACKS
from neuro.exchange.nir.maps import same_in_each_map
from neuro.exchange.nir.written import Written
from neuro.program.program import Grid, Projection


def find_sheets(out: Written, spiking: Sequence[Projection]) -> None:
    """Find the populations between which a grid is a convolution.

    What reaches neurons otherwise than by a convolution has no axis of channels, so that they are no sheet.
    """
    grids = [p for p in spiking if p.grid is not None]
    out.sheets = {index for p in grids for index in (p.source, p.target)}
    for _ in range(len(out.sheets)):
        out.sheets -= {p.target for p in spiking if p.grid is None or p.source not in out.sheets}
    between = [p for p in grids if on_sheets(out, p)]
    in_rows = [p for p in between if p.grid is not None and _is_line(p.grid) and _pool(out, p) is None]
    out.lines = {index for p in in_rows for index in (p.source, p.target)}
    for _ in range(len(out.lines)):
        others = [p for p in between if p not in in_rows or not {p.source, p.target} <= out.lines]
        out.lines -= {index for p in others for index in (p.source, p.target)}


def on_sheets(out: Written, part: Projection) -> bool:
    """Whether a projection is a convolution in the graph."""
    return part.grid is not None and {part.source, part.target} <= out.sheets


def _is_line(g: Grid) -> bool:
    """Whether both sheets have one row, which one row of the kernel reaches."""
    return g.height == g.rows == 1 and g.top < g.kernel_height


def shape_of(out: Written, index: int) -> tuple[int, ...]:
    """The shape of a population's node: of a sheet with an axis of channels, of other neurons flat."""
    part = out.program.populations[index]
    if index not in out.sheets:
        return (part.size,) if index in out.neurons else part.shape
    channels, rows, columns = part.shape if len(part.shape) == 3 else (1, *part.shape)
    return (channels, columns) if index in out.lines else (channels, rows, columns)


def even(g: Grid) -> bool:
    """Whether the border is as wide after the sheet as before it."""
    rows = (g.height + 2 * g.top - g.kernel_height) // g.stride + 1
    return (g.rows, g.columns) == (rows, (g.width + 2 * g.left - g.kernel_width) // g.stride + 1)


def differing(out: Written, part: Projection, bias: Floats | None) -> str:
    """Name what differs between the neurons of a map, which share the kernel and the bias of a convolution."""
    shape = out.program.populations[part.target].shape
    if same_in_each_map(out.neurons[part.target].factor.reshape(shape)) is None:
        return "the scale of weights"
    return "" if bias is None or same_in_each_map(bias.reshape(shape)) is not None else "the constant current"


def _kernel(out: Written, part: Projection) -> Floats:
    """The weights of a grid in the scale of the tool, (maps, channels / groups, height, width)."""
    assert part.grid is not None
    factor = out.neurons[part.target].factor.reshape(part.grid.maps, -1)[:, 0]
    kernel: Floats = np.broadcast_to(part.weight, part.size).reshape(part.grid.kernels) * factor[:, None, None, None]
    return kernel


def _pool(out: Written, part: Projection) -> tuple[str, Floats] | None:
    """The pool that a grid is, and the factor of each map behind it; None where the tool has none such."""
    g = part.grid
    if g is None or part.target not in out.neurons or not (g.depthwise and g.maps == g.channels and even(g)):
        return None
    factor = same_in_each_map(_kernel(out, part))
    if factor is None:
        return None
    area, lacks = g.kernel_height * g.kernel_width, LACKS.get(out.tool, ())
    kinds = {"SumPool2d": factor, "AvgPool2d": factor * area}
    plain = [kind for kind, left in kinds.items() if kind not in lacks and np.allclose(left, 1.0, rtol=1e-12)]
    if plain and (out.tool == "nir" or not (g.top or g.left)):  # the tools differ in what they do with a padding
        return plain[0], np.ones(g.maps)
    return None if "Scale" in lacks else ("SumPool2d", factor)


def convolution(out: Written, part: Projection, bias: Floats | None) -> tuple[dict[str, Any], str]:
    """The nodes of a grid, and what they are."""
    nir, g = out.nir, part.grid
    assert g is not None
    pool = _pool(out, part) if bias is None else None
    if pool is not None:
        kind, factor = pool
        size, stride = np.array([g.kernel_height, g.kernel_width]), np.array([g.stride, g.stride])
        chain = {part.name: getattr(nir, kind)(size, stride, np.array([g.top, g.left]))}
        if np.any(factor != 1.0):
            scale = np.broadcast_to(factor[:, None, None], (g.maps, g.rows, g.columns)).copy()
            chain[f"{part.name}.scale"] = nir.Scale(scale)
        return chain, kind + (" and Scale" if len(chain) > 1 else "")
    kernel, line = _kernel(out, part), part.source in out.lines
    groups = g.channels if g.depthwise else 1
    bias = np.zeros(g.maps) if bias is None else bias.reshape(g.maps, -1)[:, 0].copy()
    if line:
        padding = g.left if even(g) else "same"
        node = nir.Conv1d(g.width, kernel[:, :, g.top].copy(), g.stride, padding, 1, groups, bias)
    else:
        border = (g.top, g.left) if even(g) else "same"
        node = nir.Conv2d((g.height, g.width), kernel, g.stride, border, 1, groups, bias)
    how = type(node).__name__
    fits = np.array_equal(node.input_type["input"], out.shapes[part.source])
    if not (fits and np.array_equal(node.output_type["output"], out.shapes[part.target])):
        how += "; the package nir works out its shape wrongly: nir.read opens the graph with type_check=False only"
    return {part.name: node}, how
