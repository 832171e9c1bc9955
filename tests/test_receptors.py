"""Receptors by name: where spikes go whatever the sign of their weights, on every way of delivering them."""

import re

import numpy as np
import pytest

import neuro
from beside import beside, evaluated
from neuro import ModelError, static
from neuro.compiler.show import program_text, tables
from neuro.testing import check_part, observe
from neuro.testing.case import differences
from refused import refused

BACKENDS = ("reference", "event")
RATES = {"C_m": 200.0, "tau_syn_ex": 2.0, "tau_syn_in": 9.0}
(THREE,) = beside(__file__, "THREE")
three = neuro.equations("three_receptors", **THREE)

WAYS = evaluated(__file__, "WAYS", globals())
"""Rule, weight and delay of projections that take different ways through a backend; a weight of 0 is heard, too."""


def driven(way: str, cell, synapse) -> neuro.Network:
    """Cells with one projection of a way and excitation by sign."""
    rule, weight, delay = WAYS[way]
    net = neuro.Network("driven")
    net.population("noise", (6, 7), neuro.poisson_generator(rate=300.0))
    net.population("steady", (6, 7), neuro.poisson_generator(rate=900.0))
    net.population("cells", (1, 6, 7) if way == "a shared kernel" else (6, 7), cell)
    net.connect("noise", "cells", rule, synapse, weight=weight, delay=delay, name="by_name")
    net.connect("steady", "cells", neuro.one_to_one(), weight=5.0, delay=1.0)
    if way != "counts of a generator":  # a probe of its spikes lets a generator list them
        net.probe("noise_spikes", "noise")
    for state in cell.states:
        if not state.hidden:
            net.probe(state.name, "cells", state.name, every=1.0)
    return net


def found(net: neuro.Network, backend: str, threads: int = 1, sign: float = 1.0):
    """All that is read after a run that is cut by new weights."""
    sim = neuro.compile(net, backend, seed=3, threads=threads)
    first = sign * sim.get("by_name", "weight")
    if sign < 0.0:
        sim.set_weights("by_name", first)
    sim.run(9.0)
    assert sim.get("by_name", "weight").tolist() == first.tolist()
    sim.set_weights("by_name", 1.5 * first)
    assert sim.get("by_name", "weight").tolist() == (1.5 * first).tolist()
    sim.run(6.0)
    return {name: values for name, values in observe(sim).items() if name != "weight of by_name"}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_ends_at_the_receptor_that_is_named(way):
    """A positive current at the inhibitory receptor: no sign would send it there."""
    net = driven(way, neuro.iaf_psc_exp(**RATES), static(receptor="in"))
    expected = found(net, "reference")
    assert expected["trace of I_syn_in"].max() > 1.0
    for threads in (1, 2):
        told = differences(expected, found(net, "event", threads), exact=False)
        assert not told, "\n".join(told)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("way", WAYS)
def test_a_conductance_by_name_is_the_one_by_sign(way, backend):
    cell = neuro.iaf_cond_exp(g_L=10.0, tau_syn_in=8.0)
    by_name = found(driven(way, cell, static(receptor="in")), backend)
    by_sign = found(driven(way, cell, static()), backend, sign=-1.0)
    assert not differences(by_name, by_sign, exact=True)


def test_three_receptors_are_reached_by_name():
    check_part(three())
    net = neuro.Network("one_each")
    net.population("tell", 3, neuro.spike_generator(spike_times=[[1.0], [1.0, 2.0], [3.0]]))
    net.population("cell", 1, three())
    for k, (name, weight) in enumerate({"g_a": 3.0, "g_b": 2.0, "J": -40.0}.items()):
        net.connect("tell", "cell", neuro.pairs(pre=[k], post=[0]), static(receptor=name), weight=weight, name=name)
    for backend in BACKENDS:
        sim = neuro.compile(net, backend, seed=1)
        sim.run(5.0)
        past = {"g_a": [3.0], "g_b": [3.0, 2.0], "J": [1.0]}
        for name, weight, tau in (("g_a", 3.0, 3.0), ("g_b", 2.0, 8.0), ("J", -40.0, 2.0)):
            left = sum(np.exp(-t / tau) for t in past[name])
            assert sim.get("cell", name) == pytest.approx([weight * left], rel=1e-6)
        assert sim.counts().populations["cell"].neuron_updates_active == 3


@pytest.mark.parametrize("backend", BACKENDS)
def test_states_are_saved_and_handed_on(backend, tmp_path):
    net = driven("delays", three(), static(receptor="g_b"))
    net.projections.pop("steady_cells")
    net.connect("steady", "cells", neuro.one_to_one(), static(receptor="g_a"), weight=8.0)
    sim = neuro.compile(net, backend, seed=3)
    sim.run(12.3)
    sim.save(tmp_path / "state.h5")
    handed = sim.network()
    assert handed.projections["by_name"].synapse == static(receptor="g_b")
    sim.run(9.0)
    again = neuro.compile(net, backend, seed=3)
    again.restore(tmp_path / "state.h5")
    again.run(9.0)
    assert not differences(observe(sim), observe(again), exact=True)
    other = driven("delays", three(), static(receptor="J"))
    other.projections.pop("steady_cells")
    other.connect("steady", "cells", neuro.one_to_one(), static(receptor="g_a"), weight=8.0)
    with pytest.raises(ModelError, match="a state of another network 'driven'"):
        neuro.compile(other, backend, seed=3).restore(tmp_path / "state.h5")


def test_files_and_tables_show_it(tmp_path):
    net = driven("one_to_one", neuro.iaf_cond_exp(), static(receptor="in"))
    net.save(tmp_path / "net.yaml")
    assert "synapse: {static: {receptor: in}}" in (tmp_path / "net.yaml").read_text()
    assert neuro.load(tmp_path / "net.yaml") == net
    program = neuro.compile(net).program
    assert [row[7] for row in tables(net, program)[1].rows] == ["static to in", "static"]
    assert "  receptor 1 in\n" in program_text(program)


CURRENT = neuro.dc_generator(amplitude=1.0)


def onto(cell, synapse, weight=1.0, source=None) -> neuro.Simulation:
    net = neuro.Network("refused")
    net.population("a", 1, source or neuro.parrot_neuron())
    net.population("b", 1, cell)
    net.connect("a", "b", neuro.one_to_one(), synapse, weight=weight)
    return neuro.compile(net)


def test_messages_of_refused_receptors(messages):
    messages.calls(globals())


def test_a_current_needs_no_receptor():
    net = neuro.Network("current")
    net.population("dc", 1, neuro.dc_generator(amplitude=400.0))
    net.population("cell", 1, three())
    net.connect("dc", "cell", neuro.one_to_one())
    sim = neuro.compile(net)
    sim.run(100.0)
    assert len(sim.spikes("cell")[0]) > 2


def test_loihi_has_one_current_and_spinnaker_two_slots():
    def net(receptor, weight):
        net = neuro.Network("on_a_chip", resolution=1.0)
        net.population("a", 1, neuro.spike_generator(spike_times=[[2.0]]))
        net.population("b", 1, neuro.iaf_psc_exp(tau_syn_ex=5.0, tau_syn_in=5.0))
        net.connect("a", "b", neuro.one_to_one(), static(receptor=receptor), weight=weight, delay=2.0)
        net.probe("V", "b", "V_m")
        return net

    for chip in ("loihi", "spinnaker"):
        traces = []
        for receptor in (None, "in"):
            sim = neuro.compile(net(receptor, -300.0), chip)
            sim.run(20.0)
            traces.append(sim.trace("V")[1])
        assert np.array_equal(*traces)
        assert traces[0].min() < -71.0
    neuro.compile(net("in", 300.0), "loihi")
    why = (
        "projection 'a_b': receptor 'in' by name: slots have no sign: excitatory input is added and inhibitory input "
        "subtracted"
    )
    assert why in refused(neuro.compile, net("in", 300.0), "spinnaker")
    assert re.search(r"weight\[0\] = 300: expected -[0-9.]+ to 0, the range", refused(sim.set_weights, "a_b", 300.0))


class with_a_third(neuro.iaf_psc_exp):
    """As if `iaf_psc_exp` had got one receptor more."""

    receptors = 3
    receptor_names = ("ex", "in", "slow")


@pytest.mark.parametrize(
    ("backend", "why"),
    [
        ("loihi", "with_a_third with 3 receptors"),
        ("spinnaker", "with_a_third with 3 receptors"),
        ("nest", "receptor 'slow' by name"),
    ],
)
def test_a_receptor_that_a_backend_has_not_is_refused_not_dropped(backend, why):
    net = neuro.Network("third")
    net.population("input", 1, neuro.spike_generator(spike_times=[1.0]))
    net.population("cells", 1, with_a_third())
    net.connect("input", "cells", neuro.all_to_all(), static(receptor="slow"), weight=900.0)
    assert re.search(why, refused(neuro.compile, net, backend))


def test_an_unknown_receptor_hides_no_other_mistake(answer, tmp_path):
    file = tmp_path / "net.yaml"
    file.write_text(
        "populations: {a: {shape: 2, model: parrot_neuron}, b: {shape: 2, model: iaf_psc_exp}}\n"
        "projections:\n"
        "  a_b: {from: a, to: b, rule: one_to_one, synapse: {static: {receptor: inhib}}}\n"
        "probes: {p: {of: a_b, record: K_minus}}\n"
    )
    assert answer("check", file).err == (
        f"error: {file}:3:3: projection 'a_b': 'b' (iaf_psc_exp) has no receptor 'inhib'\n  hint: known: ex, in\n"
        f"error: {file}:4:10: probe 'p': the synapses of 'a_b', static, have no state 'K_minus'\n"
        "  hint: known: weight\n"
        f"{file}: 2 mistakes\n"
    )
