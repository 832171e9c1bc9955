"""A run as tables that people read, the same of a simulation and of its results."""

from __future__ import annotations

from collections.abc import Iterable

from neuro.core.tables import Table


def run_table(duration_ms: float, populations: Iterable[tuple[str, str, int, int | None]]) -> Table:
    """A row for each population.

    Args:
        duration_ms: how long it ran; without a time there are no rates.
        populations: of each its name, model, neurons and spikes, None of those that emit a current.
    """
    rows = []
    for name, model, neurons, spikes in populations:
        rows.append((name, model, f"{neurons:,}", *told_spikes(spikes, neurons, duration_ms)))
    return Table("populations", ("name", "model", ">neurons", ">spikes", ">rate (Hz)"), tuple(rows))


def told_spikes(spikes: int | None, neurons: int, duration_ms: float) -> tuple[str, str]:
    """Spikes and the mean rate of a neuron in Hz as text; a dash where there can be none."""
    if spikes is None:
        return "-", "-"
    return f"{spikes:,}", f"{spikes / neurons / duration_ms * 1000.0:.2f}" if neurons and duration_ms else "-"


def projection_table(projections: Iterable[tuple[str, str, str, str, int]]) -> Table:
    """A row for each projection: its name, source, target, synapse and number of synapses."""
    rows = tuple((*words, f"{synapses:,}") for *words, synapses in projections)
    return Table("projections", ("name", "from", "to", "synapse", ">synapses"), rows)
