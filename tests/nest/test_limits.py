"""Parameters that NEST refuses are named before anything is built."""

from typing import Any

import numpy as np
import pytest

import neuro
from neuro.core.errors import Where
from neuro.model.neurons import MODELS
from neuro_nest.tables import NODES
from refused import refused

NEURONS = [name for name in NODES if MODELS[name].role == "neuron" and name != "parrot_neuron"]
NUMBERS = (0.0, 1e-6, 1e-4, 0.1, 1.0, 2.0, 10.0, 100.0, 1e3, 1e6)


def net_of(model: Any) -> neuro.Network:
    net = neuro.Network("net")
    net.place = Where("here")
    net.population("c", 2, model)
    return net


def test_a_value_that_nest_refuses(nest, messages):
    models = [
        *(neuro.aeif_cond_exp(Delta_T=1e-4), neuro.aeif_psc_exp(Delta_T=[2.0, 1e-4]), neuro.mat2_psc_exp(t_ref=0.0)),
        *(
            neuro.mat2_psc_exp(tau_syn_in=5.0, tau_m=5.0),
            neuro.mat2_psc_exp(t_ref=1e-12),
            neuro.iaf_psc_delta(E_L=1e300),
        ),
        *(neuro.iaf_psc_delta(E_L=1e300), neuro.iaf_psc_alpha(tau_syn_ex=1e-4), neuro.iaf_psc_exp(tau_syn_in=1e-4)),
    ]
    messages({f"{k} {model.name}": refused(neuro.compile, net_of(model), "nest") for k, model in enumerate(models)})


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


def test_weights_of_no_sign(nest, messages):
    net = net_of(neuro.iaf_psc_exp())
    net.population("s", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.connect("s", "c", neuro.all_to_all(), neuro.vogels_sprekeler(Wmax=-5.0), weight=0.0, name="w")
    messages({"w": refused(neuro.compile, net, "nest")})


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
