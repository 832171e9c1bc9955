"""A neuron on a chip does what it does in floats, within what its registers can tell."""

import math
import warnings

import numpy as np
import pytest

import neuro
from neuro.run.compiled import ApproximationWarning
from refused import refused

CHIPS = ["loihi", "spinnaker"]
H = 0.5


def build(model, backend, weights=(), times=(), delay=1.0, current=None, initial=None, **options):
    """One neuron, a listed generator for each weight, and a current."""
    net = neuro.Network("one", resolution=H)
    net.population("out", 1, model, initial=initial or {})
    for k, (weight, row) in enumerate(zip(weights, times, strict=True)):
        net.population(f"in{k}", 1, neuro.spike_generator(spike_times=[list(row)]))
        net.connect(f"in{k}", "out", neuro.one_to_one(), weight=weight, delay=delay, name=f"p{k}")
    if current:
        net.population("dc", 1, current)
        net.connect("dc", "out", neuro.one_to_one(), weight=1.0, delay=H, name="drive")
    net.probe("v", "out", "V_m")
    for state in ("I_syn_ex", "I_syn_in"):
        if state in [s.name for s in model.states]:
            net.probe(state, "out", state)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ApproximationWarning)
        return neuro.compile(net, backend, **options)


def trace(sim, ms, name="v"):
    sim.run(ms)
    return sim.trace(name)[1][:, 0]


def lazy(**values):
    """A neuron that never fires."""
    return neuro.iaf_psc_exp(**{"E_L": -70.0, "V_reset": -70.0, "V_th": -20.0, "tau_m": 10.0} | values)


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("weight", [400.0, -400.0])
@pytest.mark.parametrize("delay", [H, 3.0])
def test_a_postsynaptic_potential_has_its_shape(chip, weight, delay):
    model = lazy(tau_syn_ex=4.0, tau_syn_in=4.0)
    ours, theirs = (trace(build(model, b, [weight], [[5.0]], delay), 80.0) for b in (chip, "event"))
    peak = np.abs(theirs + 70.0).max()
    assert peak > 2.0
    assert np.abs(ours - theirs).max() < 0.01 * peak
    assert np.flatnonzero(ours != ours[0])[0] == np.flatnonzero(theirs != theirs[0])[0]


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("tau_m", [math.inf, 10.0])
def test_a_delta_synapse_jumps_at_once(chip, tau_m):
    model = neuro.iaf_psc_delta(E_L=-70.0, V_reset=-70.0, V_th=-20.0, tau_m=tau_m)
    ours, theirs = (trace(build(model, b, [3.0, -5.0], [[4.0, 5.0], [8.0]]), 40.0) for b in (chip, "event"))
    assert np.abs(np.diff(theirs)).max() > 2.5
    assert np.abs(ours - theirs).max() < (1e-9 if math.isinf(tau_m) else 0.05)


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("model", [neuro.iaf_psc_exp, neuro.iaf_psc_delta])
def test_rates_follow_the_current(chip, model):
    for i_e in (300.0, 400.0, 1500.0):
        cells = model(I_e=i_e, E_L=-70.0, V_reset=-70.0, t_ref=2.0)
        counts, first = {}, {}
        for backend in (chip, "event"):
            sim = build(cells, backend)
            sim.run(1000.0)
            times = sim.spikes("out")[0]
            counts[backend], first[backend] = times.size, times[:1]
        assert abs(counts[chip] - counts["event"]) <= max(1, 0.02 * counts["event"]), i_e
        if counts["event"]:
            assert abs(first[chip][0] - first["event"][0]) <= H, i_e
    assert counts["event"] > 150


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("steps", [0, 2, 63])
def test_refractory_periods_are_exact(chip, steps):
    model = neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=4.0, tau_m=math.inf, t_ref=steps * H)
    found = {}
    for backend in (chip, "event"):
        sim = build(model, backend, [4.0], [np.arange(1, 300) * H], H)
        sim.run(150.0)
        found[backend] = sim.spikes("out")[0]
    assert found["event"].size > 3
    np.testing.assert_array_equal(found[chip], found["event"])
    assert set(np.rint(np.diff(found[chip]) / H)) == {steps + 1}


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("model", [lazy(), neuro.iaf_psc_delta(E_L=-70.0, V_reset=-70.0, V_th=-20.0)])
def test_a_current_switches_on_and_off(chip, model):
    current = neuro.dc_generator(amplitude=350.0, start=10.0, stop=50.0)
    ours, theirs = (trace(build(model, b, current=current), 120.0) for b in (chip, "event"))
    top = (theirs + 70.0).max()
    assert top > 10.0
    assert np.abs(ours - theirs).max() < 0.01 * top
    assert np.argmax(ours > -69.999) == np.argmax(theirs > -69.999)
    assert np.argmax(ours) == np.argmax(theirs)


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize(
    ("state", "value"), [("V_m", -60.0), ("V_m", -95.0), ("I_syn_ex", 500.0), ("I_syn_in", -500.0)]
)
def test_states_at_step_0_and_states_that_are_set(chip, state, value):
    rows = {}
    for backend in (chip, "event"):
        sim = build(lazy(), backend, initial={state: value})
        assert sim.get("out", state)[0] == pytest.approx(value, rel=1e-4)
        begun = trace(sim, 40.0)
        sim = build(lazy(), backend)
        sim.set("out", **{state: value})
        assert sim.get("out", state)[0] == pytest.approx(value, rel=1e-4)
        rows[backend] = begun, trace(sim, 40.0)
    peak = np.abs(rows["event"][0] + 70.0).max()
    for ours, theirs in zip(rows[chip], rows["event"], strict=True):
        assert np.abs(ours - theirs).max() < 0.01 * peak


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize(("name", "weight"), [("I_syn_ex", 400.0), ("I_syn_in", -400.0)])
def test_currents_are_told_but_for_what_arrives_in_the_step(chip, name, weight):
    ours, theirs = (trace(build(lazy(), b, [weight], [[5.0, 20.0]], 2.0), 40.0, name) for b in (chip, "event"))
    off = np.flatnonzero(np.abs(ours - theirs) > 0.01 * abs(weight))
    assert (off * H + H).tolist() == [7.0, 22.0]
    assert np.abs(theirs).max() == pytest.approx(400.0, rel=0.01)


# changes while running


@pytest.mark.parametrize("chip", CHIPS)
def test_weights_change_while_it_runs(chip):
    rows = []
    for backend in (chip, "event"):
        sim = build(lazy(), backend, [500.0], [[5.0, 45.0]])
        sim.run(40.0)
        sim.set_weights("p0", 200.0)
        rows.append(trace(sim, 60.0))
        assert sim.weights("p0")[2][0] == pytest.approx(200.0, rel=0.01)
    assert np.abs(rows[0] - rows[1]).max() < 0.02 * (rows[1] + 70.0).max()


REGISTERS = {
    "loihi": {"V_th": "vth", "tau_m": "dv", "t_ref": "refractory", "I_e": "bias_mant"},
    "spinnaker": {"V_th": "v_thresh", "tau_m": "exp_tc", "t_ref": "t_refract", "I_e": "i_offset", "C_m": "r_m"},
}
HELD = {
    "vth": lambda raw, sim: 64 * (raw + 1),
    "dv": lambda raw, sim: 4096 - raw,
    "bias_mant": lambda raw, sim: raw << sim.get("out", "bias_exp", raw=True),
}
"""What registers of Loihi hold that is not the number in them."""
NEW = {"V_th": -62.5, "tau_m": 20.0, "t_ref": 4.0, "I_e": 50.0, "C_m": 500.0}
FACTORS = {
    "loihi": {"V_th": 0.5, "tau_m": math.exp(-H / 20.0) / math.exp(-H / 10.0), "t_ref": 9 / 5, "I_e": 0.5},
    "spinnaker": {"V_th": 62.5 / 55.0, "tau_m": math.exp(-H / 20.0) / math.exp(-H / 10.0), "t_ref": 2.0, "I_e": 0.5}
    | {"C_m": 0.5},
}


@pytest.mark.parametrize(("chip", "name"), [(chip, name) for chip in CHIPS for name in REGISTERS[chip]])
def test_registers_follow_what_is_set(chip, name):
    sim = build(neuro.iaf_psc_exp(E_L=-70.0, V_reset=-70.0, I_e=100.0), chip, [500.0], [[5.0]])
    register, found = REGISTERS[chip][name], []
    for _ in range(2):
        raw = sim.get("out", register, raw=True)
        np.testing.assert_array_equal(sim.get("out", name, raw=True), raw)
        found.append(HELD.get(register, lambda raw, sim: raw)(raw, sim)[0])
        sim.set("out", **{name: NEW[name]})
    assert found[1] / found[0] == pytest.approx(FACTORS[chip][name], rel=2e-3)


TOO_MUCH = {"V_th": 0.0, "I_e": 1e6, "t_ref": 32.0, "tau_m": 3000.0, "V_reset": -75.0, "C_m": 1.0}


def test_what_a_register_cannot_hold_is_refused_and_changes_nothing(messages):
    sims = [build(neuro.iaf_psc_exp(E_L=-70.0, V_reset=-70.0), "loihi", [500.0], [[5.0, 6.0, 7.0]]) for _ in range(2)]
    for sim in sims:
        sim.run(6.0)
    for name, value in TOO_MUCH.items():
        messages({name: refused(sims[0].set, "out", **{name: value})})
        assert sims[0].get("out", name) == sims[1].get("out", name)
        for register in ("vth", "dv", "du", "bias_mant", "bias_exp", "refractory", "v", "u"):
            assert sims[0].get("out", register, raw=True) == sims[1].get("out", register, raw=True)
    np.testing.assert_array_equal(*(trace(sim, 30.0) for sim in sims))


def test_a_sign_mode_is_kept_while_weights_and_parameters_change():
    net = neuro.Network("mixed", resolution=H)
    net.population("in", 2, neuro.spike_generator())
    net.population("out", 1, lazy())
    net.connect("in", "out", neuro.all_to_all(), weight=[400.0, -400.0], delay=1.0, name="p")
    sim = neuro.compile(net, "loihi")
    sim.set_weights("p", [100.0, 200.0])
    sim.set("out", V_th=-30.0)
    sim.set("out", tau_m=12.0)
    sim.set_weights("p", [100.0, -200.0])
    np.testing.assert_allclose(sim.weights("p")[2], [100.0, -200.0], rtol=0.02)


def test_currents_on_loihi_decay_by_their_time_constant():
    keep = 1.0 - 256.0 / 4096.0  # a decay that the chip holds exactly
    tau = -H / math.log(keep)
    sim = build(neuro.iaf_psc_exp(tau_syn_ex=tau, V_th=1e3), "loihi", [2000.0], [[1.0]])
    sim.run(30.0)
    current = sim.trace("I_syn_ex")[1][:, 0]
    first = int(np.argmax(current > 0.0))
    assert current[first + 20] / current[first] == pytest.approx(keep**20, rel=2e-3)  # cut towards 0 in each step
