"""Cases of ports: what they set and read is what plain calls set and read."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_exp, poisson_generator
from neuro.model.rules import all_to_all, fixed_indegree
from neuro.model.synapses import stdp_dopa
from neuro.run.simulation import Simulation
from neuro.testing.case import Found, Start, integers_too, law, network, observe

STEPS = 12
MS = 8.0
"""Of each step."""

Reads = list[np.ndarray]
Drive = Callable[[Simulation, int], Reads]
Way = Callable[[Simulation, Network], Drive]


def driven() -> Network:
    """Noise, whose rates are set, into cells that excite each other."""
    net = network(1.0)
    net.population("noise", (2, 6), poisson_generator(rate=20.0))
    net.population("cells", 9, iaf_psc_exp(), initial={"V_m": -60.0})
    net.connect("noise", "cells", fixed_indegree(n=6), weight=700.0, delay=2.0)
    net.connect("cells", "cells", fixed_indegree(n=2), weight=150.0, delay=3.0)
    return net


def values(step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates, rates of a view, and thresholds of a step."""
    return np.linspace(0.0, 15.0 * step, 12), np.full(3, 7.0 * step), np.linspace(-57.0, -52.0, 9)


def with_calls(sim: Simulation, net: Network) -> Drive:
    """A step of the loop by plain calls."""
    noise, cells = net.populations["noise"], net.populations["cells"]

    def drive(sim: Simulation, step: int) -> Reads:
        rates, some, thresholds = values(step)
        now = sim.time
        sim.set(noise, rate=rates)
        sim.set(noise[1, ::2], rate=some)
        sim.set("cells", V_th=thresholds)
        if step % 5 == 3:
            sim.set(cells[2:4], V_m=np.full(2, -65.0))
        sim.run(MS)
        ids = [sim.spikes(of, since=now)[1] for of in (noise, cells[::-2])]
        counts = np.bincount(sim.spikes("cells", since=now)[1], minlength=9)
        return [*ids, counts, counts[::-2], sim.get("cells", "V_m"), sim.get(cells[[4, 1]], "V_th")]

    return drive


def with_ports(sim: Simulation, net: Network) -> Drive:
    """The same step by ports, some into arrays that are there."""
    noise, cells = net.populations["noise"], net.populations["cells"]
    rate, some_rates = sim.port(noise, "rate"), sim.port(noise[1, ::2], "rate")
    threshold, potential = sim.port("cells", "V_th"), sim.port("cells", "V_m")
    some_potentials, some_thresholds = sim.port(cells[2:4], "V_m"), sim.port(cells[[4, 1]], "V_th")
    spikes, some_spikes = sim.port("noise", "spikes"), sim.port(cells[::-2], "spikes")
    counts, some_counts = sim.port("cells", "counts"), sim.port(cells[::-2], "counts")
    ids, counted, states = np.zeros(500, np.int64), np.zeros(9, np.int64), np.zeros(9)

    def drive(sim: Simulation, step: int) -> Reads:
        rates, some, thresholds = values(step)
        rate.set(rates)
        some_rates.set(some)
        threshold.set(thresholds)
        if step % 5 == 3:
            some_potentials.set(np.full(2, -65.0))
        sim.run(MS)
        found = [spikes.get(ids).copy(), some_spikes.get(), counts.get(counted).copy(), some_counts.get()]
        return [*found, potential.get(states).copy(), some_thresholds.get()]

    return drive


def recorded() -> Network:
    """The network with a record of the noise, too."""
    net = driven()
    net.probe("sent", "noise")
    return net


def rewarded() -> Network:
    """Noise into cells by synapses that learn under a signal."""
    net = network(1.0)
    net.population("noise", 8, poisson_generator(rate=60.0))
    net.population("cells", 3, iaf_psc_exp(), initial={"V_m": -60.0})
    net.signal("reward", to="cells")
    rule = stdp_dopa(signal="reward", Wmax=900.0, A_plus=2.0, A_minus=1.0, tau_n=30.0, tau_c=100.0)
    net.connect("noise", "cells", all_to_all(), rule, weight=500.0, delay=2.0, name="learnt")
    return net


def read(reads: Reads) -> Found:
    """What was read, by number."""
    return {f"read {k}": each for k, each in enumerate(reads)}


@integers_too
@law
def ports_do_what_calls_do(start: Start) -> tuple[Found, Found]:
    """Parameters, states, spikes and counts by ports, also of views, are those by plain calls, bit for bit."""

    def looped(way: Way) -> Found:
        net = recorded()
        sim = start(net)
        drive = way(sim, net)
        return read([each for step in range(STEPS) for each in drive(sim, step)]) | observe(sim)

    return looped(with_calls), looped(with_ports)


@integers_too
@law
def ports_go_on_after_a_restore(start: Start) -> tuple[Found, Found]:
    """A state that is restored in the middle, and a reset: ports go on as plain calls do."""

    def looped(way: Way) -> Found:
        net = recorded()
        sim = start(net)
        drive = way(sim, net)
        reads = [each for step in range(4) for each in drive(sim, step)]
        with tempfile.TemporaryDirectory() as folder:
            sim.save(Path(folder) / "state.h5")
            reads += [each for step in range(4, 8) for each in drive(sim, step)]
            sim.restore(Path(folder) / "state.h5")
        reads += [each for step in range(4, 9) for each in drive(sim, step)]
        sim.reset()
        reads += [each for step in range(3) for each in drive(sim, step)]
        return read(reads) | observe(sim)

    return looped(with_calls), looped(with_ports)


@integers_too
@law
def ports_of_signals_and_weights(start: Start) -> tuple[Found, Found]:
    """A signal that is set, and weights that learn and are set, by ports and by plain calls."""

    def looped(ports: bool) -> Found:
        sim = start(rewarded())
        reward, weight, kept = sim.port("reward"), sim.port("learnt", "weight"), np.zeros(24)
        reads = []
        for step in range(STEPS):
            dopamine, new = np.linspace(-0.02, 0.03, 3) * step, np.linspace(300.0, 600.0, 24)
            if ports:
                if step == 5:
                    weight.set(new)
                reward.set(dopamine)
            else:
                if step == 5:
                    sim.set("learnt", weight=new)
                sim.signal("reward", dopamine)
            sim.run(MS)
            reads.append(weight.get(kept).copy() if ports else sim.weights("learnt")[2])
        return read(reads) | observe(sim)

    return looped(False), looped(True)
