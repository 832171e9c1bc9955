"""Cases of neurons, generators and groups, and of values that are set and read between runs."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    Model,
    dc_generator,
    event_camera,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import lateral_reset, winner_take_all
from neuro.model.rules import (
    all_to_all,
    grid,
    one_to_one,
)
from neuro.testing.case import Found, Start, after, case, integers_too, network, observe

INF = float("inf")


def driven(model: Model, n: int = 3, weight: float = 300.0) -> Network:
    """Return neurons of one model with excitatory and inhibitory input spikes."""
    net = network()
    net.population("plus", n, poisson_generator(rate=2000.0))
    net.population("minus", n, poisson_generator(rate=800.0))
    net.population("cells", n, model)
    net.connect("plus", "cells", one_to_one(), weight=weight, delay=0.3)
    net.connect("minus", "cells", one_to_one(), weight=-weight, delay=1.1)
    net.probe("spikes_plus", "plus")
    for state in model.states:
        if not state.hidden:
            net.probe(f"probe_{state.name}", "cells", state.name, every=0.5)
    return net


# neurons


@case
def delta_neuron(start: Start) -> Found:
    """iaf_psc_delta, leaky, with a lower bound."""
    return after(start, driven(iaf_psc_delta(V_min=-75.0, I_e=120.0), weight=3.0))


@case
def delta_neuron_keeps_refractory_input(start: Start) -> Found:
    """iaf_psc_delta with refractory_input."""
    return after(start, driven(iaf_psc_delta(refractory_input=True, t_ref=4.0), weight=5.0))


@case
def exponential_neuron(start: Start) -> Found:
    """iaf_psc_exp with a constant current and unequal synaptic time constants."""
    return after(start, driven(iaf_psc_exp(I_e=250.0, tau_syn_in=5.0)))


@case
def exponential_neuron_equal_time_constants(start: Start) -> Found:
    """iaf_psc_exp with tau_syn equal to tau_m, and without refractoriness."""
    return after(start, driven(iaf_psc_exp(tau_syn_ex=10.0, tau_m=10.0, t_ref=0.0)))


@case
def exponential_neuron_without_leak(start: Start) -> Found:
    """iaf_psc_exp with an infinite tau_m."""
    return after(start, driven(iaf_psc_exp(tau_m=INF)))


@case
def alpha_neuron(start: Start) -> Found:
    """iaf_psc_alpha with a constant current and a lower bound."""
    return after(start, driven(iaf_psc_alpha(I_e=300.0, V_min=-80.0)))


@case
def alpha_neuron_equal_time_constants(start: Start) -> Found:
    """iaf_psc_alpha with tau_syn equal to tau_m, and with an infinite tau_m."""
    return after(start, driven(iaf_psc_alpha(tau_syn_ex=10.0, tau_m=np.array([10.0, 20.0, INF]))))


@case
def izhikevich_neuron(start: Start) -> Found:
    """Izhikevich neurons of three kinds: regular spiking, fast spiking, chattering."""
    kinds = izhikevich(
        a=np.array([0.02, 0.1, 0.02]), c=np.array([-65.0, -65.0, -50.0]), d=np.array([8.0, 2.0, 2.0]), I_e=10.0
    )
    return after(start, driven(kinds, weight=2.0), 120.0)


@case
def parrots_keep_multiplicity(start: Start) -> Found:
    """Parrots repeat every spike with its multiplicity, whatever the weight."""
    net = network(1.0)
    net.population("source", 2, poisson_generator(rate=1500.0))
    net.population("first", 2, parrot_neuron())
    net.population("second", 3, parrot_neuron())
    net.population("cells", 3, iaf_psc_delta(V_th=-50.0))
    net.connect("source", "first", one_to_one(), weight=0.25)
    net.connect("first", "second", all_to_all(), weight=-2.0, delay=3.0)
    net.connect("second", "cells", one_to_one(), weight=1.5)
    return after(start, net)


@case
def parameters_of_each_neuron(start: Start) -> Found:
    """Parameters as arrays and as distributions."""
    model = iaf_psc_exp(tau_m=uniform(low=8.0, high=30.0), V_th=np.array([-55.0, -54.0, -53.5]), I_e=400.0)
    return after(start, driven(model))


@case
def initial_states(start: Start) -> Found:
    """Initial states as number, array and distribution."""
    net = network()
    net.population("a", 4, iaf_psc_exp(), initial={"V_m": np.linspace(-70, -56, 4), "I_syn_ex": 500.0})
    net.population("b", (2, 2), izhikevich(), initial={"V_m": uniform(low=-70.0, high=-50.0)})
    net.population("c", 3, iaf_psc_delta(E_L=np.array([-70.0, -60.0, -54.0]), V_reset=-75.0))
    return after(start, net, 10.0)


# generators


@case
def poisson_window(start: Start) -> Found:
    """A Poisson generator emits in start < t <= stop, with a rate for each neuron."""
    net = network()
    net.population("source", 4, poisson_generator(rate=np.array([0.0, 500.0, 20000.0, 9.0]), start=2.0, stop=9.0))
    net.probe("spikes", "source")
    return after(start, net, 12.0)


@case
def poisson_rates_change(start: Start) -> Found:
    """Rates that are set between runs."""
    net = driven(iaf_psc_exp())
    sim = start(net)
    for rate in (0.0, 5000.0, np.array([100.0, 0.0, 9000.0])):
        sim.set("plus", rate=rate)
        sim.run(15.0)
    return observe(sim)


@case
def listed_spikes(start: Start) -> Found:
    """A spike_generator with listed spikes, two of them at one time."""
    net = network()
    net.population("source", 2, spike_generator(spike_times=[[0.1, 0.1, 3.0], [0.1, 2.0, 3.0]]))
    net.population("cells", 2, iaf_psc_delta())
    net.connect("source", "cells", all_to_all(), weight=4.0, delay=0.1)
    return after(start, net, 6.0)


@case
def injected_spikes(start: Start) -> Found:
    """Spikes injected between runs, in addition to listed spikes."""
    net = network()
    net.population("source", 3, spike_generator(spike_times=[[4.0], [], [5.0]]))
    net.population("cells", 3, iaf_psc_exp())
    net.connect("source", "cells", one_to_one(), weight=2500.0, delay=1.0)
    sim = start(net)
    sim.inject("source", [1.0, 0.2, 4.0, 7.5], [2, 0, 0, 1])
    sim.run(3.0)
    sim.inject("source", [3.1, 3.1, 7.5], [1, 1, 1])
    sim.run(12.0)
    return observe(sim)


if find_spec("neuro_events") is not None:  # the package that plays recordings

    @case
    def played_events(start: Start) -> Found:
        """An event camera that plays a recording and receives events; a pixel may have several in one step."""
        from neuro_events import Events

        t = np.sort(np.random.default_rng(4).integers(5_000, 25_000, 400))
        x, y, p = (t * 7 % 5).astype(np.uint16), (t * 3 % 4).astype(np.uint16), (t // 2 % 2).astype(np.uint8)
        events = Events(t, x, y, p, (5, 4))
        net = network()
        net.population("camera", "auto", event_camera(events=[events[:150], events[150:]], start=1.0))
        net.population("cells", 40, iaf_psc_exp())
        net.connect("camera", "cells", one_to_one(), weight=900.0, delay=0.5)
        net.probe("sent", "camera")
        sim = start(net)
        for ms in (0.1, 7.9):
            sim.run(ms)
        sim.feed("camera", events[200:220])
        sim.run(20.0)
        return observe(sim)


@case
def currents(start: Start) -> Found:
    """Currents switched on and off, scaled by weights, with several delays, and set while they flow."""
    net = network()
    net.population("source", 2, dc_generator(amplitude=np.array([300.0, 500.0]), start=2.0, stop=40.0))
    net.population("always", 1, dc_generator(amplitude=50.0))
    net.population("cells", 3, iaf_psc_exp())
    net.population("others", 2, izhikevich())
    delays = np.array([[1.0, 0.1, 2.5], [0.3, 1.0, 1.0]])
    net.connect("source", "cells", all_to_all(), weight=1.5, delay=delays)
    net.connect("always", "cells", all_to_all(), weight=np.array([[1.0, -1.0, 0.5]]))
    net.connect("source", "others", one_to_one(), weight=0.04, delay=0.1)
    net.probe("V_m", "cells", "V_m")
    sim = start(net)
    sim.run(20.0)
    sim.set("source", amplitude=np.array([0.0, 800.0]))
    sim.run(30.0)
    return observe(sim)


# groups


@integers_too
@case
def first_to_fire(start: Start) -> Found:
    """winner_take_all with first_to_fire: one decision until a reset; ties are drawn."""
    net = network(1.0)
    net.population("tick", 1, spike_generator(spike_times=[[2.0, 4.0, 6.0]]))
    net.population("cells", 6, iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=3.0))
    net.connect("tick", "cells", all_to_all(), weight=2.0)
    net.group("choice", winner_take_all(of="cells"))
    sim = start(net, seed=3)
    sim.run(10.0)
    before_reset = observe(sim)
    sim.reset()
    sim.run(10.0)
    return before_reset | {f"after reset: {name}": values for name, values in observe(sim).items()}


@case
def maps_that_reset_each_other(start: Start) -> Found:
    """lateral_reset among the maps of a grid, after a long silence and with ties; the maps feed another grid."""
    net = network(1.0)
    trains = [[1.0, 2.0, 60.0, 61.0, 62.0, 63.0]] * 20 + [[62.0]] * 22
    net.population("sheet", (6, 7), spike_generator(spike_times=trains))
    net.population("maps", (3, "auto", "auto"), iaf_psc_delta(tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=5.0, t_ref=1.0))
    net.population("top", (2, "auto", "auto"), iaf_psc_delta(tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=2.0))
    kernels = np.ones((3, 1, 3, 3))
    kernels[2] = np.arange(9.0).reshape(3, 3) / 8.0
    net.connect("sheet", "maps", grid(kernel=(3, 3)), weight=kernels)
    net.connect("maps", "top", grid(kernel=(2, 2)), weight=1.5)
    net.group("one", lateral_reset(of="maps", axis=0))
    net.probe("V_m", "maps", "V_m")
    return after(start, net, 80.0)


# calls


@case
def states_and_parameters_change(start: Start) -> Found:
    """States and parameters that are set between runs."""
    sim = start(driven(iaf_psc_exp()))
    sim.run(7.0)
    sim.set("cells", V_m=np.array([-56.0, -80.0, -60.0]), I_syn_ex=800.0)
    sim.run(7.0)
    sim.set("cells", tau_m=np.array([5.0, 10.0, 40.0]), I_e=300.0)
    sim.run(7.0)
    sim.set("cells", V_th=-50.0, V_reset=-52.0, t_ref=1.0)
    sim.run(20.0)
    return observe(sim) | {"tau_m": sim.get("cells", "tau_m"), "V_th": sim.get("cells", "V_th")}


@case
def static_weights_change(start: Start) -> Found:
    """New weights act on later spikes; spikes in flight keep the old weights."""
    net = network()
    net.population("source", 2, spike_generator(spike_times=[[0.1, 1.0, 2.0], [0.1, 1.0, 2.0]]))
    net.population("cells", 2, iaf_psc_delta(V_th=0.0))
    net.connect("source", "cells", all_to_all(), weight=1.0, delay=1.5, name="shared")
    net.connect("source", "cells", all_to_all(), weight=np.array([[1.0, 2.0], [3.0, 4.0]]), delay=0.8, name="own")
    sim = start(net)
    sim.run(1.5)
    sim.set_weights("shared", 5.0)
    sim.set_weights("own", [0.0, -1.0, 2.0, 10.0])
    sim.run(0.9)
    earlier = observe(sim)
    sim.set_weights("shared", [1.0, 2.0, 3.0, 4.0])
    sim.run(3.0)
    return earlier | {f"later: {name}": values for name, values in observe(sim).items()}


@case
def forgotten_spikes(start: Start) -> Found:
    """Old spikes are forgotten, and spikes since a given time are read."""
    sim = start(driven(iaf_psc_exp(I_e=500.0)))
    sim.run(40.0)
    sim.forget(before=20.0)
    times, ids = sim.spikes("cells", since=30.0)
    return observe(sim) | {"since": np.rint(times * 10).astype(int), "who": ids}
