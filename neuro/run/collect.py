"""From a simulation that has run to its `Results`."""

from __future__ import annotations

import platform
import tempfile
from collections.abc import Collection
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import numpy as np

from neuro.core.version import VERSION
from neuro.files.results import YAML, Results, Trace, Train, Weights
from neuro.model.language import save
from neuro.model.network import Network
from neuro.program.program import Population, Projection
from neuro.run.simulation import Simulation

SMALL = 1_000_000


def collect(
    sim: Simulation, net: Network, *, threads: int = 1, record: Collection[str] = (), all_weights: bool = False
) -> Results:
    """Gather everything worth keeping.

    Args:
        sim: a simulation that has run.
        net: the network it was made of.
        threads: that it ran on.
        record: the populations whose spikes to keep; all that were recorded if empty.
        all_weights: keep also the weights of static projections above a million synapses, which follow from
            network and seed.
    """
    program, counts = sim.program, sim.counts()
    about = {
        "network": program.name,
        "backend": sim.backend,
        "seed": program.seed,
        "threads": threads,
        "duration_ms": sim.time,
        "resolution_ms": program.resolution,
        "neuro": VERSION,
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "numba")},
    }
    totals = ("steps", "spikes", "neuron_updates", "neuron_updates_active", "synaptic_ops", "learning_updates")
    about |= {f"counts.{name}": getattr(counts, name) for name in totals}
    keep = record or [part.name for part in program.populations]
    return Results(
        about,
        files_of(net),
        {p.name: _train(sim, p, p.name in keep, asdict(counts.populations[p.name])) for p in program.populations},
        {p.name: _weights(sim, p, all_weights, asdict(counts.projections[p.name])) for p in program.projections},
        _traces(sim),
    )


def files_of(net: Network) -> dict[str, bytes]:
    """The files that `net.save` writes, by name; recordings are named, not kept."""
    with tempfile.TemporaryDirectory() as folder:
        save(net, Path(folder) / YAML, anywhere=True)
        return {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}


def _train(sim: Simulation, part: Population, kept: bool, counts: dict[str, int]) -> Train:
    recorded = kept and part.records
    times, ids = sim.spikes(part.name) if recorded else (np.zeros(0), np.zeros(0, np.int64))
    first = np.ones(times.size, bool)
    first[1:] = (times[1:] != times[:-1]) | (ids[1:] != ids[:-1])
    at = np.flatnonzero(first)
    multiplicity = np.diff(at, append=times.size).astype(np.int32)
    return Train(part.model.name, part.shape, counts, recorded, times[at], ids[at], multiplicity)


def _weights(sim: Simulation, part: Projection, every: bool, counts: dict[str, int]) -> Weights:
    names = [population.name for population in sim.program.populations]
    about = (names[part.source], names[part.target], part.synapse.name, part.size, counts)
    if not (every or part.synapse.learns or part.size <= SMALL):
        return Weights(*about)
    if part.grid is not None:
        return Weights(*about, weight=sim.weights(part.name))
    delay = sim.get(part.name, "delay") if part.synapse.delays else None
    pre, post, weight = sim.weights(part.name)
    return Weights(*about, pre, post, weight, delay)


def _traces(sim: Simulation) -> dict[str, Trace]:
    traces = {}
    for probe in sim.program.probes:
        if probe.record != "spikes":
            population = sim.program.populations[probe.population]
            unit = next((s.unit for s in population.model.states if s.name == probe.record), "")
            traces[probe.name] = Trace(population.name, probe.record, unit, *sim.trace(probe.name))
    return traces
