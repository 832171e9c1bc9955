"""What NEST cannot do is refused by one message, with a way out."""

import numpy as np
import pytest

import neuro
from neuro.core.errors import ModelError, Where
from neuro.model.neurons import Neuron
from neuro.model.synapses import Synapse
from refused import refused

pytestmark = pytest.mark.usefixtures("nest")


def driven(model: Neuron | None = None, **more: object) -> neuro.Network:
    net = neuro.Network("net", **more)
    net.place = Where("here")
    net.population("source", 2, neuro.spike_generator(spike_times=[[1.0, 5.0], [2.0, 6.0]]))
    net.population("cells", 2, model or neuro.iaf_psc_exp())
    return net


def plastic(synapse: Synapse, weight: float = 10.0) -> neuro.Network:
    net = driven()
    net.connect("source", "cells", neuro.all_to_all(), synapse, weight=weight, delay=1.0, name="wires")
    return net


def network(*, resolution: float = 0.1, **words: object) -> neuro.Network:
    """One population of cells."""
    net = neuro.Network("net", resolution=resolution)
    net.place = Where("here")
    net.population("cells", 2, neuro.iaf_psc_exp(), **words)
    return net


def test_what_it_lacks(messages):
    nets = {"receptor": plastic(neuro.static(receptor="in"), 10.0), "resolution": driven(resolution=0.0625)}
    for group in (neuro.winner_take_all, neuro.lateral_reset):
        nets[group.__name__] = driven(neuro.iaf_psc_delta())
        nets[group.__name__].group("choice", group(of="cells"))
    nets["current"] = driven(neuro.iaf_psc_exp(tau_m=float("inf"), I_e=1.0))
    nets["initial"] = network(initial={"I_syn_ex": 1.0})
    nets["probe"] = driven()
    nets["probe"].probe("current", "cells", "I_syn_ex")
    nets["dopamine"] = neuro.Network("net")
    nets["dopamine"].place = Where("here")
    nets["dopamine"].population("source", 500, neuro.poisson_generator(rate=10.0))
    nets["dopamine"].population("cells", 500, neuro.iaf_psc_exp())
    rule = neuro.stdp_dopa(dopamine="source", dopamine_rule="one_to_one")
    nets["dopamine"].connect("source", "cells", neuro.one_to_one(), rule, weight=1.0)
    messages({name: refused(neuro.compile, net, "nest") for name, net in nets.items()})


def test_what_it_cannot_do_while_it_runs(messages, tmp_path):
    told = {}
    sim = neuro.compile(plastic(neuro.static(receptor="in"), -10.0), "nest")
    told["sign"] = refused(sim.set_weights, "wires", 10.0)
    del sim
    sim = neuro.compile(driven(), "nest")
    told["save"] = refused(sim.save, tmp_path / "state.h5")
    assert list(tmp_path.iterdir()) == []
    assert sim.states("cells") == ["V_m"]
    told |= {"get": refused(sim.get, "cells", "I_syn_ex"), "set": refused(sim.set, "cells", I_syn_ex=1.0)}
    told["a second simulation"] = refused(neuro.compile, driven(), "nest")
    sim.run(3.0)
    assert sim.time == 3.0
    del sim
    sim = neuro.compile(plastic(neuro.stdp()), "nest")
    sim.set("wires", lambda_=0.5)
    sim.set_weights("wires", [1.0, 2.0, 3.0, 4.0])
    assert sim.weights("wires")[2].tolist() == [1.0, 2.0, 3.0, 4.0]
    sim.run(1.0)
    told |= {"rule": refused(sim.set, "wires", lambda_=0.1), "weights": refused(sim.set_weights, "wires", 1.0)}
    del sim
    net = plastic(neuro.stdp_dopa(signal="reward", deliver_interval=3))
    net.signal("reward", to="cells")
    sim = neuro.compile(net, "nest")
    sim.run(4.0)
    told |= {"dopamine": refused(sim.get, "wires", "c"), "signal": refused(sim.signal, "reward", 1.0)}
    sim.run(2.0)
    sim.signal("reward", [0.5, -0.5])
    assert sim.get("wires", "n").tolist() == [0.5, -0.5, 0.5, -0.5]
    messages(told)


def test_a_network_of_the_users_own(messages):
    import nest

    nest.ResetKernel()
    own = nest.Create("iaf_psc_exp", 3, {"V_m": -61.0})
    messages({"3 nodes": refused(neuro.compile, driven(), "nest")})
    assert own.get("V_m") == (-61.0, -61.0, -61.0)
    nest.ResetKernel()
    neuro.compile(driven(), "nest").run(1.0)
    nest.ResetKernel()
    nest.Create("iaf_psc_exp", 2)
    messages({"2 nodes": refused(neuro.compile, driven(), "nest")})
    nest.ResetKernel()


def test_an_error_of_nest_is_ours_and_changes_nothing():
    sim = neuro.compile(driven(), "nest")
    cells = sim._engine.net.cells[1]
    with pytest.raises(ModelError, match=r"NEST: .*Capacitance must be strictly positive"):
        cells.set({"V_m": np.array([-60.0, -61.0]), "C_m": np.array([1.0, -1.0])})
    assert sim.get("cells", "V_m").tolist() == [-70.0, -70.0]
    assert sim.get("cells", "C_m").tolist() == [250.0, 250.0]
