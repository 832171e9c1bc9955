"""What NEST cannot do is refused by one message, with a way out."""

import numpy as np
import pytest

import neuro
from neuro.core.errors import ModelError, Where
from neuro.model.neurons import Neuron
from neuro.model.synapses import Synapse

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


def refusal(net: neuro.Network) -> str:
    with pytest.raises(ModelError) as told:
        neuro.compile(net, "nest")
    head, _, rest = str(told.value).partition("\n")
    assert head == "backend 'nest' cannot run this network (1 problem)"
    return rest


def test_a_receptor_that_no_sign_chooses():
    def net(receptor: str, weight: float) -> neuro.Network:
        return plastic(neuro.static(receptor=receptor), weight)

    assert refusal(net("in", 10.0)) == (
        "here: projection 'wires': receptor 'in' by name: NEST sends weights above 0 to ex and weights below 0 to in\n"
        "  hint: backend 'event' runs it"
    )
    sim = neuro.compile(net("in", -10.0), "nest")
    assert told_by(lambda: sim.set_weights("wires", 10.0)) == (
        "weights of 'wires' onto receptor 'in': NEST sends weights above 0 to ex and weights below 0 to in\n"
        "  hint: backend 'event' runs it"
    )


def test_a_second_simulation():
    first = neuro.compile(driven(), "nest")
    with pytest.raises(ModelError) as told:
        neuro.compile(driven(), "nest")
    assert str(told.value) == (
        "backend 'nest' cannot run 'net' beside 'net': a process has one NEST\n"
        "  hint: drop the first simulation (del sim), or run each in a process of its own"
    )
    first.run(3.0)
    assert first.time == 3.0
    del first, told
    neuro.compile(driven(), "nest").run(1.0)


def test_a_network_of_the_users_own():
    import nest

    nest.ResetKernel()
    own = nest.Create("iaf_psc_exp", 3, {"V_m": -61.0})
    assert told_by(lambda: neuro.compile(driven(), "nest")) == (
        "backend 'nest' cannot run 'net': NEST holds a network of 3 nodes of your own: expected an empty NEST, as a "
        "process has one\n  hint: call nest.ResetKernel() first, which drops that network, or use a process of its own"
    )
    assert own.get("V_m") == (-61.0, -61.0, -61.0)
    nest.ResetKernel()
    neuro.compile(driven(), "nest").run(1.0)
    nest.ResetKernel()
    nest.Create("iaf_psc_exp", 2)
    assert "NEST holds a network of 2 nodes" in told_by(lambda: neuro.compile(driven(), "nest"))
    nest.ResetKernel()


def test_a_resolution_off_its_clock():
    assert refusal(driven(resolution=0.0625)) == (
        "resolution = 0.0625 ms: NEST's clock ticks in 0.001 ms\n  hint: use a multiple of it"
    )


def test_a_group():
    net = driven(neuro.iaf_psc_delta())
    net.group("choice", neuro.winner_take_all(of="cells"))
    assert refusal(net) == "here: group 'choice': NEST has no winner-take-all\n  hint: backend 'event' runs it"
    net = driven(neuro.iaf_psc_delta())
    net.group("first", neuro.lateral_reset(of="cells"))
    assert refusal(net) == "here: group 'first': NEST has no lateral reset\n  hint: backend 'event' runs it"


def test_a_current_without_leak():
    assert refusal(driven(neuro.iaf_psc_exp(tau_m=float("inf"), I_e=1.0))) == (
        "here: population 'cells': a current without leak: with an infinite tau_m NEST's propagator of a current, "
        "tau_m / C_m (1 - exp(-h / tau_m)), is no number\n  hint: use a large tau_m, say 1e6"
    )


def test_an_initial_current():
    net = neuro.Network("net")
    net.place = Where("here")
    net.population("cells", 2, neuro.iaf_psc_exp(), initial={"I_syn_ex": 1.0})
    assert refusal(net) == (
        "here: population 'cells': initial I_syn_ex: NEST's starts at 0\n  hint: backend 'event' runs it"
    )


def test_a_probe_of_a_current():
    net = driven()
    net.probe("current", "cells", "I_syn_ex")
    assert refusal(net) == ("here: probe 'current': I_syn_ex: NEST does not show it between steps\n  hint: probe V_m")


def test_too_many_dopamines():
    net = neuro.Network("net")
    net.place = Where("here")
    net.population("source", 500, neuro.poisson_generator(rate=10.0))
    net.population("cells", 500, neuro.iaf_psc_exp())
    rule = neuro.stdp_dopa(dopamine="source", dopamine_rule="one_to_one")
    net.connect("source", "cells", neuro.one_to_one(), rule, weight=1.0)
    assert refusal(net) == (
        "here: projection 'source_cells': dopamine_rule = one_to_one: the network needs 500 copies of NEST's synapse "
        "model, and NEST holds 430\n  hint: write each neuron's dopamine by a signal"
    )


def told_by(call: object) -> str:
    with pytest.raises(ModelError) as told:
        call()
    return str(told.value)


def test_saving_and_restoring(tmp_path):
    sim = neuro.compile(driven(), "nest")
    text = (
        "backend 'nest' cannot save: NEST has no way to write or read its state\n"
        "  hint: backend 'event' saves and restores; sim.network() keeps what was learnt"
    )
    assert told_by(lambda: sim.save(tmp_path / "state.h5")) == text
    assert list(tmp_path.iterdir()) == []


def test_a_rule_that_changes_while_it_runs():
    sim = neuro.compile(plastic(neuro.stdp()), "nest")
    sim.set("wires", lambda_=0.5)
    sim.set_weights("wires", [1.0, 2.0, 3.0, 4.0])
    assert sim.weights("wires")[2].tolist() == [1.0, 2.0, 3.0, 4.0]
    sim.run(1.0)
    assert told_by(lambda: sim.set("wires", lambda_=0.1)) == (
        "the numbers of 'wires' cannot change once it runs: NEST's stdp_synapse would apply them to post spikes from "
        "before, too\n  hint: change them at time 0, or use backend 'event'"
    )
    assert told_by(lambda: sim.set_weights("wires", 1.0)).startswith(
        "the weights of 'wires' cannot change once it runs"
    )


def test_dopamine_between_its_moments():
    net = plastic(neuro.stdp_dopa(signal="reward", deliver_interval=3))
    net.signal("reward", to="cells")
    sim = neuro.compile(net, "nest")
    sim.run(4.0)
    assert told_by(lambda: sim.get("wires", "c")) == (
        "'c' of 'wires' at 4 ms: NEST brings synapses under dopamine up to date every 3 ms (deliver_interval x the "
        "smallest delay): expected a multiple of it\n  hint: run to 6 ms"
    )
    assert told_by(lambda: sim.signal("reward", 1.0)).startswith("signal 'reward' at 4 ms: NEST brings synapses")
    sim.run(2.0)
    sim.signal("reward", [0.5, -0.5])
    assert sim.get("wires", "n").tolist() == [0.5, -0.5, 0.5, -0.5]


def test_a_current_that_nest_does_not_show():
    sim = neuro.compile(driven(), "nest")
    assert sim.states("cells") == ["V_m"]
    text = (
        "I_syn_ex of 'cells': NEST neither shows nor sets it between steps\n"
        "  hint: backend 'event' has the same network and shows it"
    )
    assert told_by(lambda: sim.get("cells", "I_syn_ex")) == text
    assert told_by(lambda: sim.set("cells", I_syn_ex=1.0)) == text


def test_an_error_of_nest_is_ours_and_changes_nothing():
    sim = neuro.compile(driven(), "nest")
    cells = sim._engine.net.cells[1]
    with pytest.raises(ModelError, match=r"NEST: .*Capacitance must be strictly positive"):
        cells.set({"V_m": np.array([-60.0, -61.0]), "C_m": np.array([1.0, -1.0])})
    assert sim.get("cells", "V_m").tolist() == [-70.0, -70.0]
    assert sim.get("cells", "C_m").tolist() == [250.0, 250.0]
