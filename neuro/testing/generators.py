"""Cases of generators whose current or rate changes, and of currents to a receptor."""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.network import Network
from neuro.model.neurons import (
    Generator,
    ac_generator,
    dc_generator,
    gamma_sup_generator,
    iaf_psc_alpha,
    iaf_psc_exp,
    inhomogeneous_poisson_generator,
    noise_generator,
    parrot_neuron,
    sinusoidal_poisson_generator,
    spike_train,
    step_current_generator,
)
from neuro.model.rules import all_to_all, one_to_one
from neuro.model.synapses import static
from neuro.testing.case import Found, Start, case, network, observe


def steered(model: Generator, n: int = 2) -> Network:
    """Neurons that one current drives over several delays and weights, and another that is constant."""
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
    """Run, set numbers of the source and weights while some of what it sent is under way, and run on."""
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
    """step_current_generator: a value for each neuron from listed times on, between start and stop."""
    values = np.array([[100.0, -50.0, 400.0], [300.0, 0.0, 200.0]])
    listed = step_current_generator(amplitude_times=[0.1, 12.0, 20.5], amplitude_values=values, start=2.0, stop=44.0)
    return set_twice(start, steered(listed))


@case
def sinusoidal_currents(start: Start) -> Found:
    """ac_generator: numbers of each neuron, set on the way."""
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
    """noise_generator: one noise of each neuron for all its targets, held for some steps."""
    return set_twice(start, steered(noise_generator(mean=100.0, std=400.0, dt=0.7, individual_noise=False)), mean=-50.0)


@case
def currents_to_a_receptor(start: Start) -> Found:
    """A current that a receptor filters, of either sign, beside one that acts as it is."""
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
    """Each receptor filters by its own time constant, which neurons may not share."""
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
    """Parrots that say what generators say, and neurons that hear it."""
    net = network()
    net.population("source", n, model)
    net.population("relay", n, parrot_neuron())
    net.population("cells", 3, iaf_psc_exp())
    net.connect("source", "relay", one_to_one(), delay=0.3)
    net.connect("relay", "cells", all_to_all(), weight=120.0, delay=0.8)
    return net


@case
def rates_that_step(start: Start) -> Found:
    """inhomogeneous_poisson_generator: a rate of each neuron from listed times on."""
    rates = np.array([[0.0, 900.0, 20.0], [5000.0, 0.0, 900.0], [60.0, 60.0, 60.0], [9.0, 8000.0, 0.0]])
    sim = start(
        emitting(inhomogeneous_poisson_generator(rate_times=[0.1, 20.0, 31.5], rate_values=rates, start=2.0, stop=45.0))
    )
    sim.run(25.5)
    sim.run(24.5)
    return observe(sim)


@case
def rates_that_follow_a_sine(start: Start) -> Found:
    """sinusoidal_poisson_generator: rates that are cut off at 0, set on the way."""
    amplitude = np.array([0.0, 500.0, 3000.0, -700.0])
    net = emitting(sinusoidal_poisson_generator(rate=800.0, amplitude=amplitude, frequency=40.0, phase=20.0, start=3.0))
    sim = start(net)
    sim.run(25.0)
    sim.set("source", rate=300.0, phase=90.0)
    sim.run(25.0)
    return observe(sim)


@case
def spikes_of_gamma_processes(start: Start) -> Found:
    """gamma_sup_generator: processes in stages, whose rate is set on the way."""
    sim = start(emitting(gamma_sup_generator(rate=np.array([5.0, 20.0, 60.0, 0.0]), gamma_shape=3, n_proc=40)))
    sim.run(25.0)
    sim.set("source", rate=30.0)
    sim.run(25.0)
    return observe(sim)


@case
def recorded_spikes(start: Start) -> Found:
    """spike_train: what was recorded is emitted again, two at one time as one of multiplicity 2."""
    rows = np.array([[0.1, 2.0], [0.1, 0.0], [0.1, 2.0], [7.3, 1.0], [30.0, 3.0]])
    sim = start(emitting(spike_train(spikes=rows)))
    sim.run(40.0)
    return observe(sim)
