"""Cases of pairwise learning: stdp and stdp_dopa."""

from __future__ import annotations

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.rules import Rule, all_to_all, fixed_indegree, one_to_one, pairs, pairwise_bernoulli
from neuro.model.synapses import Synapse, stdp, stdp_dopa, stdp_nn_symm, stdp_triplet, tsodyks2, vogels_sprekeler
from neuro.testing.case import Found, Start, after, case, network, observe


def learner(synapse: Synapse, rule: Rule | None = None, delay: object = 1.0, weight: object = 60.0) -> Network:
    """Return a network of Poisson sources with plastic synapses to neurons, which have a further Poisson input."""
    net = network()
    net.population("source", 6, poisson_generator(rate=120.0))
    net.population("drive", 4, poisson_generator(rate=400.0))
    net.population("cells", 4, iaf_psc_exp(tau_minus=np.array([20.0, 20.0, 15.0, 30.0])))
    net.connect("source", "cells", rule or all_to_all(), synapse, weight=weight, delay=delay, name="plastic")
    net.connect("drive", "cells", one_to_one(), weight=900.0, delay=0.5)
    return net


@case
def stdp_multiplicative(start: Start) -> Found:
    """Multiplicative stdp: mu_plus = mu_minus = 1."""
    return after(start, learner(stdp(lambda_=0.05)), 200.0)


@case
def stdp_additive(start: Start) -> Found:
    """Additive stdp: mu_plus = mu_minus = 0; weights reach both bounds."""
    return after(start, learner(stdp(lambda_=0.2, mu_plus=0.0, mu_minus=0.0, alpha=1.2)), 200.0)


@case
def stdp_between(start: Start) -> Found:
    """Random pairs with random weights and delays; mu_plus and mu_minus of stdp lie between 0 and 1."""
    rule = stdp(lambda_=0.1, mu_plus=0.4, mu_minus=0.3, tau_plus=12.0)
    net = learner(rule, fixed_indegree(n=5), uniform(low=0.1, high=4.0), uniform(low=0.0, high=100.0))
    return after(start, net, 200.0)


@case
def stdp_within_a_population(start: Start) -> Found:
    """Recurrent stdp, in which each neuron is both pre and post, with simultaneous spikes."""
    net = network()
    net.population("drive", 5, poisson_generator(rate=600.0))
    net.population("cells", 5, iaf_psc_delta(t_ref=0.5))
    net.connect("drive", "cells", one_to_one(), weight=6.0, delay=0.1)
    net.connect("cells", "cells", pairwise_bernoulli(p=0.7), stdp(Wmax=3.0, lambda_=0.1), weight=1.0, delay=0.3)
    net.connect("cells", "cells", all_to_all(), stdp(Wmax=2.0, lambda_=0.1), weight=0.2, delay=0.1, name="dense")
    return after(start, net, 150.0)


@case
def stdp_onto_parrots(start: Start) -> Found:
    """Plastic synapses onto parrots, with spikes of multiplicity above 1, which act as several spikes."""
    net = network(1.0)
    net.population("source", 3, poisson_generator(rate=900.0))
    net.population("cells", 3, parrot_neuron())
    net.population("end", 3, iaf_psc_delta(V_th=0.0))
    net.connect("source", "cells", one_to_one(), stdp(lambda_=0.1), weight=10.0, delay=2.0)
    net.connect("source", "end", all_to_all(), stdp(Wmax=2.0), weight=1.0, delay=3.0)
    return after(start, net, 80.0)


@case
def stdp_changes(start: Start) -> Found:
    """Changes of the rule's parameters and of the weights between runs."""
    sim = start(learner(stdp(lambda_=0.05)))
    sim.run(60.0)
    sim.set("plastic", lambda_=0.2, alpha=0.5)
    sim.run(60.0)
    sim.set_weights("plastic", np.linspace(0.0, 100.0, 24))
    sim.run(60.0)
    sim.set("plastic", tau_plus=40.0)
    sim.run(60.0)
    return observe(sim)


@case
def synapses_that_differ(start: Start) -> Found:
    """Rules with a parameter value for each synapse: random, listed in any order, with Wmax of both signs."""
    net = network()
    net.population("source", 6, poisson_generator(rate=120.0))
    net.population("cells", 4, iaf_psc_exp(I_e=450.0))
    pre, post = [4, 0, 2, 0, 5], [1, 3, 0, 0, 1]
    draws = stdp(
        lambda_=uniform(low=0.0, high=0.2), mu_plus=uniform(low=0.0, high=1.0), Wmax=normal(mean=150.0, std=5.0)
    )
    net.connect(
        "source", "cells", fixed_indegree(n=5), draws, weight=60.0, delay=uniform(low=0.1, high=4.0), name="drawn"
    )
    by_synapse = stdp(alpha=np.linspace(0.5, 2.5, 5), Wmax=np.array([90.0, -80.0, 70.0, -60.0, 50.0]), lambda_=0.1)
    weight = np.array([45.0, -40.0, 35.0, -30.0, 25.0])
    net.connect("source", "cells", pairs(pre=pre, post=post), by_synapse, weight=weight, name="listed")
    nearest = stdp_nn_symm(lambda_=np.linspace(0.0, 0.2, 24).reshape(6, 4), mu_minus=0.5, pre_at_start=True)
    net.connect("source", "cells", all_to_all(), nearest, weight=50.0, name="nearest")
    homeostatic = vogels_sprekeler(eta=uniform(low=0.5, high=2.0), alpha=np.linspace(0.0, 0.4, 5), Wmax=-90.0)
    net.connect("source", "cells", pairs(pre=pre, post=post), homeostatic, weight=-30.0, name="homeostatic")
    triplets = stdp_triplet(Aplus=uniform(low=0.0, high=3.0), Aminus_triplet=np.linspace(0.0, 2.0, 5), Wmax=70.0)
    net.connect("source", "cells", pairs(pre=pre, post=post), triplets, weight=40.0, name="triplets")
    release = tsodyks2(U=np.array([0.1, 0.3, 0.5, 0.7, 0.9]), tau_fac=100.0)
    net.connect("source", "cells", pairs(pre=pre, post=post), release, weight=200.0, name="release")
    return after(start, net, 150.0)


@case
def synapses_that_come_to_differ(start: Start) -> Found:
    """Changes of a rule's parameters between runs: for each synapse, for the synapses of a view, and for all."""
    net = learner(stdp(lambda_=0.05))
    sim = start(net)
    sim.run(50.0)
    sim.set("plastic", lambda_=np.linspace(0.0, 0.3, 24), Wmax=np.linspace(200.0, 110.0, 24))
    sim.run(50.0)
    sim.set("plastic", pre=net.populations["source"][:2], alpha=2.0)
    sim.run(50.0)
    sim.set("plastic", lambda_=0.1, tau_plus=40.0)
    sim.run(50.0)
    outcome = observe(sim)
    return {**outcome, "lambda": sim.get("plastic", "lambda"), "alpha": sim.get("plastic", "alpha")}


@case
def dopamine_by_signal(start: Start) -> Found:
    """stdp_dopa whose n is set by a signal of both signs, with a value for each neuron."""
    net = learner(stdp_dopa(signal="reward", tau_c=200.0, tau_n=50.0, A_plus=0.5, A_minus=0.6, Wmax=120.0))
    net.signal("reward", to="cells")
    sim = start(net)
    for values in (0.0, 0.02, np.array([-0.03, 0.0, 0.05, 0.01]), -0.01):
        sim.signal("reward", values)
        sim.run(50.0)
    return observe(sim)


@case
def dopamine_by_spikes(start: Start) -> Found:
    """stdp_dopa modulated by spikes of a population; n crosses the baseline b, and weights reach their bounds."""
    rule = stdp_dopa(dopamine="dopa", b=0.02, tau_c=300.0, tau_n=40.0, Wmin=40.0, Wmax=80.0, dopamine_delay=1.2)
    net = learner(rule, fixed_indegree(n=4), uniform(low=0.5, high=3.0))
    net.population("dopa", 2, poisson_generator(rate=40.0))
    return after(start, net, 250.0)


@case
def dopamine_one_to_one(start: Start) -> Found:
    """stdp_dopa with one dopamine neuron for each post neuron, simultaneous spikes, and few delivery points."""
    rule = stdp_dopa(
        dopamine="dopa", dopamine_rule="one_to_one", b=0.01, tau_n=30.0, Wmin=20.0, Wmax=90.0, deliver_interval=50
    )
    net = learner(rule)
    times = [[5.0, 5.0, 80.0], [40.0, 40.1], [], [1.0, 199.9]]
    net.population("dopa", 4, spike_generator(spike_times=times))
    return after(start, net, 200.0)


@case
def dopamine_without_a_source(start: Start) -> Found:
    """stdp_dopa with neither signal nor dopamine: n stays 0, the baseline acts."""
    return after(start, learner(stdp_dopa(b=0.005, A_minus=1.0), delay=0.7), 150.0)


@case
def dopamine_from_the_target(start: Start) -> Found:
    """Dopamine from the post neurons themselves, with listed pairs."""
    net = network()
    net.population("source", 3, poisson_generator(rate=300.0))
    net.population("cells", 2, izhikevich(I_e=8.0))
    rule = stdp_dopa(dopamine="cells", A_plus=0.2, A_minus=0.1, Wmax=20.0)
    net.connect("source", "cells", pairs(pre=[0, 1, 2, 2], post=[1, 0, 0, 1]), rule, weight=5.0, delay=[2.0, 1, 1, 0.1])
    return after(start, net, 150.0)


@case
def dopamine_changes(start: Start) -> Found:
    """Changes of the rule's parameters and of the weights while dopamine acts."""
    net = learner(stdp_dopa(signal="reward", tau_c=200.0, tau_n=50.0, Wmax=150.0))
    net.signal("reward", to="cells")
    sim = start(net)
    sim.signal("reward", 0.02)
    sim.run(60.0)
    sim.set("plastic", A_plus=0.2, tau_n=20.0, b=0.001)
    sim.run(60.0)
    sim.set_weights("plastic", 75.0)
    sim.run(60.0)
    return observe(sim)
