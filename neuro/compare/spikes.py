"""How spikes of one population differ between two runs: the first difference, and a distance of spike trains.

The distance is that of Victor and Purpura (J. Neurophysiol. 76:1310, 1996) as the library `elephant` computes it: the
least cost of turning one train into the other, where adding or removing a spike costs 1 and moving it by dt costs
dt / `COST_MS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from neuro.pages.raster import evenly
from neuro.program.program import Floats, Ints

COST_MS = 10.0
"""Moving a spike so far costs as much as removing it; pairs closer than twice this are moved."""

MOST_NEURONS = 100
MOST_SPIKES = 2000
MOST_PAIRS = 20_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSpikes:
    """Spikes of one population, by time, then neuron; several of one neuron in one step are listed as often.

    Attributes:
        size: its number of neurons.
        times_ms: when.
        steps: the same in steps.
        ids: which neuron.
    """

    size: int
    times_ms: Floats
    steps: Ints
    ids: Ints


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first spike that only one of two runs has.

    Attributes:
        ms: its time.
        neuron: whose it is.
        only_in_first: whether the first run has it, or the other.
    """

    ms: float
    neuron: int
    only_in_first: bool


@dataclass(frozen=True, slots=True)
class Distance:
    """Victor and Purpura's distance between two runs of a population.

    Attributes:
        edits: cost of all neurons measured.
        spikes: of these neurons in both runs together.
        per_spike: edits / spikes: 0 where the runs are equal, 1 where no spike has a partner.
        neurons: how many were measured, an even choice where the population has more.
        until_ms: spikes up to this time were measured, all of the run if these are not too many.
    """

    edits: float
    spikes: int
    per_spike: float
    neurons: int
    until_ms: float


def divergence(first: ComparedSpikes, other: ComparedSpikes) -> Divergence | None:
    """The earliest difference, of the smallest neuron; None where both runs have the same spikes."""
    size = max(first.size, 1)
    a, b = np.sort(first.steps * size + first.ids), np.sort(other.steps * size + other.ids)
    n = min(a.size, b.size)
    unequal = np.flatnonzero(a[:n] != b[:n])
    if unequal.size:
        at = int(unequal[0])
        mine = bool(a[at] < b[at])
    elif a.size != b.size:
        at, mine = n, a.size > b.size
    else:
        return None
    key = int((a if mine else b)[at])
    owner = first if mine else other
    time = float(owner.times_ms[np.searchsorted(owner.steps, key // size)])
    return Divergence(time, key % size, mine)


def same_steps(first: ComparedSpikes, other: ComparedSpikes) -> bool:
    """Whether the same neurons spike in the same steps, however often in each."""
    size = max(first.size, 1)
    a, b = np.unique(first.steps * size + first.ids), np.unique(other.steps * size + other.ids)
    return bool(np.array_equal(a, b))


def distance(first: ComparedSpikes, other: ComparedSpikes, duration_ms: float) -> Distance | None:
    """The distance of two runs; None without the library.

    At most `MOST_NEURONS` neurons are measured, and at most `MOST_SPIKES` spikes of each.
    """
    library = _library()
    if library is None:
        return None
    busiest = max(_busiest(first), _busiest(other), 1)
    length = min(busiest, MOST_SPIKES)
    chosen = evenly(first.size, max(1, min(MOST_NEURONS, MOST_PAIRS // length**2)))
    pairs = list(zip(_each(first, chosen), _each(other, chosen), strict=True))
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


def _each(train: ComparedSpikes, chosen: Ints) -> list[Floats]:
    """Times of the spikes of each chosen neuron."""
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
