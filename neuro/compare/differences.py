"""Differences of spikes and weights between two runs, and of weights between a network and a chip's integers.

The distance between spike trains is that of Victor and Purpura (J. Neurophysiol. 76:1310, 1996), computed by the
library `elephant`: the smallest cost of turning one train into the other. Adding or removing a spike costs 1, and
moving a spike by dt costs dt / `COST_MS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from neuro.chips.fixed_program import FixedProgram
from neuro.model.neurons import Neuron
from neuro.pages.histograms import Histogram, histogram
from neuro.pages.raster import evenly
from neuro.program.program import Floats, Ints, Program, Projection

COST_MS = 10.0
"""Shift of a spike in ms with the cost of a removal. Pairs closer than twice this shift are moved."""

MOST_NEURONS = 100
MOST_SPIKES = 2000
MOST_PAIRS = 20_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSpikes:
    """Spikes of one population, by time, then neuron. Several spikes of a neuron in a step are several entries.

    Attributes:
        size: number of neurons.
        times_ms: time of each spike in ms.
        steps: step of each spike.
        ids: neuron of each spike.
    """

    size: int
    times_ms: Floats
    steps: Ints
    ids: Ints


@dataclass(frozen=True, slots=True)
class Divergence:
    """First spike that is missing in one of two runs.

    Attributes:
        ms: time of the spike.
        neuron: neuron of the spike.
        only_in_first: True if the first run has the spike, False if the other run has it.
    """

    ms: float
    neuron: int
    only_in_first: bool


@dataclass(frozen=True, slots=True)
class Distance:
    """Victor and Purpura's distance between two runs of a population.

    Attributes:
        edits: cost of the distance, summed over all measured neurons.
        spikes: number of spikes of these neurons in both runs together.
        per_spike: edits / spikes: 0 for equal runs, 1 if no spike has a partner.
        neurons: number of measured neurons, evenly chosen if the population has more.
        until_ms: end of the measured time; the end of the run, or earlier if the run has too many spikes.
    """

    edits: float
    spikes: int
    per_spike: float
    neurons: int
    until_ms: float


def divergence(first: ComparedSpikes, other: ComparedSpikes) -> Divergence | None:
    """Return the earliest difference, at a tie of the smallest id; None if both runs have the same spikes."""
    size = max(first.size, 1)
    a, b = np.sort(first.steps * size + first.ids), np.sort(other.steps * size + other.ids)
    n = min(a.size, b.size)
    unequal = np.flatnonzero(a[:n] != b[:n])
    if unequal.size:
        index = int(unequal[0])
        is_in_first = bool(a[index] < b[index])
    elif a.size != b.size:
        index, is_in_first = n, a.size > b.size
    else:
        return None
    key = int((a if is_in_first else b)[index])
    owner = first if is_in_first else other
    time = float(owner.times_ms[np.searchsorted(owner.steps, key // size)])
    return Divergence(time, key % size, is_in_first)


def same_steps(first: ComparedSpikes, other: ComparedSpikes) -> bool:
    """Return True if the same neurons spike in the same steps. The number of spikes in a step does not matter."""
    size = max(first.size, 1)
    a, b = np.unique(first.steps * size + first.ids), np.unique(other.steps * size + other.ids)
    return bool(np.array_equal(a, b))


def distance(first: ComparedSpikes, other: ComparedSpikes, duration_ms: float) -> Distance | None:
    """Return the distance of two runs, or None without the library `elephant`.

    At most `MOST_NEURONS` neurons are measured, and at most `MOST_SPIKES` spikes of each.
    """
    library = _library()
    if library is None:
        return None
    busiest = max(_busiest(first), _busiest(other), 1)
    length = min(busiest, MOST_SPIKES)
    chosen = evenly(first.size, max(1, min(MOST_NEURONS, MOST_PAIRS // length**2)))
    pairs = list(zip(_trains_of(first, chosen), _trains_of(other, chosen), strict=True))
    ends = [float(train[MOST_SPIKES]) for pair in pairs for train in pair if train.size > MOST_SPIKES]
    until = min(ends, default=duration_ms)
    edits, spikes = 0.0, 0
    for pair in pairs:
        a, b = (train if until == duration_ms else train[train < until] for train in pair)
        spikes += a.size + b.size
        if not np.array_equal(a, b):
            edits += _edits(library, a, b, until)
    return Distance(edits, spikes, edits / spikes if spikes else 0.0, chosen.size, until)


def _busiest(train: ComparedSpikes) -> int:
    return int(np.bincount(train.ids, minlength=1).max())


def _trains_of(train: ComparedSpikes, chosen: Ints) -> list[Floats]:
    """Return the spike times of each chosen neuron."""
    order = np.argsort(train.ids, kind="stable")
    ids, times = train.ids[order], train.times_ms[order]
    begin, end = np.searchsorted(ids, chosen), np.searchsorted(ids, chosen, side="right")
    return [times[i:j] for i, j in zip(begin, end, strict=True)]


def _edits(library: tuple[Any, Any, Any], a: Floats, b: Floats, until: float) -> float:
    metrics, neo, quantities = library
    trains = [neo.SpikeTrain(times, t_stop=until, units="ms") for times in (a, b)]
    cost = 1.0 / (COST_MS * quantities.ms)
    return float(metrics.victor_purpura_distance(trains, cost_factor=cost, sort=False)[0, 1])


@cache
def _library() -> tuple[Any, Any, Any] | None:
    try:
        return import_module("elephant.spike_train_dissimilarity"), import_module("neo"), import_module("quantities")
    except ImportError:
        return None


_LAST_BITS = 1e-12


@dataclass(frozen=True, slots=True)
class WeightDifference:
    """Difference of the weights of one projection between two runs.

    Attributes:
        largest: largest absolute difference of a weight.
        rms: root of the mean squared difference.
        relative: `rms` divided by the root of the mean squared weight of the first run; 0 if these weights are 0.
    """

    largest: float
    rms: float
    relative: float


def difference(first: Floats, other: Floats) -> WeightDifference:
    """Return the difference between the weights of two runs, with 0 for differences in the last bits of doubles."""
    if first.size == 0:
        return WeightDifference(0.0, 0.0, 0.0)
    changes = other - first
    largest, size = float(np.abs(changes).max()), float(np.sqrt(np.mean(first**2)))
    if largest <= _LAST_BITS * size:
        return WeightDifference(0.0, 0.0, 0.0)
    rms = float(np.sqrt(np.mean(changes**2)))
    return WeightDifference(largest, rms, rms / size if size else 0.0)


def described(part: Projection) -> Floats:
    """Return the weights of a projection as described, one for each synapse."""
    return np.broadcast_to(part.weight, (part.size,))


def rounded(fixed: FixedProgram, index: int) -> Floats | None:
    """Return the weights of a projection in a chip's integers; None for a projection that carries a current."""
    part = fixed.projections[index]
    if part is None:
        return None
    return np.broadcast_to(part.acting(part.words), (fixed.program.projections[index].size,))


def rounding(fixed: FixedProgram) -> dict[str, WeightDifference]:
    """Return the rounding errors of the weights of each projection, by name."""
    by_name = {}
    for index, part in enumerate(fixed.program.projections):
        after = rounded(fixed, index)
        if after is not None:
            by_name[part.name] = difference(described(part), after)
    return by_name


def histograms(program: Program, chips: Mapping[str, FixedProgram]) -> tuple[Histogram, ...]:
    """Return histograms of the weights of each projection, as described and on each chip.

    Args:
        program: program of the first backend.
        chips: the program in the integers of each chip, by name.
    """
    by_projection = []
    for index, part in enumerate(program.projections):
        on_chips = {name: rounded(fixed, index) for name, fixed in chips.items()}
        weights = {"described": described(part)} | {name: w for name, w in on_chips.items() if w is not None}
        by_projection.append(_histogram(program, part, weights, _grain(chips, index)))
    return tuple(part for part in by_projection if part.synapses)


def learnt(program: Program, final: Mapping[str, Mapping[str, Floats]]) -> tuple[Histogram, ...]:
    """Return histograms of the final weights of each projection that learns, on each backend.

    Args:
        program: program of the first backend.
        final: weights by backend and projection.
    """
    parts = [part for part in program.projections if part.synapse.learns and part.size]
    return tuple(_histogram(program, part, {name: w[part.name] for name, w in final.items()}, 0.0) for part in parts)


def _histogram(program: Program, part: Projection, weights: Mapping[str, Floats], grain: float) -> Histogram:
    return histogram(part.name, unit(program, part), weights, grain)


def _grain(chips: Mapping[str, FixedProgram], index: int) -> float:
    """Return the largest step between two weights of a chip; 0 without a chip."""
    parts = (fixed.projections[index] for fixed in chips.values())
    return max((float(max(p.step.max(), p.step_below.max())) * p.grain for p in parts if p is not None), default=0.0)


def unit(program: Program, part: Projection) -> str:
    """Return the unit of a projection's weights, e.g. "pA": the unit of the receptor of the target neurons."""
    model = program.populations[part.target].model
    if model.chip or part.carries == "current":
        return ""
    states = {state.name: state.unit for state in model.states}
    names = model.named_receptors() if isinstance(model, Neuron) else ()
    receptor = part.receptor.name if part.receptor else next(iter(names), "ex")
    moved = (receptor, f"g_{receptor}", f"I_syn_{receptor}", "V_m")
    return next((states[name] for name in moved if name in states), "")
