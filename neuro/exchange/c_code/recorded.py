"""A run of the emulator as the data of a test: spikes of inputs and outputs, and digests of all spikes and states.

A digest is the sum of one word a number, a hash of its place and value, modulo 2^64. So two runs with the same digests
in all steps have the same spikes and states, but for a chance of 2^-64 a step.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro.run.compiled
import neuro.run.simulation
from neuro.core.keyed_random import mix
from neuro.exchange.c_code.source import INPUTS, Source
from neuro.model.network import Network
from neuro.model.parts import Projection
from neuro.model.synapses import Synapse, loihi2_static, loihi_static, static
from neuro.program.backend import OverflowWarning
from neuro.program.program import Ints

Given = Mapping[str, Sequence[Ints]]
"""Steps, from 1, neurons, and payloads where it has such, of the spikes that are given to an input, by its name."""

Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A run.

    Attributes:
        steps: of it.
        sent: steps, neurons (of the network) and numbers, multiplicities or payloads, of the spikes of inputs, by step.
        told: the same of outputs.
        spikes, states: the digest of each step, of all spikes of neurons and of all states after it.
    """

    steps: int
    sent: Ints
    told: Ints
    spikes: Words
    states: Words


def record(sim: neuro.run.simulation.Simulation, source: Source, outputs: tuple[str, ...], steps: int) -> Recorded:
    """Run a simulation of a chip from step 0 on, step by step.

    Args:
        sim: with probes of all spikes, see `watched`.
        source: the network as C.
        outputs: whose spikes are output.
        steps: how many.
    """
    digests = np.zeros(steps, dtype=np.uint64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)  # the program in C overflows alike
        for step in range(steps):
            sim.run(sim.program.resolution)
            digests[step] = _digest(sim, source)
    inputs = [part.name for part in sim.program.populations if part.kind in INPUTS]
    neurons = [part.name for part in sim.program.populations if part.kind == "neuron"]
    every = _spikes(sim, source, neurons)
    words = mix(every[1].astype(np.uint64) << np.uint64(32) | (every[2] & 0xFFFFFFFF).astype(np.uint64))
    spikes = np.zeros(steps, dtype=np.uint64)
    np.add.at(spikes, every[0] - 1, words)
    return Recorded(steps, _spikes(sim, source, inputs), _spikes(sim, source, outputs), spikes, digests)


def without_learning(net: Network) -> Network:
    """The network, with the weights that it has and no rule that changes them."""
    other = copy.copy(net)
    other.projections = {name: _frozen(part, net) for name, part in net.projections.items()}
    return other


def _frozen(part: Projection, net: Network) -> Projection:
    if not part.synapse.learns:
        return part
    target = net.populations[part.target].model
    models: dict[str, type[Synapse]] = {"loihi": loihi_static, "loihi2": loihi2_static}
    model = models.get(part.synapse.chip or target.chip, static)
    known = part.synapse.parameters()
    return replace(part, synapse=model(**{word: known[word] for word in model.quantities() if word in known}))


def watched(net: Network) -> Network:
    """The network, with all spikes recorded."""
    other = copy.copy(net)
    other.probes = dict(net.probes)
    for name, part in net.populations.items():
        if part.model.role != "current":
            other.probe(f"{name}.spikes.c", name, "spikes")
    return other


def _digest(sim: neuro.run.simulation.Simulation, source: Source) -> np.uint64:
    values = [sim.get(name, word, raw=True) for name, words in source.states.items() for word in words]
    flat = np.concatenate(values).astype(np.int64) if values else np.zeros(0, dtype=np.int64)
    places = np.arange(flat.size, dtype=np.uint64) << np.uint64(32)
    total: np.uint64 = mix(places | (flat & 0xFFFFFFFF).astype(np.uint64)).sum(dtype=np.uint64)
    return total


def _spikes(sim: neuro.run.simulation.Simulation, source: Source, names: Any) -> Ints:
    """Steps, neurons and numbers of the spikes of some populations, by step, then neuron, shape (3, spikes)."""
    found = [np.zeros((3, 0), dtype=np.int64)]
    for part, first in zip(sim.program.populations, source.firsts, strict=False):
        if part.name in names:
            graded = part.model.graded
            times, ids, numbers = sim.payloads(part.name) if graded else (*sim.spikes(part.name), np.zeros(0))
            steps = np.rint(times / sim.program.resolution).astype(np.int64)
            pairs, counts = np.unique(np.stack([steps, ids + first]), axis=1, return_counts=True)
            found.append(np.vstack([steps, ids + first, numbers] if graded else [pairs, counts]))
    joined = np.concatenate(found, axis=1).astype(np.int64)
    return joined[:, np.lexsort((joined[1], joined[0]))]
