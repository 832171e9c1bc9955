"""Parameters that NEST refuses are named before anything is built."""

from typing import Any

import numpy as np
import pytest

import neuro
from neuro.core.errors import ModelError, Where
from neuro.model.neurons import MODELS, Neuron
from neuro.model.synapses import Synapse
from neuro_nest.tables import NODES
from refused import refusals_of, refused

NEURONS = [name for name in NODES if MODELS[name].role == "neuron" and name != "parrot_neuron"]

NUMBERS = (0.0, 1e-6, 1e-4, 0.1, 1.0, 2.0, 10.0, 100.0, 1e3, 1e6)


def net_of(model: Any) -> neuro.Network:
    net = neuro.Network("net")
    net.place = Where("here")
    net.population("c", 2, model)
    return net


def test_a_value_that_nest_refuses(nest, messages):
    messages(refusals_of(messages.cases, globals()))


def test_a_change_that_nest_refuses(nest, messages):
    for model, word, value in (
        (neuro.aeif_cond_exp(), "Delta_T", [2.0, 1e-4]),
        (neuro.aeif_psc_exp(), "V_th", 10.0),
        (neuro.mat2_psc_exp(), "tau_m", 1.0),
        (neuro.iaf_psc_exp(), "tau_syn_ex", 1e-5),
    ):
        sim = neuro.compile(net_of(model), "nest")
        messages({model.name: refused(sim.set, "c", **{word: value})})
        assert sim.get("c", word).tolist() == [model.parameters()[word]] * 2
        del sim


def test_the_fastest_synapse_that_nest_has(nest):
    """A step of 700 time constants is that of the reference."""
    for kind in (neuro.iaf_psc_exp, neuro.iaf_psc_alpha, neuro.mat2_psc_exp):
        net = neuro.Network("net")
        net.population("s", 1, neuro.spike_generator(spike_times=[[1.0]]))
        net.population("c", 1, kind(tau_syn_ex=0.1 / 700))
        net.connect("s", "c", neuro.all_to_all(), weight=1e6)
        potentials = []
        for backend in ("reference", "nest"):
            sim = neuro.compile(net, backend)
            sim.run(2.5)
            potentials.append(float(sim.get("c", "V_m")[0]))
            del sim
        assert potentials[0] != kind().parameters()["E_L"]
        assert potentials[1] == pytest.approx(potentials[0], rel=1e-12)


def test_an_instability_names_the_population(nest, messages):
    net = neuro.Network("net")
    net.population("s", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("c", 2, neuro.aeif_psc_exp())
    net.population("other", 2, neuro.aeif_psc_exp())
    net.connect("s", "c", neuro.all_to_all(), weight=-1e7)
    sim = neuro.compile(net, "nest")
    messages({"instability": refused(sim.run, 5.0), "afterwards": refused(sim.run, 5.0)})
    sim.reset()
    sim.run(0.5)
    assert sim.time == 0.5


@pytest.mark.parametrize("name", NEURONS)
def test_what_check_passes_is_built(name, nest):
    """Extreme and equal parameters: NEST has no objection that `check` had not."""
    rng = np.random.default_rng(len(name))
    kind = MODELS[name]
    quantities, defaults = kind.quantities(), kind.defaults()
    numbers = [word for word, q in quantities.items() if q.kind == "number" and word != "rk4_substeps"]
    built = 0
    for _ in range(40):
        values: dict[str, float] = {}
        for word in rng.choice(numbers, rng.integers(1, 3), replace=False):
            equal = [defaults[other] for other in numbers if quantities[other].unit == quantities[word].unit]
            off = float(rng.choice([0.0, 0.0, 1.0, -1.0]))
            extreme = float(rng.choice(NUMBERS) * rng.choice([1.0, -1.0]))
            values[str(word)] = float(rng.choice(equal)) + off if rng.integers(2) else extreme
        if "t_ref" in values:
            values["t_ref"] = float(rng.choice([0.0, 0.1, 100.0]))
        net = neuro.Network("extreme")
        try:
            net.population("c", 1, kind(**values))
            neuro.compile(net, "nest")
            built += 1
        except neuro.ModelError as error:
            if str(error).startswith("NEST: "):
                pytest.fail(f"{values}: {error}")
    assert built > 3


pytestmark = pytest.mark.usefixtures("nest")


def driven(model: Neuron | None = None, **more: object) -> neuro.Network:
    net = neuro.Network("net", **more)
    net.place = Where("here")
    net.population("source", 2, neuro.spike_generator(spike_times=[[1.0, 5.0], [2.0, 6.0]]))
    net.population("cells", 2, model or neuro.iaf_psc_exp())
    return net


def plastic(*synapses: Synapse, weight: float = 10.0) -> neuro.Network:
    net = driven()
    for name, synapse in zip(("wires", "others"), synapses, strict=False):
        net.connect("source", "cells", neuro.all_to_all(), synapse, weight=weight, delay=1.0, name=name)
    return net


def network(*, resolution: float = 0.1, **words: object) -> neuro.Network:
    """One population of cells."""
    net = neuro.Network("net", resolution=resolution)
    net.place = Where("here")
    net.population("cells", 2, neuro.iaf_psc_exp(), **words)
    return net


def test_what_it_lacks(messages):
    nets = {"receptor": plastic(neuro.static(receptor="in")), "resolution": driven(resolution=0.0625)}
    for group in (neuro.winner_take_all, neuro.lateral_reset):
        nets[group.__name__] = driven(neuro.iaf_psc_delta())
        nets[group.__name__].group("choice", group(of="cells"))
    nets["current"] = driven(neuro.iaf_psc_exp(tau_m=float("inf"), I_e=1.0))
    nets["rk4"] = driven(neuro.iaf_cond_exp(rk4_substeps=2))
    nets["no sign"] = plastic(neuro.vogels_sprekeler(Wmax=-5.0), weight=0.0)
    nets["start"] = plastic(neuro.stdp_nn_symm())
    nets["traces"] = plastic(neuro.stdp_triplet(), neuro.stdp_triplet(tau_minus_triplet=50.0))
    nets |= {rule.name: plastic(rule) for rule in (neuro.stdp_literal(), neuro.stddp())}
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
    sim = neuro.compile(plastic(neuro.static(receptor="in"), weight=-10.0), "nest")
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
    sim = neuro.compile(plastic(neuro.stdp_triplet()), "nest")
    sim.set("wires", Aplus=0.1)
    told["a trace of the neuron"] = refused(sim.set, "wires", tau_minus_triplet=50.0)
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
