"""Cases of connection rules, weights, delays and generators."""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.distributions import lognormal, normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    Generator,
    Model,
    ac_generator,
    dc_generator,
    gamma_sup_generator,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    inhomogeneous_poisson_generator,
    izhikevich,
    noise_generator,
    parrot_neuron,
    poisson_generator,
    sinusoidal_poisson_generator,
    spike_train,
    step_current_generator,
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
from neuro.model.synapses import static
from neuro.testing.case import Found, Start, after, case, network, observe

INF = float("inf")


def connected(rule: Rule, n_pre: int = 6, n_post: int = 5, resolution: float = 0.1) -> Network:
    """Return neurons that receive Poisson spikes by one rule with random weights and delays."""
    net = network(resolution)
    net.population("source", n_pre, poisson_generator(rate=1500.0))
    net.population("cells", n_post, iaf_psc_exp(I_e=300.0))
    delay = uniform(low=0.1, high=2.0)
    net.connect("source", "cells", rule, weight=normal(mean=200.0, std=300.0), delay=delay)
    net.connect("cells", "cells", all_to_all(autapses=False), weight=-150.0, delay=1.5)
    return net


@case
def rule_one_to_one(start: Start) -> Found:
    """one_to_one with a weight and a delay for each synapse."""
    return after(start, connected(one_to_one(), 5, 5))


@case
def rule_pairs(start: Start) -> Found:
    """Every rule with listed or random pairs, each onto its own neurons; one rule has no synapses."""
    net = network()
    net.population("source", 6, poisson_generator(rate=1500.0))
    six_pairs = pairs(pre=[2, 0, 1, 0, 2, 0], post=[1, 3, 0, 0, 1, 3])
    rules: dict[str, Rule] = {
        "indegree": fixed_indegree(n=4),
        "outdegree": fixed_outdegree(n=3, multapses=False),
        "bernoulli": pairwise_bernoulli(p=0.4),
        "total": fixed_total_number(n=17),
        "once": fixed_total_number(n=11, multapses=False),
        "listed": six_pairs,
        "none": pairs(pre=[], post=[]),
    }
    delay, distribution = uniform(low=0.1, high=2.0), normal(mean=200.0, std=300.0)
    listed_weights = np.array([900.0, 300.0, -200.0, 700.0, -100.0, 50.0])
    for name, rule in rules.items():
        net.population(name, 6, iaf_psc_exp(I_e=300.0))
        net.connect("source", name, rule, weight=listed_weights if name == "listed" else distribution, delay=delay)
        net.connect(name, name, symmetric_pairwise_bernoulli(p=0.4), weight=distribution, delay=0.7)
    return after(start, net)


@case
def rule_grid(start: Start) -> Found:
    """Grids with padding and a stride, depthwise, or with listed weights; each projects to a second layer."""
    net = network(1.0)
    net.population("sheet", (2, 6, 7), poisson_generator(rate=60.0))
    net.population("plain", (5, 5), poisson_generator(rate=150.0))
    summed = iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=2.0, t_ref=0.0)
    for name, maps, model in (
        *(("maps", 3, iaf_psc_exp(tau_syn_in=4.0)), ("split", 4, iaf_psc_exp(tau_syn_in=4.0)), ("edges", 2, summed)),
        *(("top", 2, summed), ("pooled", 4, summed), ("corners", 2, summed)),
    ):
        net.population(name, (maps, "auto", "auto"), model)
    distribution = normal(mean=250.0, std=300.0)
    net.connect("sheet", "maps", grid(kernel=(3, 4), stride=2, padding=1), weight=distribution, delay=2.0)
    net.connect("sheet", "split", grid(kernel=(3, 4), padding="same", depthwise=True), weight=distribution, delay=2.0)
    net.connect("plain", "edges", grid(kernel=(3, 3)), weight=np.linspace(-0.5, 1.5, 18).reshape(2, 3, 3))
    net.connect("maps", "top", grid(kernel=(2, 2)), weight=1.0)
    net.connect("split", "pooled", grid(kernel=(4, 4), stride=4, padding="same", depthwise=True), weight=1.0)
    net.connect("edges", "corners", grid(kernel=(2, 2)), weight=0.75)
    return after(start, net, 100.0)


@case
def drawn_weights(start: Start) -> Found:
    """Weights drawn from a clipped lognormal distribution; delays drawn and rounded to at least one step."""
    net = connected(fixed_indegree(n=5))
    weight = lognormal(mean=5.0, std=1.0, high=900.0)
    net.connect("source", "cells", fixed_indegree(n=2), weight=weight, delay=normal(mean=0.2, std=0.3), name="more")
    return after(start, net)


@case
def long_delays(start: Start) -> Found:
    """Delays of many steps, and a delay of a single step."""
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
    """distance_dependent with a mask and periodic edges; weights and delays depend on the distance."""
    net = network()
    for name, model in (("source", poisson_generator(rate=900.0)), ("cells", iaf_psc_exp(I_e=300.0))):
        net.population(name, (4, 5), model, extent=[4.0, 5.0], periodic=True)
    near = distance_dependent(p=gaussian(std=2.0), mask=circular(radius=2.0))
    delay = of_distance(linear(c=0.1, a=0.5))
    net.connect("source", "cells", near, weight=of_distance(exponential(a=500.0)), delay=delay)
    net.connect("cells", "cells", distance_dependent(p=0.4, autapses=False), weight=-90.0, delay=delay)
    return after(start, net)


def steered(model: Generator, n: int = 2) -> Network:
    """Return neurons with a generated current over several delays and weights, and with a constant current."""
    net = network()
    net.population("source", n, model)
    net.population("steady", 1, dc_generator(amplitude=150.0, start=3.0, stop=40.0))
    net.population("cells", 3, iaf_psc_exp(I_e=200.0))
    net.population("slow", (2, 2), iaf_psc_alpha(I_e=250.0))
    net.connect("source", "cells", all_to_all(), weight=np.linspace(-1.0, 2.0, 3 * n), delay=0.7, name="to_cells")
    delay = np.linspace(0.1, 2.0, 4 * n).round(1)
    net.connect("source", "slow", all_to_all(), weight=0.5, delay=delay, name="to_slow")
    net.connect("steady", "cells", all_to_all(), weight=1.0, delay=0.4)
    for name in ("cells", "slow"):
        net.probe(f"V_{name}", name, "V_m", every=0.5)
    return net


def set_twice(start: Start, net: Network, **values: Any) -> Found:
    """Run, set parameters of the source and weights while some of its output is in flight, and run again."""
    sim = start(net)
    sim.run(20.3)
    if values:
        sim.set("source", **values)
    sim.run(0.3)
    sim.set_weights("to_cells", 1.5)
    sim.run(30.0)
    return observe(sim)


@case
def stepped_currents(start: Start) -> Found:
    """step_current_generator: values for each neuron that change at listed times, between start and stop."""
    values = np.array([[100.0, -50.0, 400.0], [300.0, 0.0, 200.0]])
    model = step_current_generator(amplitude_times=[0.1, 12.0, 20.5], amplitude_values=values, start=2.0, stop=44.0)
    return set_twice(start, steered(model))


@case
def sinusoidal_currents(start: Start) -> Found:
    """ac_generator: parameters of each neuron, set between two runs."""
    model = ac_generator(
        amplitude=np.array([200.0, 350.0]), offset=80.0, frequency=np.array([35.0, 120.0]), phase=60.0, start=1.5
    )
    return set_twice(start, steered(model), frequency=80.0, offset=-20.0)


@case
def noise_of_each_connection(start: Start) -> Found:
    """noise_generator: each connection has its own noise, whose variance is modulated."""
    model = noise_generator(mean=100.0, std=300.0, std_mod=200.0, frequency=60.0, phase=30.0, start=2.5, stop=45.0)
    return set_twice(start, steered(model, 1), mean=250.0, std=250.0)


@case
def noise_that_is_shared(start: Start) -> Found:
    """noise_generator: one noise per generator for all its targets, constant for some steps."""
    return set_twice(start, steered(noise_generator(mean=100.0, std=400.0, dt=0.7, individual_noise=False)), mean=-50.0)


@case
def currents_to_a_receptor(start: Start) -> Found:
    """A current of either sign that a receptor filters, and an unfiltered current."""
    net = steered(ac_generator(amplitude=400.0, frequency=50.0))
    net.connect("steady", "cells", all_to_all(), static(receptor="ex"), weight=2.0, delay=0.2, name="filtered")
    to_ex = static(receptor="ex")
    net.connect("source", "cells", all_to_all(), to_ex, weight=np.linspace(-2.0, 1.0, 6), delay=1.3, name="waves")
    sim = start(net)
    sim.run(25.0)
    sim.set_weights("filtered", -1.0)
    sim.set("cells", tau_syn_ex=4.0)
    sim.run(25.0)
    return observe(sim)


@case
def currents_to_both_receptors(start: Start) -> Found:
    """Each receptor filters by its own time constant, which may differ between neurons."""
    net = network()
    net.population("source", 3, ac_generator(amplitude=500.0, frequency=40.0, phase=np.array([0.0, 90.0, 200.0])))
    net.population("cells", 3, iaf_psc_exp(tau_syn_ex=np.array([1.0, 2.0, 8.0]), tau_syn_in=12.0))
    for receptor in ("ex", "in"):
        synapse = static(receptor=receptor)
        net.connect("source", "cells", one_to_one(), synapse, weight=-1.0 if receptor == "in" else 1.5, name=receptor)
    net.probe("V", "cells", "V_m", every=0.5)
    sim = start(net)
    sim.run(50.0)
    return observe(sim)


def emitting(model: Generator, n: int = 4) -> Network:
    """Return parrots that repeat the spikes of generators, and neurons that receive the spikes."""
    net = network()
    net.population("source", n, model)
    net.population("relay", n, parrot_neuron())
    net.population("cells", 3, iaf_psc_exp())
    net.connect("source", "relay", one_to_one(), delay=0.3)
    net.connect("relay", "cells", all_to_all(), weight=120.0, delay=0.8)
    return net


@case
def rates_that_step(start: Start) -> Found:
    """inhomogeneous_poisson_generator: rates of each neuron that change at listed times."""
    rates = np.array([[0.0, 900.0, 20.0], [5000.0, 0.0, 900.0], [60.0, 60.0, 60.0], [9.0, 8000.0, 0.0]])
    sim = start(
        emitting(inhomogeneous_poisson_generator(rate_times=[0.1, 20.0, 31.5], rate_values=rates, start=2.0, stop=45.0))
    )
    sim.run(25.5)
    sim.run(24.5)
    return observe(sim)


@case
def rates_that_follow_a_sine(start: Start) -> Found:
    """sinusoidal_poisson_generator: rates that are cut off at 0, set between two runs."""
    amplitude = np.array([0.0, 500.0, 3000.0, -700.0])
    net = emitting(sinusoidal_poisson_generator(rate=800.0, amplitude=amplitude, frequency=40.0, phase=20.0, start=3.0))
    sim = start(net)
    sim.run(25.0)
    sim.set("source", rate=300.0, phase=90.0)
    sim.run(25.0)
    return observe(sim)


@case
def spikes_of_gamma_processes(start: Start) -> Found:
    """gamma_sup_generator: superposed gamma processes, whose rate is set between two runs."""
    sim = start(emitting(gamma_sup_generator(rate=np.array([5.0, 20.0, 60.0, 0.0]), gamma_shape=3, n_proc=40)))
    sim.run(25.0)
    sim.set("source", rate=30.0)
    sim.run(25.0)
    return observe(sim)


@case
def recorded_spikes(start: Start) -> Found:
    """spike_train: recorded spikes are emitted again; two spikes at one time become a spike of multiplicity 2."""
    rows = np.array([[0.1, 2.0], [0.1, 0.0], [0.1, 2.0], [7.3, 1.0], [30.0, 3.0]])
    sim = start(emitting(spike_train(spikes=rows)))
    sim.run(40.0)
    return observe(sim)
