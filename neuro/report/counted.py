"""The bill of a run from what its file holds: the counts of each neuron, and what a chip would take for them."""

from __future__ import annotations

from os import PathLike

import numpy as np

from neuro.chips.pricing.energy import Energy
from neuro.chips.pricing.price import bill
from neuro.files.finished_runs import resolved
from neuro.files.results import Results
from neuro.model.network import Network
from neuro.program.backend import EngineCounts


def energy(
    results: Results,
    net: Network,
    target: str | PathLike[str],
    *,
    step_s: float | None = None,
    chips: int | None = None,
) -> Energy:
    """What a run would take on a chip.

    Args:
        results: of the run.
        net: what ran.
        target: as of `neuro.Simulation.energy`.
        step_s: likewise.
        chips: likewise.

    Raises:
        ModelError: the target has no costs, or the network does not fit on it.
    """
    program = resolved(results, net)
    trains = [results.populations[part.name] for part in program.populations]
    updates = [results.projections[part.name].counts["learning_updates"] for part in program.projections]
    by_trials = [part.synapse.learns == "trials" for part in program.projections]
    counts = EngineCounts(
        steps=int(results.about["counts.steps"]),
        events=tuple(np.asarray(train.event_counts) for train in trains),
        spikes=tuple(np.asarray(train.spike_counts) for train in trains),
        active=np.array([train.counts["neuron_updates_active"] for train in trains], np.int64),
        trial_updates=np.array([n * taught for n, taught in zip(updates, by_trials, strict=True)], np.int64),
    )
    return bill(program, counts, target, step_s=step_s, chips=chips)
