"""Cases of trials whose values are exact in floats and in integers."""

from __future__ import annotations

from typing import Any

from neuro.model.network import Network
from neuro.model.neurons import spike_generator
from neuro.model.parts import winner_take_all
from neuro.model.rules import all_to_all, grid
from neuro.model.synapses import Synapse, r_stdp, static
from neuro.testing.case import Found, Start, case, integers_too, network, observe
from neuro.testing.exact import cell, whole
from neuro.testing.trials import batch, taught, told


def chooser(synapse: Synapse | None = None, weight: object = None, threshold: float = 9.0, **words: Any) -> Network:
    """Six maps of two labels each over a small sheet, with whole weights; the first to fire decides."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (6, "auto", "auto"), cell(V_th=threshold))
    kernels = whole(-1, 3, (6, 2, 4, 4)) if weight is None else weight
    net.connect("sheet", "maps", grid(kernel=(4, 4)), synapse or static(), weight=kernels, delay=2.0, name="s2")
    net.group("choice", winner_take_all(of="maps"))
    section = {"labels": {"of": "maps", "maps_per_label": 2}, "reset": ["V_m"], "duration": 20.0}
    net.trials(input="sheet", **(section | words))
    return net


@integers_too
@case
def exact_decisions(start: Start) -> Found:
    """Decisions, ties and potentials; a trial ends at its decision."""
    sim = start(chooser())
    times, ids, offsets, _ = batch(20)
    return told(sim.trials(times, ids, offsets)) | observe(sim)


@integers_too
@case
def exact_full_trials(start: Start) -> Found:
    """`stop: full`, some trials silent; a run between two batches."""
    sim = start(chooser(stop="full", threshold=14.0))
    times, ids, offsets, _ = batch(12)
    found = told(sim.trials(times, ids, offsets), "first")
    sim.run(7.0)
    few = sim.trials([3.0, 3.0, 4.0], [0, 40, 7], [0, 2, 2, 3])
    return found | told(few, "silent") | told(sim.trials(times, ids, offsets), "second") | observe(sim)


@integers_too
@case
def exact_run_after_a_decision(start: Start) -> Found:
    """What was left of a trial's input when it was decided is not shown in a run that follows."""
    sim = start(chooser(threshold=2.0))
    times, ids, offsets, _ = batch(4)
    found = told(sim.trials(times, ids, offsets))
    sim.run(25.0)
    return found | observe(sim)


@integers_too
@case
def exact_rewards(start: Start) -> Found:
    """r_stdp at its bounds, where a reward changes no weight: dropout, labels and learning_updates."""
    weight = whole(0, 1, (6, 2, 4, 4))
    net = chooser(r_stdp(epsilon=0.0), weight, 5.0, dropout={"of": "maps", "p": 0.4, "decay": 0.5})
    return taught(start, net)


@integers_too
@case
def exact_rescue(start: Start) -> Found:
    """r_stdp with rescue, at its bounds, with dropout of each trial."""
    weight = whole(0, 1, (6, 2, 4, 4))
    return taught(start, chooser(r_stdp(rescue=True), weight, 7.0, dropout={"of": "maps", "p": 0.5, "every": "trial"}))


@integers_too
@case
def exact_growth(start: Start) -> Found:
    """r_stdp where all weights are at Wmax, so that growth is counted and changes nothing; many ties."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (6, 2), cell(V_th=8.0))
    net.connect("sheet", "maps", all_to_all(), r_stdp(Wmax=2.0), weight=2.0, delay=3.0, name="s2")
    net.group("choice", winner_take_all(of="maps"))
    net.trials(input="sheet", labels={"of": "maps", "maps_per_label": 2}, reset=["V_m"], duration=20.0)
    return taught(start, net)
