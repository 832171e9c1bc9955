"""The networks that the laws are tried on, and how each is steered while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    dc_generator,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import winner_take_all
from neuro.model.rules import all_to_all, fixed_indegree, one_to_one, pairwise_bernoulli
from neuro.model.synapses import stdp, stdp_dopa
from neuro.run.simulation import Simulation
from neuro.testing.case import network


@dataclass(frozen=True, slots=True)
class Subject:
    """A network that laws are tried on; it has populations "relay" and "exp" that spike by chance.

    Attributes:
        suffix: of the names of its cases.
        about: what it has.
        make: makes it.
        steer: changes all that may change between runs; called with 0 at the start of a run and with 1 in the middle.
        floats: whether a backend that computes in integers cannot run it.
    """

    suffix: str
    about: str
    make: Callable[[], Network]
    steer: Callable[[Simulation, int], None]
    floats: bool = False


def rich() -> Network:
    """A recurrent network of all models and rules, with noise, dopamine and a signal."""
    net = network()
    net.population("noise", 12, poisson_generator(rate=700.0))
    net.population("relay", 12, parrot_neuron())
    net.population("exp", 12, iaf_psc_exp(tau_m=uniform(low=8.0, high=15.0)), initial={"V_m": -60.0})
    net.population("delta", 9, iaf_psc_delta(V_th=-60.0))
    net.population("alpha", 6, iaf_psc_alpha(I_e=300.0))
    net.population("izhi", 5, izhikevich(I_e=6.0))
    net.signal("reward", to="delta")
    net.connect("noise", "relay", one_to_one(), delay=0.1)
    net.connect("relay", "exp", one_to_one(), weight=350.0, delay=0.4)
    net.connect("exp", "exp", pairwise_bernoulli(p=0.3), weight=normal(mean=50, std=90), delay=uniform(low=0.1, high=4))
    net.connect("exp", "delta", all_to_all(), stdp(Wmax=6.0, lambda_=0.1), weight=3.0, delay=1.5)
    rule = stdp_dopa(signal="reward", Wmax=9.0, A_plus=0.1, A_minus=0.08, tau_n=30.0)
    net.connect("relay", "delta", fixed_indegree(n=5), rule, weight=2.0, delay=uniform(low=0.1, high=2))
    dopamine = stdp_dopa(dopamine="izhi", Wmax=400.0, A_plus=2.0, b=0.01, tau_n=20.0, deliver_interval=7)
    net.connect("delta", "alpha", all_to_all(), dopamine, weight=200.0, delay=0.8)
    net.connect("alpha", "izhi", fixed_indegree(n=3), weight=5.0, delay=2.0)
    return net


def steer_rich(sim: Simulation, half: int) -> None:
    """Another rate, another learning rate and a signal."""
    sim.set("noise", rate=(500.0, 900.0)[half])
    sim.set("exp_delta", lambda_=(0.1, 0.02)[half])
    sim.signal("reward", 0.05 * half)


def wired() -> Network:
    """A recurrent network of what a chip has, with fixed weights, noise, listed spikes, currents and a group."""
    net = network(1.0)
    net.population("noise", 12, poisson_generator(rate=50.0))
    times = [np.arange(3.0 + k, 200.0, 17.0 + k) for k in range(3)]
    net.population("listed", 3, spike_generator(spike_times=times))
    net.population("current", 1, dc_generator(amplitude=150.0, start=20.0, stop=300.0))
    net.population("relay", 12, parrot_neuron())
    net.population("exp", 12, iaf_psc_exp(tau_m=uniform(low=8.0, high=15.0)), initial={"V_m": -60.0})
    net.population("delta", 9, iaf_psc_delta(V_th=-60.0, t_ref=1.0))
    net.connect("noise", "relay", one_to_one(), delay=1.0)
    net.connect("relay", "exp", one_to_one(), weight=900.0, delay=4.0)
    net.connect("exp", "exp", pairwise_bernoulli(p=0.3), weight=normal(mean=80, std=150), delay=uniform(low=1, high=9))
    net.connect("exp", "delta", all_to_all(), weight=np.tile([4.0, 3.0, -1.0], (12, 3)), delay=2.0)
    net.connect("relay", "delta", fixed_indegree(n=5), weight=normal(mean=2.0, std=2.0), delay=3.0)
    net.connect("listed", "exp", all_to_all(), weight=uniform(low=0.0, high=500.0), delay=2.0)
    net.connect("current", "exp", all_to_all())
    net.group("choice", winner_take_all(of="delta", first_to_fire=False))
    return net


def steer_wired(sim: Simulation, half: int) -> None:
    """Other rates, currents, parameters, states and weights, and spikes that are injected."""
    sim.set("noise", rate=(40.0, np.linspace(0.0, 90.0, 12))[half])
    sim.set("current", amplitude=(150.0, 60.0)[half])
    sim.set("exp", V_th=(-55.0, -56.5)[half], tau_m=(10.0, np.linspace(8.0, 14.0, 12))[half])
    sim.set("exp", V_m=np.linspace(-70.0, -58.0, 12))
    sim.set_weights("exp_delta", (3.0, np.linspace(-1.0, 4.0, 108))[half])
    sim.inject("listed", sim.time + np.array([1.0, 1.0, 30.0]), [0, 2, 1])


def learning() -> Network:
    """Spikes and a signal that teach: stdp, and stdp_dopa by a signal and by spikes."""
    net = network(1.0)
    net.population("noise", 12, poisson_generator(rate=40.0))
    net.population("relay", 12, parrot_neuron())
    net.population("exp", 6, iaf_psc_exp(), initial={"V_m": -60.0})
    net.population("delta", 4, iaf_psc_delta(V_th=-60.0, t_ref=1.0))
    net.population("reached", 5, iaf_psc_delta(V_th=-64.0, tau_m=20.0))
    net.signal("reward", to="delta")
    net.connect("noise", "relay", one_to_one(), delay=1.0)
    rule = stdp(Wmax=900.0, lambda_=0.1)
    net.connect("relay", "exp", all_to_all(), rule, weight=uniform(low=200.0, high=800.0), delay=3.0)
    by_signal = stdp_dopa(signal="reward", Wmax=9.0, A_plus=0.1, A_minus=0.08, tau_n=30.0, tau_c=100.0)
    net.connect("relay", "delta", fixed_indegree(n=5), by_signal, weight=4.0, delay=2.0)
    by_spikes = stdp_dopa(dopamine="exp", Wmax=9.0, A_plus=0.1, A_minus=0.08, tau_n=30.0, tau_c=100.0, dopamine_delay=4)
    net.connect("exp", "delta", all_to_all(), by_spikes, weight=3.0, delay=1.0)
    net.connect("exp", "reached", fixed_indegree(n=3), stdp(Wmax=8.0, lambda_=0.1), weight=4.0, delay=5.0)
    return net


def steer_learning(sim: Simulation, half: int) -> None:
    """Another rate, threshold and weights, and a signal."""
    sim.set("noise", rate=(40.0, 60.0)[half])
    sim.set("exp", V_th=(-55.0, -57.0)[half])
    if half:
        sim.set_weights("relay_exp", np.linspace(200.0, 700.0, 72))
    sim.signal("reward", (0.02, -0.01)[half])


SUBJECTS = (
    Subject("", "all models and rules", rich, steer_rich, floats=True),
    Subject("_of_fixed_weights", "fixed weights, for chips", wired, steer_wired),
    Subject("_of_learning", "pairwise learning, for chips", learning, steer_learning),
)
