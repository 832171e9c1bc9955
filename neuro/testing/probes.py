"""Cases of values that are set or read besides spikes: probes of states, means, rates and synapses, views, ports."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_exp, parrot_neuron, poisson_generator, spike_generator
from neuro.model.rules import all_to_all, fixed_indegree, fixed_outdegree, one_to_one, pairs, pairwise_bernoulli
from neuro.model.synapses import Synapse, static, stdp, stdp_dopa
from neuro.run.simulation import Simulation
from neuro.testing.case import Found, Start, after, case, integers_too, law, network, observe
from neuro.testing.exact import cell, times, whole


def _plastic(synapse: Synapse) -> Network:
    """Return parrots that project to neurons with a synapse model, also with several spikes in a step."""
    net = network()
    net.population("noise", 6, poisson_generator(rate=200.0))
    net.population("parrots", 6, parrot_neuron())
    net.population("cells", 5, iaf_psc_exp(I_e=350.0))
    net.connect("noise", "parrots", one_to_one(), delay=0.3)
    net.connect("parrots", "cells", fixed_outdegree(n=3), synapse, weight=60.0, delay=0.7, name="learning")
    net.connect("noise", "cells", all_to_all(), weight=40.0, delay=0.4, name="fixed")
    return net


def _in_parts(start: Start, net: Network) -> Found:
    """Run in parts that end between and at the steps of the probes."""
    sim = start(net)
    for ms in (0.1, 12.4, 7.5, 20.0):
        sim.run(ms)
    return observe(sim)


@case
def several_states_means_and_rates(start: Start) -> Found:
    """Two states in one probe, the mean of a state, and a rate in bins."""
    net = _plastic(static())
    net.probe("states", "cells", ["V_m", "I_syn_ex"], every=0.5)
    net.probe("mean", "cells", "V_m", every=0.2, mean=True)
    net.probe("rate", "cells", "rate", every=5.0)
    net.probe("drive", "noise", "rate", every=2.0)
    return _in_parts(start, net)


@case
def sleeping_neurons_are_recorded(start: Start) -> Found:
    """States of neurons with little input, in every step and at intervals."""
    net = network()
    net.population("noise", 2, poisson_generator(rate=30.0))
    net.population("cells", 150, iaf_psc_exp())
    net.connect("noise", "cells", fixed_outdegree(n=2), weight=500.0, delay=0.5)
    net.probe("V_m", "cells", "V_m")
    net.probe("I_syn_ex", "cells", "I_syn_ex", every=1.7)
    return _in_parts(start, net)


@case
def weights_are_recorded(start: Start) -> Found:
    """Learning weights at intervals: all, some, and their mean."""
    net = _plastic(stdp(Wmax=120.0))
    net.probe("all", "learning", "weight", every=2.5)
    net.probe("some", "learning", ["weight", "K_plus"], every=0.5, synapses=[7, 0, 3])
    net.probe("mean", "learning", "weight", every=1.0, mean=True)
    return _in_parts(start, net)


@case
def weights_at_pre_spikes(start: Start) -> Found:
    """Weights of synapses that learn from spike pairs, recorded at the emission of each spike."""
    net = _plastic(stdp(Wmax=120.0))
    net.probe("all", "learning", "weight", at="pre_spikes")
    net.probe("some", "learning", "weight", at="pre_spikes", synapses=[11, 2])
    return _in_parts(start, net)


@case
def fixed_weights_at_pre_spikes(start: Start) -> Found:
    """Weights of static synapses, recorded at the emission of each spike, and set between two runs."""
    net = _plastic(static())
    net.probe("all", "fixed", "weight", at="pre_spikes")
    sim = start(net)
    sim.run(10.0)
    sim.set_weights("fixed", 35.0)
    sim.run(10.0)
    return observe(sim)


@case
def states_at_pre_spikes(start: Start) -> Found:
    """Weight and eligibility of stdp_dopa, recorded at the emission of each spike."""
    net = _plastic(stdp_dopa(signal="reward", Wmax=120.0))
    net.signal("reward", to="cells")
    net.probe("sent", "learning", ["weight", "c"], at="pre_spikes")
    sim = start(net)
    sim.run(10.0)
    sim.signal("reward", 0.02)
    sim.run(20.0)
    return observe(sim)


def viewed_network(net: Network) -> Network:
    """Return cells in two shapes that receive noise, with probes of some of them."""
    net.population("noise", 12, poisson_generator(rate=1500.0))
    row = net.population("row", 12, iaf_psc_exp(I_e=300.0), initial={"V_m": uniform(low=-70.0, high=-56.0)})
    sheet = net.population("sheet", (3, 4), iaf_psc_exp(I_e=250.0))
    net.connect("noise", "row", one_to_one(), weight=200.0, delay=0.5)
    net.probe("some", row[[7, 2, 3]], "V_m", every=0.5)
    net.probe("line", sheet[1], "V_m")
    net.probe("spikes", row[::5])
    return net


@case
def views_are_connected(start: Start) -> Found:
    """Every rule from views to views, forwards and backwards, overlapping, with arrays of the views' shapes."""
    net = viewed_network(network())
    row, sheet = net.populations["row"], net.populations["sheet"]
    delay, weight = uniform(low=0.2, high=2.0), normal(mean=100.0, std=150.0)
    net.connect(row[:6], row[3:9], all_to_all(autapses=False), weight=weight, delay=delay, name="all")
    net.connect(row[::-1], sheet, one_to_one(), weight=np.linspace(-50.0, 300.0, 12), name="turned")
    net.connect(row, sheet[1:, ::2], fixed_indegree(n=3), weight=weight, delay=delay, name="into")
    net.connect(row[::2], row[5:], fixed_outdegree(n=3, autapses=False), weight=-100.0, name="out")
    net.connect(sheet[:, 1:], row[[9, 0, 4]], pairwise_bernoulli(p=0.4), weight=weight, delay=delay, name="chance")
    net.connect(row[6:], sheet[2], pairs(pre=[5, 0, 0], post=[1, 3, 0]), weight=[100.0, 200.0, 300.0], name="listed")
    net.connect(row[2:10], row[4:12], all_to_all(autapses=False), stdp(Wmax=200.0), weight=60.0, name="learns")
    return after(start, net)


@case
def views_are_set_and_read(start: Start) -> Found:
    """States and parameters of views are set, spikes are injected into views, and values of views are read."""
    net = viewed_network(network())
    row, sheet = net.populations["row"], net.populations["sheet"]
    sources = net.population("listed", 5, spike_generator())
    net.connect(sources[1:4], sheet[0, :3], one_to_one(), weight=900.0)
    sim = start(net)
    sim.run(10.0)
    sim.inject(sources[1:3], [11.0, 12.0])
    sim.inject(sources[3], [11.5], [3])
    sim.set(row[8:], V_th=np.array([-54.0, -53.0, -52.0, -51.0]), I_e=350.0)
    sim.set(sheet[1:, 0], V_m=[-58.0, -60.0])
    sim.run(30.0)
    times, ids = sim.spikes(row[:6], since=12.0, until=30.0)
    return observe(sim) | {
        "spikes of the view": np.rint(times * 10).astype(np.int64),
        "neurons of the view": ids,
        "V_m of the view": sim.get(sheet[:, 1], "V_m"),
        "V_th": sim.get("row", "V_th"),
    }


@case
def single_weights_change(start: Start) -> Found:
    """Only the weights of static synapses between chosen neurons change."""
    net = viewed_network(network())
    row = net.populations["row"]
    some = net.connect(row[:5], row[4:], fixed_indegree(n=2), weight=normal(mean=50.0, std=20.0), delay=1.5)
    sim = start(net)
    sim.run(10.0)
    sim.set(some, weight=400.0, pre=row[1], post=row[6:])
    sim.set(some, weight=-70.0, post=row[5])
    sim.run(20.0)
    return observe(sim) | dict(zip(("pre", "post", "weight", "delay"), sim.weights(some, delays=True), strict=True))


@case
def single_plastic_weights_change(start: Start) -> Found:
    """Learning weights of synapses between chosen neurons are set; the others keep their pending changes."""
    net = viewed_network(network())
    row = net.populations["row"]
    some = net.connect(row, row, all_to_all(autapses=False), stdp(Wmax=200.0, lambda_=0.1), weight=60.0, delay=1.5)
    sim = start(net)
    sim.run(20.0)
    sim.set(some, weight=150.0, pre=row[::3], post=row[2:7])
    new_weights = sim.get(some, "weight", post=row[3])
    sim.run(20.0)
    return observe(sim) | {"just set": new_weights}


@integers_too
@case
def exact_views(start: Start) -> Found:
    """Views with whole weights and delays; the weights of some synapses change."""
    net = network(1.0)
    source = net.population("source", (2, 4), spike_generator(spike_times=times(8)))
    cells = net.population("cells", 8, cell(V_th=9.0))
    own = net.connect(source[0], cells[2:6], all_to_all(), weight=whole(-1, 4, (4, 4)), delay=2.0, name="own")
    net.connect(source[:, ::3], cells[::2], one_to_one(), weight=3.0, delay=whole(1, 5, 4), name="each")
    net.connect(cells[:5], cells[3:], all_to_all(autapses=False), weight=-1.0, delay=1.0, name="back")
    net.probe("spikes", cells[1:4])
    sim = start(net)
    sim.run(70.0)
    sim.set(own, weight=2.0, pre=source[0, 1:3], post=cells[4])
    sim.run(70.0)
    return observe(sim) | {"seen": sim.trace("spikes")[1]}


STEPS = 12
"""Number of control steps."""
MS = 8.0
"""Duration of a control step, ms."""

Reads = list[np.ndarray]
"""Arrays that a control step reads."""
Drive = Callable[[Simulation, int], Reads]
"""Function that makes a control step, given its number."""
Way = Callable[[Simulation, Network], Drive]
"""Function that returns a `Drive`: `with_calls` or `with_ports`."""


def driven() -> Network:
    """Return noise with changing rates that projects to cells, which excite each other."""
    net = network(1.0)
    net.population("noise", (2, 6), poisson_generator(rate=20.0))
    net.population("cells", 9, iaf_psc_exp(), initial={"V_m": -60.0})
    net.connect("noise", "cells", fixed_indegree(n=6), weight=700.0, delay=2.0)
    net.connect("cells", "cells", fixed_indegree(n=2), weight=150.0, delay=3.0)
    return net


def values(step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rates, Hz, the rates of a view, Hz, and the thresholds, mV, of a control step."""
    return np.linspace(0.0, 15.0 * step, 12), np.full(3, 7.0 * step), np.linspace(-57.0, -52.0, 9)


def with_calls(sim: Simulation, net: Network) -> Drive:
    """Return a function that makes a control step by plain calls."""
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
    """Return a function that makes the step of `with_calls` by ports, some with output arrays."""
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
        spikes_and_counts = [spikes.get(ids).copy(), some_spikes.get(), counts.get(counted).copy(), some_counts.get()]
        return [*spikes_and_counts, potential.get(states).copy(), some_thresholds.get()]

    return drive


def recorded() -> Network:
    """Return the network of `driven` with a probe of the noise."""
    net = driven()
    net.probe("sent", "noise")
    return net


def rewarded() -> Network:
    """Return noise that projects to cells by synapses that learn with a signal."""
    net = network(1.0)
    net.population("noise", 8, poisson_generator(rate=60.0))
    net.population("cells", 3, iaf_psc_exp(), initial={"V_m": -60.0})
    net.signal("reward", to="cells")
    rule = stdp_dopa(signal="reward", Wmax=900.0, A_plus=2.0, A_minus=0.0, tau_n=30.0, tau_c=100.0)
    net.connect("noise", "cells", all_to_all(), rule, weight=500.0, delay=2.0, name="learnt")
    return net


def read(reads: Reads) -> Found:
    """Return the arrays that were read as an outcome, named by number."""
    return {f"read {k}": values for k, values in enumerate(reads)}


@integers_too
@law
def ports_do_what_calls_do(start: Start) -> tuple[Found, Found]:
    """Ports set and read the same parameters, states, spikes and counts as plain calls, also of views, bit for bit."""

    def looped(way: Way) -> Found:
        net = recorded()
        sim = start(net)
        drive = way(sim, net)
        return read([array for step in range(STEPS) for array in drive(sim, step)]) | observe(sim)

    return looped(with_calls), looped(with_ports)


@integers_too
@law
def ports_go_on_after_a_restore(start: Start) -> tuple[Found, Found]:
    """After a restored state and after a reset, ports continue like plain calls."""

    def looped(way: Way) -> Found:
        net = recorded()
        sim = start(net)
        drive = way(sim, net)
        reads = [array for step in range(4) for array in drive(sim, step)]
        with tempfile.TemporaryDirectory() as folder:
            sim.save(Path(folder) / "state.h5")
            reads += [array for step in range(4, 8) for array in drive(sim, step)]
            sim.restore(Path(folder) / "state.h5")
        reads += [array for step in range(4, 9) for array in drive(sim, step)]
        sim.reset()
        reads += [array for step in range(3) for array in drive(sim, step)]
        return read(reads) | observe(sim)

    return looped(with_calls), looped(with_ports)


@integers_too
@law
def ports_of_signals_and_weights(start: Start) -> tuple[Found, Found]:
    """A signal and learning weights are set by ports and by plain calls."""

    def looped(ports: bool) -> Found:
        sim = start(rewarded())
        reward, weight, buffer = sim.port("reward"), sim.port("learnt", "weight"), np.zeros(24)
        reads = []
        for step in range(STEPS):
            dopamine, new_weights = np.linspace(-0.02, 0.03, 3) * step, np.linspace(300.0, 600.0, 24)
            if ports:
                if step == 5:
                    weight.set(new_weights)
                reward.set(dopamine)
            else:
                if step == 5:
                    sim.set("learnt", weight=new_weights)
                sim.signal("reward", dopamine)
            sim.run(MS)
            reads.append(weight.get(buffer).copy() if ports else sim.weights("learnt")[2])
        return read(reads) | observe(sim)

    return looped(False), looped(True)
