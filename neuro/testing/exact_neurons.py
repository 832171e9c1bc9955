"""Cases of neurons, generators, groups and calls whose values are exact in floats and in integers."""

from __future__ import annotations

import numpy as np

from neuro.model.neurons import dc_generator, iaf_psc_exp, poisson_generator, spike_generator
from neuro.model.parts import lateral_reset, winner_take_all
from neuro.model.rules import all_to_all, one_to_one, pairs
from neuro.model.synapses import stdp
from neuro.testing.case import Found, Start, after, case, integers_too, network, observe
from neuro.testing.exact import cell, driven, times, whole

HALVED = float(1.0 / np.log(2.0))
"""Time constant in ms with which half is left after 1 ms."""


def spikes_and_counts(found: Found) -> Found:
    """What does not depend on how values are rounded."""
    return {name: values for name, values in found.items() if values.dtype.kind != "f"}


@integers_too
@case
def exact_delays_of_currents(start: Start) -> Found:
    """Every delay from 1 to 60 steps of iaf_psc_exp, whose currents act one step after they arrive."""
    net = network(1.0)
    net.population("source", 60, spike_generator(spike_times=[[5.0, 80.0]] * 60))
    net.population("cells", 60, iaf_psc_exp(t_ref=3.0))
    net.connect("source", "cells", one_to_one(), weight=9000.0, delay=np.arange(1.0, 61.0))
    return spikes_and_counts(after(start, net, 200.0))


@integers_too
@case
def exact_refractory_periods(start: Start) -> Found:
    """A constant drive with refractory periods from 0 to 12 steps."""
    net = network(1.0)
    net.population("cells", 13, cell(t_ref=np.arange(13.0), I_e=2.0))
    net.population("tick", 1, spike_generator(spike_times=[np.arange(1.0, 100.0).tolist()]))
    net.population("others", 13, cell(t_ref=np.arange(13.0), V_th=3.0))
    net.connect("tick", "others", all_to_all(), weight=1.0)
    return after(start, net, 120.0)


@integers_too
@case
def exact_thresholds(start: Start) -> Found:
    """Thresholds and resting potentials of their own; V_m = V_th fires, one below does not."""
    net = driven(8, V_th=np.arange(-65.0, -57.0), E_L=-70.0, V_reset=-70.0)
    net.connect("source", "cells", one_to_one(), weight=2.0)
    net.connect("source", "cells", all_to_all(), weight=np.tile([0.0, 1.0], (8, 4)), name="more")
    net.connect("source", "cells", one_to_one(), weight=-1.0, delay=2.0, name="less")
    return after(start, net, 150.0)


@integers_too
@case
def exact_currents(start: Start) -> Found:
    """Currents of whole mV a step, switched and set while they flow, beside a constant one."""
    net = network(1.0)
    net.population("source", 2, dc_generator(amplitude=np.array([2.0, 5.0]), start=3.0, stop=60.0))
    net.population("cells", 3, cell(V_th=40.0, I_e=np.array([0.0, 1.0, 3.0])))
    net.connect("source", "cells", all_to_all(), weight=np.array([[1.0, 2.0, 0.0], [1.0, -1.0, 3.0]]), delay=4.0)
    sim = start(net)
    sim.run(30.0)
    sim.set("source", amplitude=np.array([4.0, 1.0]))
    sim.run(50.0)
    return observe(sim)


@integers_too
@case
def exact_noise(start: Start) -> Found:
    """A poisson_generator of a low rate, in its window: the same draws everywhere."""
    net = network(1.0)
    net.population("noise", 6, poisson_generator(rate=np.linspace(0.0, 15.0, 6), start=10.0, stop=350.0))
    net.population("cells", 3, cell(V_th=3.0))
    net.connect("noise", "cells", all_to_all(), weight=1.0, delay=5.0)
    net.probe("spikes", "noise")
    return after(start, net, 400.0)


@integers_too
@case
def exact_best_of_each_step(start: Start) -> Found:
    """winner_take_all without first_to_fire, with ties: the losers of a step are reset."""
    net = driven(8, 0.3, V_th=5.0, t_ref=1.0)
    net.connect("source", "cells", all_to_all(), weight=1.0)
    net.connect("source", "cells", one_to_one(), weight=whole(0, 2, 8), name="own")
    net.group("choice", winner_take_all(of="cells", first_to_fire=False))
    return after(start, net, 150.0)


@integers_too
@case
def exact_lateral_reset(start: Start) -> Found:
    """lateral_reset along each axis, with ties: a spike resets its rivals and holds them."""
    found: Found = {}
    for axis in range(3):
        net = network(1.0)
        net.population("source", 8, spike_generator(spike_times=times(8, 0.1)))
        net.population("cells", (2, 3, 4), cell(V_th=6.0, t_ref=3.0))
        net.connect("source", "cells", all_to_all(), weight=whole(-1, 2, (8, 24)))
        net.group("one", lateral_reset(of="cells", axis=axis))
        found |= {f"axis {axis}: {name}": values for name, values in after(start, net, 150.0).items()}
    return found


@integers_too
@case
def exact_changes(start: Start) -> Found:
    """States, parameters and weights that are set, spikes that are injected, and a reset."""
    net = driven(8)
    net.connect("source", "cells", all_to_all(), weight=np.tile([2.0, -1.0], (8, 4)), name="shared")
    net.connect("source", "cells", all_to_all(), weight=whole(-1, 3, (8, 8)), delay=4.0, name="own")
    net.connect("source", "cells", one_to_one(), weight=2.0, delay=9.0, name="single")
    found: Found = {}
    sim = start(net)
    for turn in range(2):
        sim.set("cells", V_m=np.arange(-3.0, 5.0))
        sim.run(30.0)
        sim.set("cells", V_th=np.arange(4.0, 12.0), t_ref=1.0)
        sim.set_weights("shared", np.tile([0.0, 1.0, 2.0, -1.0], 16))
        sim.run(1.0)
        sim.inject("source", [33.0, 38.0, 50.0], [0, 3, 3])
        sim.run(15.0)
        sim.set_weights("own", whole(-1, 2, 64, seed=9))
        sim.set_weights("single", 1.0)
        sim.run(60.0)
        found |= {f"turn {turn}: {name}": values for name, values in observe(sim).items()}
        sim.reset(weights=turn == 0)
    return found | {f"after a reset: {name}": values for name, values in observe(sim).items()}


@integers_too
@case
def exact_halving(start: Start) -> Found:
    """Potentials and currents of which half is left after a step; spikes and counts are compared."""
    net = driven(8, 0.3, tau_m=HALVED, V_th=5.3)
    exponential = {"tau_m": HALVED, "tau_syn_ex": HALVED, "tau_syn_in": HALVED}
    net.population("currents", 8, iaf_psc_exp(**exponential, C_m=1000.0, E_L=0.0, V_reset=0.0, V_th=5.3))
    weight = whole(-1, 3, (8, 8))
    net.connect("source", "cells", all_to_all(), weight=weight, delay=2.0)
    net.connect("source", "currents", all_to_all(), weight=1000.0 * weight, delay=5.0)
    net.connect("currents", "cells", one_to_one(), weight=4.0, delay=1.0)
    return spikes_and_counts(after(start, net, 150.0))


@integers_too
@case
def counts_of_learning(start: Start) -> Found:
    """learning_updates of stdp, dense and listed, whose weights are too small to cause or delay a spike."""
    net = driven(6, 0.03, tau_m=HALVED, V_th=5.5)
    net.population("others", 6, cell(tau_m=HALVED, V_th=5.5))
    net.connect("source", "cells", one_to_one(), weight=6.0, delay=3.0)
    net.connect("cells", "others", one_to_one(), weight=6.0, delay=2.0)
    rule = stdp(lambda_=0.1, Wmax=0.05)
    net.connect("source", "cells", all_to_all(), rule, weight=0.03, delay=2.0, name="dense")
    few = pairs(pre=[0, 1, 2, 5], post=[0, 1, 2, 3])
    net.connect("cells", "others", few, rule, weight=0.03, delay=4.0, name="few")
    return spikes_and_counts(after(start, net, 150.0))
