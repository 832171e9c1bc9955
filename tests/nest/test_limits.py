"""Parameters that NEST refuses are named before anything is built."""

from typing import Any

import numpy as np
import pytest

import neuro
from neuro.model.neurons import MODELS
from neuro_nest.tables import NODES

NEURONS = [name for name in NODES if MODELS[name].role == "neuron" and name != "parrot_neuron"]
NUMBERS = (0.0, 1e-6, 1e-4, 0.1, 1.0, 2.0, 10.0, 100.0, 1e3, 1e6)


def message(model: Any, **more: Any) -> str:
    net = neuro.Network("net")
    net.population("c", 2, model, **more)
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net, "nest")
    return str(error.value)


@pytest.mark.parametrize(
    ("model", "why"),
    [
        (
            neuro.aeif_cond_exp(Delta_T=1e-4),
            "Delta_T = 0.0001 mV, V_peak = 0 mV, V_th = -50.4 mV: NEST expects (V_peak",
        ),
        (neuro.aeif_psc_exp(Delta_T=[2.0, 1e-4]), "Delta_T = 0.0001 mV, V_peak = 0 mV, V_th = -50.4 mV: NEST expects"),
        (neuro.mat2_psc_exp(t_ref=0.0), "t_ref = 0 ms: NEST expects t_ref > 0 ms"),
        (
            neuro.mat2_psc_exp(tau_syn_in=5.0, tau_m=5.0),
            "tau_syn_in = 5 ms, tau_m = 5 ms: NEST expects tau_m and tau_syn_in",
        ),
        (neuro.mat2_psc_exp(t_ref=1e-12), "t_ref = 1e-12 ms: NEST expects t_ref > 0 ms"),
        (
            neuro.iaf_psc_delta(E_L=1e300),
            "V_reset = -70 mV, V_th = -55 mV, E_L = 1e+300 mV: NEST holds potentials relative to E_L",
        ),
        (neuro.iaf_psc_alpha(tau_syn_ex=1e-4), "tau_syn_ex = 0.0001 ms, tau_m = 10 ms: NEST's propagator overflows"),
        (neuro.iaf_psc_exp(tau_syn_in=1e-4), "tau_syn_in = 0.0001 ms, tau_m = 10 ms: NEST's propagator overflows"),
    ],
)
def test_a_value_that_nest_refuses(model, why, nest):
    text = message(model)
    assert f"population 'c': {why}" in text
    assert "or backend 'event' runs it" in text


@pytest.mark.parametrize(
    ("model", "change", "message"),
    [
        (
            neuro.aeif_cond_exp(),
            {"Delta_T": [2.0, 1e-4]},
            "'c' cannot change: Delta_T = 0.0001 mV, V_peak = 0 mV, V_th = -50.4 mV: NEST expects (V_peak",
        ),
        (neuro.aeif_psc_exp(), {"V_th": 10.0}, "'c' cannot change: V_peak = 0 mV, V_th = 10 mV: NEST expects V_peak"),
        (neuro.mat2_psc_exp(), {"tau_m": 1.0}, "'c' cannot change: tau_syn_ex = 1 ms, tau_m = 1 ms: NEST expects"),
        (neuro.iaf_psc_exp(), {"tau_syn_ex": 1e-5}, "'c' cannot change: tau_syn_ex = 1e-05 ms, tau_m = 10 ms: NEST's"),
    ],
)
def test_a_change_that_nest_refuses(model, change, message, nest):
    net = neuro.Network("net")
    net.population("c", 2, model)
    sim = neuro.compile(net, "nest")
    with pytest.raises(neuro.ModelError) as error:
        sim.set("c", **change)
    assert str(error.value).startswith(message)
    assert "or backend 'event' runs it" in str(error.value)
    word = next(iter(change))
    assert sim.get("c", word).tolist() == [model.parameters()[word]] * 2


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


def test_an_instability_names_the_population(nest):
    net = neuro.Network("net")
    net.population("s", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("c", 2, neuro.aeif_psc_exp())
    net.population("other", 2, neuro.aeif_psc_exp())
    net.connect("s", "c", neuro.all_to_all(), weight=-1e7)
    sim = neuro.compile(net, "nest")
    with pytest.raises(neuro.ModelError) as error:
        sim.run(5.0)
    assert str(error.value) == (
        "NEST: population 'c': NEST detected a numerical instability while updating aeif_psc_exp.\n"
        "  hint: weaken its input, or backend 'event' may run it"
    )
    with pytest.raises(neuro.ModelError, match="NEST: cannot run on after its error"):
        sim.run(5.0)
    sim.reset()
    sim.run(0.5)
    assert sim.time == 0.5


def test_weights_of_no_sign(nest):
    net = neuro.Network("net")
    net.population("s", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("c", 1, neuro.iaf_psc_exp())
    net.connect("s", "c", neuro.all_to_all(), neuro.vogels_sprekeler(Wmax=-5.0), weight=0.0, name="w")
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net, "nest")
    assert "projection 'w': weight = 0 with Wmax below 0: NEST expects weights with the sign of Wmax" in str(
        error.value
    )


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
