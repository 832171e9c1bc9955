"""How weights differ: between two runs at their end, and by being brought into a chip's integers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from neuro.chips.fixed_program import FixedProgram
from neuro.model.neurons import Neuron
from neuro.pages.histograms import Histogram, histogram
from neuro.program.program import Floats, Program, Projection

_LAST_BITS = 1e-12


@dataclass(frozen=True, slots=True)
class WeightDifference:
    """How far the weights of one projection are from those of another run.

    Attributes:
        largest: largest absolute difference of a weight.
        rms: root of the mean squared difference.
        relative: `rms` divided by the root of the mean squared weight of the first run; 0 where that is 0.
    """

    largest: float
    rms: float
    relative: float


def difference(first: Floats, other: Floats) -> WeightDifference:
    """How far weights are from the first; nothing where only the last bits of a double differ."""
    if first.size == 0:
        return WeightDifference(0.0, 0.0, 0.0)
    lost = other - first
    largest, size = float(np.abs(lost).max()), float(np.sqrt(np.mean(first**2)))
    if largest <= _LAST_BITS * size:
        return WeightDifference(0.0, 0.0, 0.0)
    rms = float(np.sqrt(np.mean(lost**2)))
    return WeightDifference(largest, rms, rms / size if size else 0.0)


def described(part: Projection) -> Floats:
    """The weights of a projection as they are described, one for each synapse."""
    return np.broadcast_to(part.weight, (part.size,))


def rounded(fixed: FixedProgram, index: int) -> Floats | None:
    """The same in a chip's integers; None for a projection that carries a current."""
    part = fixed.projections[index]
    if part is None:
        return None
    return np.broadcast_to(part.acting(part.words), (fixed.program.projections[index].size,))


def rounding(fixed: FixedProgram) -> dict[str, WeightDifference]:
    """What quantising does to the weights of each projection."""
    by_name = {}
    for index, part in enumerate(fixed.program.projections):
        after = rounded(fixed, index)
        if after is not None:
            by_name[part.name] = difference(described(part), after)
    return by_name


def histograms(program: Program, chips: Mapping[str, FixedProgram]) -> tuple[Histogram, ...]:
    """Of each projection: its weights as described and on each chip.

    Args:
        program: the network as the first backend saw it.
        chips: the same in the integers of some chips.
    """
    found = []
    for index, part in enumerate(program.projections):
        on_chips = {name: rounded(fixed, index) for name, fixed in chips.items()}
        weights = {"described": described(part)} | {name: w for name, w in on_chips.items() if w is not None}
        found.append(_histogram(program, part, weights, _grain(chips, index)))
    return tuple(part for part in found if part.synapses)


def learnt(program: Program, final: Mapping[str, Mapping[str, Floats]]) -> tuple[Histogram, ...]:
    """Of each projection that learns: its weights at the end of the run on each backend.

    Args:
        program: the network as the first backend saw it.
        final: weights by backend and projection.
    """
    parts = [part for part in program.projections if part.synapse.learns and part.size]
    return tuple(_histogram(program, part, {name: w[part.name] for name, w in final.items()}, 0.0) for part in parts)


def _histogram(program: Program, part: Projection, weights: Mapping[str, Floats], grain: float) -> Histogram:
    return histogram(part.name, unit(program, part), weights, grain)


def _grain(chips: Mapping[str, FixedProgram], index: int) -> float:
    """The coarsest difference of two weights that a chip can hold; 0 without a chip."""
    parts = (fixed.projections[index] for fixed in chips.values())
    return max((float(max(p.step.max(), p.step_below.max())) * p.grain for p in parts if p is not None), default=0.0)


def unit(program: Program, part: Projection) -> str:
    """The unit of a projection's weights: that of the input its target takes."""
    model = program.populations[part.target].model
    if model.chip or part.carries == "current":
        return ""
    states = {state.name: state.unit for state in model.states}
    names = model.named_receptors() if isinstance(model, Neuron) else ()
    receptor = part.receptor.name if part.receptor else next(iter(names), "ex")
    moved = (receptor, f"g_{receptor}", f"I_syn_{receptor}", "V_m")
    return next((states[name] for name in moved if name in states), "")
