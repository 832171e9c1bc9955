"""Chips hold equations that are those of a neuron of theirs, in its registers; of others they say why not."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from beside import beside, evaluated
from neuro import ModelError
from neuro.chips import chip, quantise

MODELS = yaml.safe_load(Path(__file__).with_name("models.yaml").read_text())["models"]
CHIPS = pytest.mark.parametrize("target", ["loihi", "spinnaker"])

RESISTANCE, LINEAR = beside(__file__, "RESISTANCE", "LINEAR")
"""iaf_psc_exp in other words: a resistance, one receptor, units of its own."""


def network(model, weight, tau_syn=2.0):
    net = neuro.Network("twins", resolution=1.0)
    net.population("noise", 20, neuro.poisson_generator(rate=60.0))
    net.population("dc", 1, neuro.dc_generator(amplitude=50.0, start=20.0, stop=60.0))
    net.population("cells", 12, model)
    net.connect("noise", "cells", neuro.pairwise_bernoulli(p=0.5), weight=neuro.uniform(low=-weight, high=2 * weight))
    net.connect("cells", "cells", neuro.pairwise_bernoulli(p=0.2), weight=-0.5 * weight, delay=2.0)
    net.connect("dc", "cells", neuro.all_to_all())
    return net


def registers(model, weight, target):
    program = neuro.compile(network(model, weight), "reference", seed=2).program
    fixed = quantise(program, chip(target))
    assert not [problem for problem in fixed.problems if problem.refused]
    cells = {**fixed.populations[2].registers, **fixed.populations[2].initial}
    return cells, [wires.words for wires in fixed.projections if wires is not None]


def spikes(model, weight, target):
    sim = neuro.compile(network(model, weight), target, seed=2)
    sim.run(150.0)
    return np.stack(sim.spikes("cells"))


SPREAD = np.linspace(6.0, 15.0, 12)


@CHIPS
@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize(
    ("built_in", "own", "weight"),
    evaluated(__file__, "TWINS", globals()),
    ids=["exp", "exp, one each", "delta", "resistance"],
)
def test_its_registers_and_spikes_are_those_of_the_built_in(target, built_in, own, weight):
    (cells, words), (own_cells, own_words) = (registers(model, weight, target) for model in (built_in, own))
    assert cells.keys() == own_cells.keys()
    for name, values in cells.items():
        assert np.array_equal(np.broadcast_to(values, 12), np.broadcast_to(own_cells[name], 12)), name
    assert all(np.array_equal(a, b) for a, b in zip(words, own_words, strict=True))
    found = spikes(built_in, weight, target)
    assert found.shape[1] > 10
    assert np.array_equal(found, spikes(own, weight, target))


@CHIPS
def test_its_states_and_parameters_are_read_and_set_by_their_own_names(target):
    net = neuro.Network("own", resolution=1.0)
    net.population("cells", 3, neuro.equations("c", **RESISTANCE)(s_0=20.0, I_0=0.0), initial={"v": -60.0})
    twin = neuro.iaf_psc_exp()
    net.population("twins", 3, twin, initial={"V_m": -60.0, "I_syn_ex": 20.0})
    sim = neuro.compile(net, target)

    def alike():
        assert sim.get("cells", "v") == pytest.approx(sim.get("twins", "V_m"), abs=1e-12)
        current = sim.get("twins", "I_syn_ex") + sim.get("twins", "I_syn_in")
        assert sim.get("cells", "s") == pytest.approx(current, abs=1e-12)

    alike()
    assert sim.get("cells", "s") == pytest.approx(20.0, rel=1e-2)
    sim.run(3.0)
    alike()
    sim.set("cells", s=np.array([-30.0, 0.0, 30.0]), v_rest=-0.072)
    sim.set("twins", I_syn_ex=np.array([0.0, 0.0, 30.0]), E_L=-72.0, V_reset=-72.0, V_th=-57.0)
    if target == "spinnaker":
        sim.set("twins", I_syn_in=np.array([-30.0, 0.0, 0.0]))
        alike()
    sim.run(3.0)
    assert sim.get("cells", "v")[2] > sim.get("cells", "v")[1] > sim.get("cells", "v")[0]
    assert sim.get("cells", "v")[1] == sim.get("twins", "V_m")[1]
    assert np.array_equal(sim.get("cells", "v", raw=True), sim.get("cells", "V_m", raw=True))


def on_loihi(**words):
    net = neuro.Network("other")
    net.population("cells", 2, neuro.equations("other", **words)())
    try:
        neuro.compile(net, backend="loihi")
    except ModelError as error:
        [only] = error.others
        raise only from None


def test_of_other_equations_it_says_why_not(messages):
    messages.calls(globals())


def test_a_membrane_that_grows_is_refused():
    net = neuro.Network("growing", resolution=1.0)
    net.population("cells", 2, neuro.equations("c", **{**RESISTANCE, "reset": {"v": "v_rest"}})(R=-40.0))
    with pytest.raises(ModelError, match=r"population 'cells': C_m of its equations = -250: expected a number > 0 pF"):
        neuro.compile(net, backend="spinnaker")
