"""A run as tables that people read, the same of a simulation and of its results."""

from __future__ import annotations

from collections.abc import Iterable

from neuro.core.tables import Table


def run_table(duration_ms: float, populations: Iterable[tuple[str, str, int, int]]) -> Table:
    """A row for each population.

    Args:
        duration_ms: how long it ran; without a time there are no rates.
        populations: of each its name, model, neurons and spikes.
    """
    rows = []
    for name, model, neurons, spikes in populations:
        hz = f"{spikes / neurons / duration_ms * 1000.0:.2f}" if neurons and duration_ms else "-"
        rows.append((name, model, f"{neurons:,}", f"{spikes:,}", hz))
    return Table("populations", ("name", "model", ">neurons", ">spikes", ">rate (Hz)"), tuple(rows))


def projection_table(projections: Iterable[tuple[str, str, str, str, int]]) -> Table:
    """A row for each projection: its name, source, target, synapse and number of synapses."""
    rows = tuple((*words, f"{synapses:,}") for *words, synapses in projections)
    return Table("projections", ("name", "from", "to", "synapse", ">synapses"), rows)
