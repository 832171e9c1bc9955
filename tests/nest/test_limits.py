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
    ],
)
def test_a_value_that_nest_refuses(model, why, nest):
    text = message(model)
    assert f"population 'c': {why}" in text
    assert "or backend 'event' runs it" in text


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
