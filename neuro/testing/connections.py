"""Cases of connection rules, weights and delays."""

from __future__ import annotations

import numpy as np

from neuro.model.distributions import lognormal, normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    Model,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
)
from neuro.model.rules import (
    Rule,
    all_to_all,
    distance_dependent,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    grid,
    one_to_one,
    pairs,
    pairwise_bernoulli,
    symmetric_pairwise_bernoulli,
)
from neuro.model.space import circular, exponential, gaussian, linear, of_distance
from neuro.testing.case import Found, Start, after, case, network

INF = float("inf")


def connected(rule: Rule, n_pre: int = 6, n_post: int = 5, resolution: float = 0.1) -> Network:
    """Neurons that receive Poisson spikes by one rule with drawn weights and delays."""
    net = network(resolution)
    net.population("source", n_pre, poisson_generator(rate=1500.0))
    net.population("cells", n_post, iaf_psc_exp(I_e=300.0))
    delay = uniform(low=0.1, high=2.0)
    net.connect("source", "cells", rule, weight=normal(mean=200.0, std=300.0), delay=delay)
    net.connect("cells", "cells", all_to_all(autapses=False), weight=-150.0, delay=1.5)
    return net


@case
def rule_one_to_one(start: Start) -> Found:
    """one_to_one with weights and delays of their own."""
    return after(start, connected(one_to_one(), 5, 5))


@case
def rule_pairs(start: Start) -> Found:
    """Every rule that lists or draws pairs, each onto neurons of its own, one of them without synapses."""
    net = network()
    net.population("source", 6, poisson_generator(rate=1500.0))
    listed = pairs(pre=[2, 0, 1, 0, 2, 0], post=[1, 3, 0, 0, 1, 3])
    rules: dict[str, Rule] = {
        "indegree": fixed_indegree(n=4),
        "outdegree": fixed_outdegree(n=3, multapses=False),
        "bernoulli": pairwise_bernoulli(p=0.4),
        "total": fixed_total_number(n=17),
        "once": fixed_total_number(n=11, multapses=False),
        "listed": listed,
        "none": pairs(pre=[], post=[]),
    }
    delay, drawn = uniform(low=0.1, high=2.0), normal(mean=200.0, std=300.0)
    own = np.array([900.0, 300.0, -200.0, 700.0, -100.0, 50.0])
    for name, rule in rules.items():
        net.population(name, 6, iaf_psc_exp(I_e=300.0))
        net.connect("source", name, rule, weight=own if name == "listed" else drawn, delay=delay)
        net.connect(name, name, symmetric_pairwise_bernoulli(p=0.4), weight=drawn, delay=0.7)
    return after(start, net)


@case
def rule_grid(start: Start) -> Found:
    """Shared kernels: with channels, stride and padding; of one channel, listed; depthwise. A layer on top of each."""
    net = network(1.0)
    net.population("sheet", (2, 6, 7), poisson_generator(rate=60.0))
    net.population("plain", (5, 5), poisson_generator(rate=150.0))
    summed = iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=2.0, t_ref=0.0)
    for name, maps, model in (
        *(("maps", 3, iaf_psc_exp(tau_syn_in=4.0)), ("split", 4, iaf_psc_exp(tau_syn_in=4.0)), ("edges", 2, summed)),
        *(("top", 2, summed), ("pooled", 4, summed), ("corners", 2, summed)),
    ):
        net.population(name, (maps, "auto", "auto"), model)
    drawn = normal(mean=250.0, std=300.0)
    net.connect("sheet", "maps", grid(kernel=(3, 4), stride=2, padding=1), weight=drawn, delay=2.0)
    net.connect("sheet", "split", grid(kernel=(3, 4), padding="same", depthwise=True), weight=drawn, delay=2.0)
    net.connect("plain", "edges", grid(kernel=(3, 3)), weight=np.linspace(-0.5, 1.5, 18).reshape(2, 3, 3))
    net.connect("maps", "top", grid(kernel=(2, 2)), weight=1.0)
    net.connect("split", "pooled", grid(kernel=(4, 4), stride=4, padding="same", depthwise=True), weight=1.0)
    net.connect("edges", "corners", grid(kernel=(2, 2)), weight=0.75)
    return after(start, net, 100.0)


@case
def drawn_weights(start: Start) -> Found:
    """Weights drawn lognormally, clipped; delays drawn and rounded to at least one step."""
    net = connected(fixed_indegree(n=5))
    weight = lognormal(mean=5.0, std=1.0, high=900.0)
    net.connect("source", "cells", fixed_indegree(n=2), weight=weight, delay=normal(mean=0.2, std=0.3), name="more")
    return after(start, net)


@case
def long_delays(start: Start) -> Found:
    """Delays of many steps beside one of a single step."""
    net = network()
    net.population("cells", 4, iaf_psc_exp(I_e=450.0), initial={"V_m": uniform(low=-70.0, high=-56.0)})
    net.connect("cells", "cells", all_to_all(), weight=300.0, delay=20.0, name="far")
    net.connect("cells", "cells", one_to_one(), weight=-400.0, delay=0.1, name="near")
    return after(start, net, 100.0)


@case
def networks_of_all_models(start: Start) -> Found:
    """Every model in one recurrent network."""
    net = network()
    net.population("noise", 8, poisson_generator(rate=900.0))
    models: tuple[Model, ...] = (
        iaf_psc_delta(V_th=-60.0),
        iaf_psc_exp(),
        iaf_psc_alpha(),
        izhikevich(),
        parrot_neuron(),
    )
    for model in models:
        net.population(model.name, 8, model)
    scale = {"iaf_psc_delta": 2.0, "izhikevich": 4.0, "parrot_neuron": 1.0}
    for post in models:
        weight = scale.get(post.name, 400.0)
        net.connect("noise", post.name, one_to_one(), weight=weight, delay=0.5, name=f"noise_{post.name}")
        for pre in models:
            if post.name != "parrot_neuron":
                net.connect(
                    pre.name, post.name, fixed_indegree(n=2), weight=0.5 * weight, delay=uniform(low=0.1, high=3)
                )
    return after(start, net)


@case
def rule_distance_dependent(start: Start) -> Found:
    """distance_dependent with a mask and periodic edges; weights and delays of distance."""
    net = network()
    for name, model in (("source", poisson_generator(rate=900.0)), ("cells", iaf_psc_exp(I_e=300.0))):
        net.population(name, (4, 5), model, extent=[4.0, 5.0], periodic=True)
    near = distance_dependent(p=gaussian(std=2.0), mask=circular(radius=2.0))
    delay = of_distance(linear(c=0.1, a=0.5))
    net.connect("source", "cells", near, weight=of_distance(exponential(a=500.0)), delay=delay)
    net.connect("cells", "cells", distance_dependent(p=0.4, autapses=False), weight=-90.0, delay=delay)
    return after(start, net)
