"""From what a run left behind to its bill: the counts of each neuron, and what a chip would take for them."""

from __future__ import annotations

from os import PathLike

import numpy as np

from neuro.chips.pricing.bill import bill
from neuro.chips.pricing.energy import Energy
from neuro.core.errors import ModelError
from neuro.files.parts import Train
from neuro.files.resolved import resolved
from neuro.files.results import Results
from neuro.model.network import Network
from neuro.program.backend import EngineCounts
from neuro.program.program import Ints, Population
from neuro.run.compiled import compile

MOST_DRAWS = 1_000_000_000
"""Neurons x steps of a generator that are drawn once more for a bill."""


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
        ModelError: the target has no costs, the network does not fit on it, or spikes that the bill needs were neither
            kept nor follow from the seed.
    """
    program = resolved(results, net)
    spikes, events = [], []
    for part in program.populations:
        train = results.populations[part.name]
        found = _kept(train) if train.recorded or not train.counts["spikes"] else _drawn(results, net, part)
        if int(found[0].sum()) != train.counts["spikes"]:
            raise ModelError(
                f"the spikes of '{part.name}' are not all in the file, and do not follow from its seed",
                hint="neuro energy runs the network once more",
            )
        spikes.append(found[0])
        events.append(found[1])
    updates = [results.projections[part.name].counts["learning_updates"] for part in program.projections]
    by_trials = [part.synapse.learns == "trials" for part in program.projections]
    active = [results.populations[part.name].counts["neuron_updates_active"] for part in program.populations]
    counts = EngineCounts(
        steps=int(results.about["counts.steps"]),
        events=tuple(events),
        spikes=tuple(spikes),
        active=np.array(active, np.int64),
        trial_updates=np.array([n * taught for n, taught in zip(updates, by_trials, strict=True)], np.int64),
    )
    return bill(program, counts, target, step_s=step_s, chips=chips)


def _kept(train: Train) -> tuple[Ints, Ints]:
    """Spikes of each neuron, and its steps with spikes."""
    events = np.bincount(train.ids, minlength=train.size)
    spikes = np.bincount(train.ids, weights=train.multiplicity, minlength=train.size)
    return spikes.astype(np.int64), events.astype(np.int64)


def _drawn(results: Results, net: Network, part: Population) -> tuple[Ints, Ints]:
    """The same of a Poisson generator whose spikes were not kept: they follow from the seed and its name alone."""
    steps = int(results.about["counts.steps"])
    if part.kind != "poisson" or part.size * steps > MOST_DRAWS:
        raise ModelError(
            f"the spikes of '{part.name}' were not kept", hint=f"neuro run --record {part.name}, or neuro energy"
        )
    alone = Network(net.name, resolution=net.resolution)
    alone.populations[part.name] = net.populations[part.name]
    sim = compile(alone, seed=int(results.about["seed"]))
    sim.run(results.duration_ms)
    counts = sim._engine.counts()
    return counts.spikes[0], counts.events[0]
