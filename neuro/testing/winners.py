"""Cases of groups with several winners."""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_delta, poisson_generator, spike_generator
from neuro.model.parts import local_winners
from neuro.model.rules import Rule, all_to_all, grid, one_to_one
from neuro.model.synapses import Synapse, first_spike_stdp, r_stdp, static
from neuro.testing.case import Found, Start, case, integers_too, network, observe
from neuro.testing.exact import cell, whole
from neuro.testing.trials import INF, batch, taught, told


def sheets(group: dict[str, Any], synapse: Synapse | None = None, rule: Rule | None = None, **words: Any) -> Network:
    """Six maps of three rows and columns over a small sheet."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (6, 3, 3), iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=4.0))
    weight = normal(mean=0.5, std=0.1, low=0.0, high=1.0)
    net.connect("sheet", "maps", rule or grid(kernel=(4, 4)), synapse or static(), weight=weight, name="s2")
    net.group("choice", local_winners(of="maps", **group))
    net.trials(input="sheet", duration=20.0, **({"stop": "full"} | words))
    return net


@integers_too
@case
def exact_local_winners(start: Start) -> Found:
    """Each map wins once and silences what is near it; ties are drawn, and a run after the trials keeps the silence."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (6, "auto", "auto"), cell(V_th=9.0))
    net.connect("sheet", "maps", grid(kernel=(4, 4)), weight=whole(-1, 3, (6, 2, 4, 4)), delay=2.0, name="s2")
    net.group("choice", local_winners(of="maps", radius=1, per_map=1))
    net.trials(input="sheet", duration=20.0, stop="full")
    sim = start(net)
    times, ids, offsets, _ = batch(12, 40)
    found = told(sim.trials(times, ids, offsets), "first")
    sim.run(7.0)
    return found | told(sim.trials(times, ids, offsets), "second") | observe(sim)


@integers_too
@case
def exact_local_winners_to_the_last(start: Start) -> Found:
    """Any number of wins a map; a trial ends when nobody can win any more."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (2, 3, 4), cell(V_th=15.0))
    net.connect("sheet", "maps", all_to_all(), weight=whole(-1, 3, (72, 24)), name="s2")
    net.group("choice", local_winners(of="maps", radius=1))
    net.trials(input="sheet", duration=20.0)
    times, ids, offsets, _ = batch(10)
    sim = start(net)
    return told(sim.trials(times, ids, offsets)) | observe(sim)


@case
def local_winners_learn(start: Start) -> Found:
    """Each winner is taught, several of a map one after the other."""
    sim = start(sheets({"radius": 0, "per_map": 3}, first_spike_stdp(A_plus=0.1, A_minus=-0.05)))
    times, ids, offsets, _ = batch(24, 40)
    return told(sim.trials(times, ids, offsets, learn=True)) | told(sim.trials(times, ids, offsets)) | observe(sim)


@case
def local_winners_are_rewarded(start: Start) -> Found:
    """Each winner is rewarded by its own label, some maps are left out, and a trial ends when all is decided."""
    labels, dropout = {"of": "maps", "maps_per_label": 2}, {"of": "maps", "p": 0.4}
    words: dict[str, Any] = {"labels": labels, "dropout": dropout, "stop": "at_decision"}
    return taught(start, sheets({"radius": 1, "per_map": 1}, r_stdp(epsilon=0.002), all_to_all(), **words))


@case
def local_winners_without_trials(start: Start) -> Found:
    """What wins silences outside of trials, too, until a reset."""
    net = network(1.0)
    net.population("noise", 144, poisson_generator(rate=100.0))
    net.population("cells", (3, 6, 8), iaf_psc_delta(tau_m=30.0, E_L=0.0, V_reset=0.0, V_th=2.0))
    net.connect("noise", "cells", one_to_one(), weight=uniform(low=0.6, high=1.4), name="drive")
    net.group("choice", local_winners(of="cells", radius=1, per_map=3))
    sim = start(net)
    sim.run(50.0)
    found = observe(sim)
    sim.reset()
    sim.run(80.0)
    return {f"first: {name}": np.asarray(values) for name, values in found.items()} | observe(sim)
