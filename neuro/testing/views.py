"""Cases of views: neurons of a population that are connected, recorded, set and read alone."""

from __future__ import annotations

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_exp, poisson_generator, spike_generator
from neuro.model.rules import all_to_all, fixed_indegree, fixed_outdegree, one_to_one, pairs, pairwise_bernoulli
from neuro.model.synapses import stdp
from neuro.testing.case import Found, Start, after, case, integers_too, network, observe
from neuro.testing.exact import cell, times, whole


def seen(net: Network) -> Network:
    """Cells in two shapes that receive noise, with probes of some of them."""
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
    net = seen(network())
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
    """States and parameters of some neurons that are set, spikes that are injected, and what is read of a view."""
    net = seen(network())
    row, sheet = net.populations["row"], net.populations["sheet"]
    listed = net.population("listed", 5, spike_generator())
    net.connect(listed[1:4], sheet[0, :3], one_to_one(), weight=900.0)
    sim = start(net)
    sim.run(10.0)
    sim.inject(listed[1:3], [11.0, 12.0])
    sim.inject(listed[3], [11.5], [3])
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
    """Weights of static synapses that are chosen by their ends change, and no others."""
    net = seen(network())
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
    """Weights that learn and are set by their ends; the others keep what they are about to learn, too."""
    net = seen(network())
    row = net.populations["row"]
    some = net.connect(row, row, all_to_all(autapses=False), stdp(Wmax=200.0, lambda_=0.1), weight=60.0, delay=1.5)
    sim = start(net)
    sim.run(20.0)
    sim.set(some, weight=150.0, pre=row[::3], post=row[2:7])
    found = sim.get(some, "weight", post=row[3])
    sim.run(20.0)
    return observe(sim) | {"just set": found}


@integers_too
@case
def exact_views(start: Start) -> Found:
    """Views of whole weights and delays, and a weight of some that changes."""
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
