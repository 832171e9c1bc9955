"""Models, rules and synapses that a chip lacks: refused by name, with a way out."""

import numpy as np
import pytest

import neuro
from neuro.compiler import compile_network
from one_projection import delta, exp, one, refusals

LACKS = "use iaf_psc_exp, or run on event"


@pytest.mark.parametrize(
    ("name", "model", "way"),
    [
        ("loihi", neuro.izhikevich(), LACKS),
        ("loihi", neuro.iaf_psc_alpha(), LACKS),
        ("loihi", neuro.spinnaker_lif(), "backend 'spinnaker' runs it"),
        ("spinnaker", neuro.iaf_psc_alpha(), LACKS),
        ("spinnaker", neuro.loihi_lif(), "backend 'loihi' runs it"),
    ],
)
def test_models_that_a_chip_lacks(name, model, way):
    assert refusals(one(model), name) == [
        (
            f"population 'out': {model.name}",
            f"{name} has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron",
            way,
        )
    ]


def test_rules_that_a_chip_lacks():
    way = "run it on loihi or event, or send static weights: sim.network() has what was learnt"
    assert refusals(one(exp(), weight=5.0, synapse=neuro.stdp(Wmax=10.0)), "spinnaker") == [
        ("projection 'in_out': stdp", "pairwise learning is not emulated on spinnaker", way)
    ]
    assert refusals(one(exp(), weight=5.0, synapse=neuro.stdp(Wmax=10.0, mu_plus=0.5)), "loihi") == [
        (
            "projection 'in_out': stdp",
            "stdp.mu_plus = 0.5: expected 0 or 1, which are sums of products on the chip",
            "mu_plus: 0 is nearest",
        )
    ]


@pytest.mark.parametrize(
    ("model", "synapse", "why", "way"),
    [
        (
            exp(),
            neuro.loihi_static(weight_exp=3),
            "its weights are mantissas, but iaf_psc_exp has mV and pA",
            "use static or stdp, or a loihi_lif",
        ),
        (
            neuro.loihi_lif(),
            neuro.stdp(Wmax=100.0),
            "its weights are in mV or pA, but loihi_lif has registers",
            "use loihi_learning",
        ),
        (
            neuro.parrot_neuron(),
            neuro.stdp(Wmax=100.0),
            "the host relays the spikes of parrots, so there is no weight to learn",
            "learn at the next projection",
        ),
    ],
)
def test_synapses_that_do_not_go_with_their_neurons(model, synapse, why, way):
    assert refusals(one(model, weight=5.0, synapse=synapse), "loihi") == [
        (f"projection 'in_out': {synapse.name}", why, way)
    ]


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_thresholds_that_adapted_elsewhere_are_taken():
    def net(model):
        net = neuro.Network("adapted", resolution=1.0)
        net.population("noise", 20, neuro.poisson_generator(rate=150.0))
        net.population("cells", 4, model)
        net.connect("noise", "cells", neuro.all_to_all(), weight=300.0, delay=1.0)
        return net

    shared = {"tau_syn_ex": 5.0, "tau_syn_in": 5.0}
    adapting = neuro.iaf_psc_exp_adaptive_threshold(**shared)
    known = "iaf_psc_exp, iaf_psc_delta and parrot_neuron"
    assert refusals(neuro.compile(net(adapting)).program, "loihi") == [
        (
            "population 'cells': iaf_psc_exp_adaptive_threshold",
            f"loihi has no such neuron: it has {known}",
            "adapt on event, then give iaf_psc_exp the V_th of each neuron that is V_th + theta there",
        )
    ]
    sim = neuro.compile(net(adapting), seed=1)
    sim.run(200.0)
    raised = sim.get("cells", "V_th") + sim.get("cells", "theta")
    assert (raised > adapting.V_th).all()
    chip = neuro.compile(net(neuro.iaf_psc_exp(V_th=raised, **shared)), "loihi", seed=1)
    assert chip.get("cells", "V_th").tolist() == raised.tolist()


def test_a_kernel_onto_neurons_that_differ():
    net = neuro.Network("grid", resolution=1.0)
    net.population("in", (1, 4, 4), neuro.spike_generator(spike_times=[[]] * 16))
    net.population("out", (2, 3, 3), exp(tau_m=np.linspace(5.0, 20.0, 18).reshape(2, 3, 3)))
    net.connect("in", "out", neuro.grid((2, 2)), weight=np.arange(8.0).reshape(2, 1, 2, 2), delay=1.0, name="k")
    text = (
        "projection 'k': a shared kernel onto neurons that differ",
        "a kernel has one scale",
        "give the neurons the same time constants and C_m",
    )
    for name in ("loihi", "spinnaker"):
        assert refusals(compile_network(net, 0), name) == [text]


@pytest.mark.parametrize("v_th", [0.0, -5.0])
def test_a_threshold_that_is_not_above_rest(v_th):
    program = one(delta(V_reset=-20.0, V_th=v_th), weight=0.0)
    told = refusals(program, "loihi")
    assert [what for what, _, _ in told] == [
        "population 'out': V_reset = -20 mV",
        f"population 'out': V_th = {v_th:g} mV",
    ]
    assert told[1][1:] == (
        "the threshold register is unsigned, so V_th must be above E_L = 0 mV",
        "raise V_th or lower E_L, or run on spinnaker",
    )
    assert refusals(program, "spinnaker") == []
