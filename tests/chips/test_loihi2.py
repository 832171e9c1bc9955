"""Loihi 2: golden cases of lava, graded spikes on all backends that have them."""

import json
import warnings
from importlib.util import find_spec

import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
import random_loihi2
from golden_traces import sent
from graded import STEPS, network, twin
from neuro.chips import chip, quantise
from neuro.chips.loihi2 import stored_mantissas
from neuro.cli.commands import app
from neuro.compare import loihi_rules
from neuro.core.errors import Where
from neuro.results import read
from neuro.run.saved import present
from neuro.testing.verify import verify
from refused import error_of, refused


def test_every_case_of_a_model_that_is_built(golden):
    results = verify(golden / "loihi2")
    assert {r.case: r.message for r in results if not r.ok} == {}
    assert len({r.case for r in results}) == 38 + 3
    assert {r.quantity for r in results} >= {"weights", "tag_1", "x1", "x2", "y1"}


def test_a_case_that_cannot_run_leaves_the_others(tmp_path):
    """Without a sign mode the weights have that of their signs, as in lava; a graded input of binary synapses is 1."""
    cases = {"invsqrt": {}, "dense": {"num_message_bits": 0, "weight_exp": 1, "num_weight_bits": 8}}
    arrays = {"invsqrt__s": np.zeros((3, 1)), "dense__x": np.array([[1, 0], [7, 1], [0, 0]])}
    arrays |= {"dense__W": np.array([[3, 5]]), "dense__a": np.array([[0], [6], [16]])}
    (tmp_path / "lava.json").write_text(json.dumps(cases))
    np.savez(tmp_path / "lava.npz", **arrays)
    found = {r.case: (r.ok, r.message.partition(":")[0]) for r in verify(tmp_path)}
    assert found == {"lava: invsqrt": (False, "unknown case"), "lava: dense": (True, "")}


@pytest.mark.parametrize("seed", range(8))
def test_graded_networks_are_equal_everywhere(seed):
    net, parts, wires = network(seed)
    expected = twin(parts, wires)
    for backend in ("reference", "event", *(["torch"] if find_spec("torch") else []), "loihi2"):
        sim = neuro.compile(net, backend)
        sim.run(STEPS / 2)
        sim.run(STEPS / 2)
        for name, part in zip(net.populations, expected, strict=True):
            assert np.array_equal(sent(sim, name)[:, : part.shape[1]], part), (backend, name)
            assert sim.counts().populations[name].spikes == np.count_nonzero(part)


@pytest.mark.parametrize("seed", [2, 3, 7, 9, 14, 21, 107])
def test_every_neuron_behind_every_synapse_equals_a_twin(seed, tmp_path):
    net, parts, wires = random_loihi2.network(seed)
    expected, registers = random_loihi2.twin(parts, wires)
    half = random_loihi2.STEPS // 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # weights lose bits and registers overflow, as they should
        sim = neuro.compile(net, "loihi2")
        sim.run(half)
        sim.save(tmp_path / "half.h5")
        sim.run(3.0)
        sim.restore(tmp_path / "half.h5")
        sim.run(half)
    for name, part in zip(list(net.populations)[1:], expected[1:], strict=True):
        assert np.array_equal(sent(sim, name), part), name
        for state, values in registers[int(name)].items():
            assert np.array_equal(sim.trace(f"{name}.{state}")[1], values[1:]), (name, state)


def test_products_are_equal_everywhere():
    found = []
    for backend in ("reference", "event", "loihi2"):
        net = neuro.Network("product", resolution=1.0)
        net.population("a", 2, neuro.graded_spike_train(spikes=[[1.0, 0, 9], [1.0, 1, -7], [2.0, 0, 3], [5.0, 1, 2]]))
        net.population("b", 1, neuro.graded_spike_train(spikes=[[1.0, 0, -5], [3.0, 0, 4], [5.0, 0, 6]]))
        net.population("out", 2, neuro.graded_product(vth=1, exp=2))
        net.connect("a", "out", neuro.one_to_one(), neuro.static(receptor="first"), weight=2.0, delay=1.0)
        net.connect("b", "out", neuro.all_to_all(), neuro.static(receptor="second"), weight=1.0, delay=1.0)
        sim = neuro.compile(net, backend)
        sim.run(8.0)
        found.append([values.tolist() for values in sim.payloads("out")])
    assert found == [[[2.0, 2.0, 6.0], [0, 1, 1], [-23, 17, 6]]] * 3


def learning(seed=0, **words):
    """A synapse of each of two sources, which send payloads, onto a neuron that fires by itself."""
    net = neuro.Network("learning", resolution=1.0)
    rng = np.random.default_rng(1)
    steps, ids = np.nonzero(rng.random((60, 2)) < 0.3)
    rows = np.stack([steps + 1, ids, rng.integers(1, 250, ids.size)], axis=1).astype(float)
    net.population("in", 2, neuro.graded_spike_train(spikes=rows))
    net.population("out", 1, neuro.loihi2_lif(bias_mant=2000, bias_exp=2, vth=500))
    rule = {"dw": "2^-4*x1*y0 - 2^-2*x0*y1", "x1_tau": 12, "y1_impulse": 8, "y1_tau": 9, "epoch": 4}
    synapse = neuro.loihi2_learning(**{"graded": "add_with_saturation", "weight_exp": -6, **rule, **words})
    net.connect("in", "out", neuro.all_to_all(), synapse, weight=[20.0, -40.0], delay=1.0, name="rule")
    for state in ("weight", "x1", "y1", "t"):
        net.probe(state, "rule", state)
    return neuro.compile(net, "loihi2", seed=seed)


def test_learning_goes_on_where_it_was_saved_and_follows_the_seed(tmp_path):
    sim = learning()
    sim.run(60.0)
    whole = [sim.trace(state)[1] for state in ("weight", "x1", "y1", "t")]
    assert whole[0].min() < 0 < whole[0].max()
    assert len(np.unique(whole[0])) > 5
    assert sim.counts().native["rules applied in rule"] > 10
    sim = learning()
    sim.run(23.0)  # within an epoch
    sim.save(tmp_path / "state.h5")
    other = learning()
    other.restore(tmp_path / "state.h5")
    other.run(37.0)
    for state, values in zip(("weight", "x1", "y1", "t"), whole, strict=True):
        assert np.array_equal(other.trace(state)[1], values), state
    seeds = []
    for found in (learning(seed=5), learning(rng_seed=3), learning(seed=5, rng_seed=3)):
        found.run(60.0)
        seeds.append(found.trace("y1")[1].tolist())
    assert seeds[0] != whole[2].tolist()
    assert seeds[1] == seeds[2] != seeds[0]


def test_rules_that_lava_does_not_take(messages):
    wrong = (
        {"x1_impulse": 3},
        {"y1_impulse": 0},
        {"dw": "2^-9*x1*y0"},
        {"dw": "x0*u1*x1"},
        {"dw": "u1*t", "dt": "u2*t"},
    )
    messages({str(words): refused(learning, **words).partition(": ")[2] for words in wrong})


@pytest.mark.parametrize("seed", [*range(100, 104), 2201, 2242])
def test_sums_are_shifted_as_a_whole(seed):
    net, parts, wires = network(seed, chip=True)
    sim = neuro.compile(net, "loihi2")
    sim.run(float(STEPS))
    for name, part in zip(net.populations, twin(parts, wires), strict=True):
        assert np.array_equal(sent(sim, name)[:, : part.shape[1]], part)


def test_bits_that_the_memory_does_not_keep():
    for mode, bits, given, kept in (
        ("mixed", 8, [-257, -5, -1, 1, 7, 300], [-256, -6, -2, 0, 6, 254]),
        ("mixed", 5, [-17, 15, 31], [-32, 0, 16]),
        ("excitatory", 5, [-3, 7, 9, 999], [0, 0, 8, 248]),
        ("inhibitory", 5, [3, -7, -9, -999], [0, 0, -8, -248]),
    ):
        assert stored_mantissas(np.array(given, dtype=np.int32), bits, mode).tolist() == kept


def test_states_wrap_and_clip():
    net = neuro.Network("full", resolution=1.0)
    net.population("in", 2, neuro.graded_spike_train(spikes=[[1.0, 0, 2**17], [2.0, 0, -(2**17)], [3.0, 1, 70000]]))
    net.population("out", 1, neuro.loihi2_lif(du=4095, dv=0, vth=131071))
    net.connect("in", "out", neuro.all_to_all(), neuro.loihi2_static(sign_mode="excitatory"), weight=1.0, delay=1.0)
    for state in ("u", "v"):
        net.probe(state, "out", state)
    sim = neuro.compile(net, "loihi2")
    with pytest.warns(neuro.OverflowWarning):
        sim.run(6.0)
    assert sim.trace("u")[1].ravel().tolist() == [0, 2**23, 2**23, 70000 * 64, 0, 0]
    assert sim.counts().native["voltage clips of out"] == 2  # of u = v = 2^23, which then fires
    assert sim.spikes("out")[0].tolist() == [2.0, 3.0]


def graded(**words):
    net = neuro.Network("graded", resolution=1.0)
    net.place = Where("here")
    net.population("in", 2, neuro.graded_spike_train(spikes=[[1.0, 0, 4], [1.0, 0, -1], [2.0, 1, -7]]))
    net.population("out", 2, neuro.graded_vector(**words))
    net.connect("in", "out", neuro.one_to_one(), weight=2.0, delay=1.0)
    net.probe("listed", "in")
    return net


@pytest.mark.parametrize("backend", ["reference", "event", "loihi2"])
def test_payloads_are_injected_saved_and_read(backend, tmp_path):
    sim = neuro.compile(graded(), backend)
    sim.run(3.0)
    sim.save(tmp_path / "state.h5")
    sim.inject("in", [5.0, 4.0], [0, 1], [30, 0])
    sim.run(3.0)
    expected = [[2.0, 3.0, 6.0], [0, 1, 0], [6, -14, 60]]
    assert [found.tolist() for found in sim.payloads("out")] == expected
    assert sim.payloads("in")[2].tolist() == [3, -7, 30]
    assert [found.tolist() for found in sim.spikes("out")] == expected[:2]
    sim.restore(tmp_path / "state.h5")
    sim.run(3.0, out=tmp_path / "run.h5")
    assert sim.payloads("out")[2].tolist() == [6, -14]
    run = read(tmp_path / "run.h5")
    assert [found.tolist() for found in run.payloads("out")] == [[2.0, 3.0], [0, 1], [6, -14]]
    assert [found.tolist() for found in run.spikes("out")] == [[2.0, 3.0], [0, 1]]


def test_a_diagnosis_sees_payloads_that_were_injected():
    net = neuro.Network("late", resolution=1.0)
    net.population("in", 1, neuro.graded_spike_train(spikes=[[1.0, 0, 3], [9.0, 0, 8]]))
    net.population("out", 1, neuro.sigma_decoder())
    net.connect("in", "out", neuro.one_to_one(), weight=2.0, delay=1.0)
    net.probe("listed", "in")
    sim = neuro.compile(net)
    sim.inject("in", [2.0], [0], [-5])
    sim.run(5.0)
    part = present(sim._run, sim.steered).populations[0]
    assert (part.spike_steps.tolist(), part.spike_payloads.tolist()) == ([1, 2, 9], [3, -5, 8])
    assert [found for found in sim.doctor() if found.severity == "fault"] == []


def test_a_weight_of_half_a_unit_is_shifted():
    net = graded()
    net.population("half", 2, neuro.sigma_delta(vth=0, relu=False))
    net.connect("in", "half", neuro.one_to_one(), weight=0.5, delay=1.0)
    wires = quantise(neuro.compile(net, "loihi2").program, chip("loihi2")).projections[1]
    assert (wires.exponent, wires.shift, wires.mantissas.tolist()) == (-1, 1, [1])
    sim = neuro.compile(net, "loihi2")
    sim.run(4.0)
    assert sim.get("half", "sigma").tolist() == [1, -4]  # 3 and -7 halves, rounded down


def onto(model, rule=None):
    """What is said of graded spikes onto neurons of a model."""
    net = graded()
    if rule is None:
        net.population("p", 2, model)
        net.connect("in", "p", neuro.one_to_one())
    else:
        net.connect("in", "out", neuro.all_to_all(), rule, name="learns")
    return error_of(neuro.compile, net, "event").message


def test_what_takes_no_payloads(messages):
    models = (neuro.parrot_neuron(), neuro.iaf_psc_exp(), neuro.graded_product(), neuro.iaf_cond_exp())
    told = {model.name: onto(model) for model in models} | {"stdp": onto(None, neuro.stdp())}
    for payload in (1.5, np.nan, 2**40):
        told[str(payload)] = error_of(neuro.graded_spike_train, spikes=[[1.0, 0, payload]]).message
    told["thresholds"] = error_of(neuro.loihi2_ternary_lif, vth_hi=-5, vth_lo=7).message
    for backend in ("loihi", "spinnaker"):
        told[backend] = "\n".join(map(str, error_of(neuro.compile, graded(), backend).others))
    messages(told)


def test_a_neuron_without_a_fixed_reference_is_refused(messages):
    told = {}
    for words in ({"t_ref": 2.0}, {"t_ref": 0.0, "reset_by_subtraction": True}):
        net = neuro.Network("one", resolution=1.0)
        net.place = Where("here")
        net.population("out", 1, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=10.0, **words))
        told[str(words)] = refused(neuro.compile, net, "loihi2")
    messages(told)


def test_a_binary_network_fires_as_on_loihi_1():
    rng = np.random.default_rng(1)
    net = neuro.Network("binary", resolution=1.0)
    times = [np.flatnonzero(rng.random(300) < 0.08) + 1.0 for _ in range(20)]
    net.population("in", 20, neuro.spike_generator(spike_times=times))
    words = {"E_L": 0.0, "V_reset": 0.0, "V_th": 20.0, "t_ref": 0.0, "tau_m": 20.0}
    net.population("out", 10, neuro.iaf_psc_exp(**words))
    net.connect("in", "out", neuro.all_to_all(), weight=rng.uniform(-100.0, 300.0, 200), delay=2.0)
    found = []
    for backend in ("loihi", "loihi2"):
        sim = neuro.compile(net, backend)
        sim.run(300.0)
        found.append(np.stack(sim.spikes("out")))
    assert found[0].shape[1] > 20
    assert np.array_equal(*found)


def test_a_bill_is_a_range_from_0_to_the_ceiling():
    sim = neuro.compile(graded(), "loihi2")
    sim.run(1000.0)
    bill = sim.energy("loihi2")
    assert bill.real_time.static_j == pytest.approx(0.232)
    dynamic = [item for item in bill.items if item.what not in ("static_per_chip", "host")]
    assert dynamic
    assert all((item.joules, item.low) == (0.0, 0.0) and item.extrapolated for item in dynamic)
    assert "derived, not published" in str(bill)


def registers(exponent, weights, **words):
    net = neuro.Network("rules", resolution=1.0)
    net.population("in", len(weights), neuro.spike_generator(spike_times=[[2.0, 5.0]] * len(weights)))
    net.population("out", 1, neuro.loihi_lif(du=400, dv=200, vth=3000, **words))
    synapse = neuro.loihi_static(weight_exp=exponent)
    net.connect("in", "out", neuro.all_to_all(), synapse, weight=np.array(weights, dtype=float), delay=1.0)
    return loihi_rules(net, 20.0)


def told(found):
    return [(d.part, d.where, d.loihi, d.loihi2, d.why) for d in found.differences]


def test_rules_are_compared_over_some_time(messages):
    told = {str(duration): refused(loihi_rules, graded(), duration) for duration in (-1.0, np.inf)}
    messages(told | {"a file": refused(loihi_rules, "net.yaml", 20.0)})


def test_options_that_rules_do_not_use(tmp_path):
    graded().save(tmp_path / "net.yaml")
    for option in (("--html", "a.html"), ("--out", "a.json"), ("--backends", "event,loihi2")):
        result = CliRunner().invoke(app, ["compare", str(tmp_path / "net.yaml"), "--rules", *option])
        assert result.exception.message.startswith(option[0])


def test_rules_of_both_chips():
    assert registers(0, [4, -6]).differences == ()
    assert told(registers(0, [4, -5])) == [
        ("in_out", "weight[1], 1 of 2 weights", "-4", "-6", "mixed mantissas are rounded down"),
        ("out", "neuron 0, step 3: u, 1 of 1 neurons", "0", "-128", ""),
    ]
    shifted = told(registers(-2, [6, 6]))  # each 6 / 4 is 1, their sum is 3
    assert shifted[0] == ("in_out", "weight[0], 2 of 2 weights", "1", "1.5", "the sum is shifted, not each weight")
    assert shifted[1][1:4] == ("neuron 0, step 3: u, 1 of 1 neurons", "128", "192")
    wraps = told(registers(7, [254, 254]))
    assert ("out", "input wraps", "2", "0", "the input of a step has 22 bits on Loihi 1") in wraps
    held = registers(0, [4], refractory=3)
    assert [(d.loihi, d.loihi2) for d in held.differences] == [("accepted", "refused")] * 2
    assert held.steps == 0
    assert "'rules' by the rules of Loihi 1 and Loihi 2: 2 differences (not run)" in str(held)
    assert str(registers(0, [4, -6])).endswith("are equal (20 steps on both, 0 spikes)")
    assert registers(7, [254, 254]).spikes == (0, 18)
