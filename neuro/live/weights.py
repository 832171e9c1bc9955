"""The weights of a projection in few numbers: how they are distributed, and between which neurons they lie."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from neuro.program.program import Floats, Projection
from neuro.run.simulation import Simulation

BINS = 48
SIDE = 40
"""Rows and columns of the matrix at most; of more neurons the mean of several."""
MOST_MAPS = 12
LARGEST = 1_000_000
"""Synapses of a projection that is read while the network runs."""
CHOSEN = 50_000
"""Synapses of which histogram and matrix are; of more an even choice."""


def weights_of(sim: Simulation, index: int) -> dict[str, Any]:
    """A histogram and a matrix of the weights of a projection, by its index."""
    part = sim.program.projections[index]
    found: dict[str, Any] = {"projection": part.name, "size": part.size}
    if part.size > LARGEST:
        return found | {"refused": f"{part.size:,} synapses: weights are shown up to {LARGEST:,}"}
    values = sim._engine.get_synapses(index, "weight")
    every = -(-part.size // CHOSEN) or 1
    finite = values[np.isfinite(values)]
    if not finite.size:
        return found | {"refused": "no synapse" if not values.size else "no weight is finite"}
    low, high = float(finite.min()), float(finite.max())
    bins = np.histogram(finite[::every], BINS, (low, high))[0] if high > low else np.array([finite.size])
    with np.errstate(over="ignore"):
        mean = float(finite.mean())
    found |= {"low": low, "high": high, "mean": mean if math.isfinite(mean) else None, "bins": bins.tolist()}
    matrix = _kernels(part, values) if part.grid is not None else _matrix(sim, index, values, every)
    plain = [[None if np.isnan(v) else float(f"{v:.4g}") for v in row] for row in matrix]
    return found | {"matrix": plain, "kernels": part.grid is not None}


def _matrix(sim: Simulation, index: int, values: Floats, every: int) -> Floats:
    """Mean weights of some synapses by blocks of sources, rows, and targets, columns; NaN where there is no synapse."""
    part, populations = sim.program.projections[index], sim.program.populations
    ends = sim._synapses.ends(index)
    sides = [min(SIDE, populations[end].size) for end in (part.source, part.target)]
    blocks = [
        ids[::every] * side // populations[end].size
        for ids, side, end in zip(ends, sides, (part.source, part.target), strict=True)
    ]
    places = blocks[0] * sides[1] + blocks[1]
    room = sides[0] * sides[1]
    count = np.bincount(places, minlength=room)
    total = np.bincount(places, weights=values[::every], minlength=room)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    matrix: Floats = mean.reshape(sides[0], sides[1])
    return matrix


def _kernels(part: Projection, values: Floats) -> Floats:
    """The kernels of some maps beside each other, their channels below each other."""
    assert part.grid is not None
    kernels = values.reshape(part.grid.kernels)[:MOST_MAPS, :4]
    framed = np.pad(kernels, ((0, 0), (0, 0), (0, 1), (0, 1)), constant_values=np.nan)
    maps, channels, height, width = framed.shape
    mosaic: Floats = framed.transpose(1, 2, 0, 3).reshape(channels * height, maps * width)
    return mosaic[:-1, :-1]
