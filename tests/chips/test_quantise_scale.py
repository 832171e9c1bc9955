"""The search for scales: what a mantissa can hold becomes exact, nothing saturates, and what is set by hand holds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips import chip, quantise
from neuro.compiler import compile_network

GRAINS = {"excitatory": (0, 255, 1), "inhibitory": (-255, 0, 1), "mixed": (-256, 254, 2)}


def network(weights, model=None, n_out=1, synapse=None):
    """Projections p0, p1, ... of the given weights from as many sources onto one population."""
    net = neuro.Network("scale", resolution=1.0)
    net.population("out", n_out, model or neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=20.0))
    synapse = synapse or neuro.static()
    for k, weight in enumerate(weights):
        weight = np.asarray(weight, dtype=float)
        net.population(f"in{k}", weight.size // n_out, neuro.spike_generator())
        net.connect(f"in{k}", "out", neuro.all_to_all(), synapse, weight=weight, delay=1.0, name=f"p{k}")
    return compile_network(net, 0)


def on(name, program, **options):
    """The quantised program, which must not be refused."""
    fixed = quantise(program, chip(name), **options)
    assert [p for p in fixed.problems if p.refused] == []
    return fixed


def signs(weights):
    return "excitatory" if min(weights) >= 0 else "inhibitory" if max(weights) <= 0 else "mixed"


@st.composite
def representable(draw):
    """Mantissas of a sign mode, times any power of two."""
    mode = draw(st.sampled_from([*GRAINS]))
    low, high, grain = GRAINS[mode]
    values = st.integers(low // grain, high // grain).map(lambda k: k * grain)
    mantissas = draw(st.lists(values, min_size=1, max_size=20))
    if mode == "mixed":
        mantissas += [2, -2]
    return np.array(mantissas) * 2.0 ** draw(st.integers(-9, 3))


@given(representable())
@settings(deadline=None, max_examples=40)
def test_representable_weights_become_exact(weights):
    wires = on("loihi", network([weights])).projections[0]
    np.testing.assert_allclose(wires.weights(wires.mantissas), weights, rtol=1e-15, atol=0)
    assert (wires.rounding.saturated, wires.rounding.zeroed, wires.rounding.worst, wires.rounding.rms) == (0, 0, 0, 0)


WEIGHTS = st.lists(st.floats(-1e3, 1e3).filter(lambda w: w == 0 or abs(w) > 1e-3), min_size=1, max_size=12)
PARTS = st.lists(st.tuples(WEIGHTS, st.floats(1e-2, 1e2)), min_size=1, max_size=3)


@given(PARTS, st.floats(1.0, 1e3), st.floats(0.0, 1e3))
@settings(deadline=None, max_examples=40)
def test_no_weight_is_off_by_more_than_half_a_grain(parts, v_th, i_e):
    weights = [np.array(values) * factor for values, factor in parts]
    program = network(weights, neuro.iaf_psc_exp(E_L=0.0, V_reset=0.0, V_th=v_th, I_e=i_e))
    fixed = on("loihi", program)
    for wires, wanted in zip(fixed.projections, weights, strict=True):
        mode = signs(wanted)
        assert (wires.low, wires.high, wires.grain, wires.sign_mode) == (*GRAINS[mode], mode)
        off = np.abs(wires.weights(wires.mantissas) - wanted) / wires.step
        assert off.max() <= 0.5 * wires.grain * (1 + 1e-9)
        assert wires.rounding.saturated == 0.0
        assert wires.low <= wires.mantissas.min() <= wires.mantissas.max() <= wires.high
        np.testing.assert_array_equal(wires.words, np.clip(wires.mantissas << wires.exponent, -32767, 32767))
    registers = fixed.populations[0].registers
    assert 0 <= registers["vth"].min() <= registers["vth"].max() <= 131071
    assert np.abs(registers["bias_mant"]).max() <= 4095


@given(PARTS)
@settings(deadline=None, max_examples=40)
def test_words_of_spinnaker_are_off_by_at_most_half_a_unit(parts):
    weights = [np.array(values) * factor for values, factor in parts]
    program = network(weights, neuro.iaf_psc_exp(E_L=0.0, V_reset=0.0, V_th=15.0))
    fixed = on("spinnaker", program)
    for wires, wanted in zip(fixed.projections, weights, strict=True):
        np.testing.assert_array_less(np.abs(wires.exact(wanted) - wires.words), 0.5 + 1e-6)
        assert np.abs(wires.words).max() <= 65535


def test_slots_hold_all_that_may_arrive_in_one_step():
    weights = np.full(100, 1.0)
    fixed = on("spinnaker", network([weights], neuro.iaf_psc_delta(V_th=0.0, V_reset=-70.0)))
    shift = int(fixed.populations[0].registers["exc_shift"][0])
    assert shift == math.ceil(math.log2(100 * 32768 / 65535))
    assert fixed.projections[0].words.sum() <= 65535


def test_the_largest_weight_keeps_256_steps_where_very_many_converge():
    weights = np.full(100_000, 1.0)
    fixed = on("spinnaker", network([weights], neuro.iaf_psc_delta(V_th=0.0, V_reset=-70.0)))
    assert fixed.projections[0].words[0] == 256


# by hand


@given(st.floats(1.0, 1e5), st.integers(-8, 7))
@settings(deadline=None, max_examples=20)
def test_a_scale_and_an_exponent_by_hand_hold(scale, exponent):
    weight = 100.0 * 64.0 * 2.0**exponent / scale
    fixed = on("loihi", network([[weight]]), scales={"out": scale}, exponents={"p0": exponent})
    wires = fixed.projections[0]
    assert fixed.populations[0].volt == scale
    assert (wires.exponent, wires.mantissas.tolist()) == (exponent, [100])
    assert wires.words.tolist() == [math.floor(100 * 2.0**exponent)]
    assert fixed.populations[0].registers["vth"][0] == min(math.ceil(20.0 * scale / 64 - 1e-6) - 1, 131071)


def test_bits_that_a_negative_exponent_does_not_send_are_told():
    program = network([[7.0]])
    fixed = on("loihi", program, scales={"out": 64.0 / 2.0**4}, exponents={"p0": -4})
    wires = fixed.projections[0]
    assert (wires.mantissas.tolist(), wires.words.tolist()) == ([7], [0])
    assert wires.rounding.zeroed == 1.0
    assert "100.0% of the weights other than 0 become 0" in [p.why for p in fixed.problems]


@given(st.integers(0, 15), st.integers(0, 15))
@settings(deadline=None, max_examples=30)
def test_shifts_by_hand_hold(exc, inh):
    fixed = on("spinnaker", network([[0.5, -0.5]]), shifts={"out": (exc, inh)})
    registers = fixed.populations[0].registers
    assert (registers["exc_shift"][0], registers["inh_shift"][0]) == (exc, inh)
    assert fixed.projections[0].words.tolist() == [round(2.0 ** (14 - exc)), -round(2.0 ** (14 - inh))]


# neurons that differ, grids, plastic weights

DIFFERENT = st.lists(
    st.tuples(st.floats(2.0, 300.0), st.floats(10.0, 1e4), st.floats(1.0, 100.0), st.floats(-500.0, 500.0)),
    min_size=2,
    max_size=5,
)


@given(DIFFERENT, st.floats(1.0, 500.0), st.booleans())
@settings(deadline=None, max_examples=40)
def test_neurons_that_differ_have_each_their_registers_and_their_weights(neurons, peak, shared):
    tau_m, c_m, v_th, i_e = np.array(neurons).T
    n = len(neurons)
    model = neuro.iaf_psc_exp(tau_m=tau_m, C_m=c_m, E_L=0.0, V_reset=0.0, V_th=v_th, I_e=i_e)
    weights = np.full(2 * n, peak) if shared else np.linspace(0.5 * peak, peak, 2 * n)
    fixed = on("loihi", network([weights], model, n))
    cells, wires = fixed.populations[0], fixed.projections[0]
    got = wires.weights(wires.mantissas)
    np.testing.assert_array_less(np.abs(got - weights) / wires.step, 0.5 * (1 + 1e-9))
    potential = -np.expm1(-1.0 / tau_m) * tau_m / c_m * i_e * cells.volt
    bias = cells.registers["bias_mant"] << cells.registers["bias_exp"]
    np.testing.assert_array_less(np.abs(bias - potential), 0.5 * 2.0 ** cells.registers["bias_exp"][0] + 1e-6)
    threshold = 64 * (cells.registers["vth"] + 1)
    np.testing.assert_array_less(v_th * cells.volt - 1e-3, threshold)
    np.testing.assert_array_less(threshold, v_th * cells.volt + 64.001)
    np.testing.assert_array_equal(cells.registers["dv"], np.rint(-4096 * np.expm1(-1.0 / tau_m)))


@given(st.floats(1e-3, 1e3), st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=20)
def test_plastic_weights_reach_the_largest_mantissa_at_their_bound(bound, share):
    rule = neuro.stdp(Wmax=bound, lambda_=0.1)
    wires = on("loihi", network([[bound * share] * 3], synapse=rule)).projections[0]
    assert wires.exact(np.array([bound]))[0] == pytest.approx(255.0, rel=1e-9)


def test_weights_that_trials_teach_have_room_up_to_their_bound():
    net = neuro.Network("trials", resolution=1.0)
    net.population("in", 4, neuro.spike_generator())
    net.population("out", (2, 1, 1), neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=2.0))
    rule = neuro.r_stdp(Wmax=1.0)
    net.connect("in", "out", neuro.all_to_all(), rule, weight=0.3, delay=1.0, name="p")
    net.group("choice", neuro.winner_take_all(of="out"))
    net.trials(input="in", duration=10.0, labels={"of": "out", "maps_per_label": 1}, reward={"correct": 1, "wrong": -1})
    for name in ("loihi", "spinnaker"):
        wires = on(name, compile_network(net, 0)).projections[0]
        assert wires.exact(np.array([1.0]))[0] <= wires.high
        assert wires.exact(np.array([1.0]))[0] > 127


def test_a_weak_static_projection_beside_a_plastic_one_keeps_its_grain():
    net = neuro.Network("two", resolution=1.0)
    net.population("in", 4, neuro.spike_generator())
    net.population("out", 1, neuro.iaf_psc_exp())
    net.connect("in", "out", neuro.all_to_all(), neuro.stdp(Wmax=700.0), weight=100.0, delay=1.0, name="plastic")
    net.connect("in", "out", neuro.all_to_all(), weight=[20.0, 30.0, 40.0, 50.0], delay=1.0, name="weak")
    plastic, weak = on("loihi", compile_network(net, 0)).projections
    assert plastic.exact(np.array([700.0]))[0] == pytest.approx(255.0)
    assert weak.rounding.worst < 0.01


# speed


# room for many spikes in one step


def test_no_sum_wraps_when_all_synapses_of_a_neuron_are_active_at_once():
    net = neuro.Network("crowd", resolution=1.0)
    net.population("in", 100, neuro.spike_generator(spike_times=[[3.0]] * 100))
    net.population("out", 1, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=10.0, tau_m=math.inf))
    net.connect("in", "out", neuro.all_to_all(), weight=np.repeat([5.0, 0.5], 50), delay=1.0)
    sim = neuro.compile(net, "loihi", strict=True)
    sim.run(10.0)
    assert sim.spikes("out")[0].tolist() == [4.0]


def test_room_for_many_spikes_costs_no_precision():
    few, many = (on("loihi", network([np.repeat([0.3, 0.11], n)])) for n in (1, 20_000))
    assert many.projections[0].rounding.rms == few.projections[0].rounding.rms
    assert many.projections[0].exponent == 0 < few.projections[0].exponent
    assert many.populations[0].registers["vth"][0] >= 1023


def test_a_bias_has_room_for_the_rounding_of_its_two_parts():
    net = neuro.Network("bias", resolution=1.0)
    net.population("dc", 1, neuro.dc_generator(amplitude=2093.5))
    cells = neuro.iaf_psc_delta(tau_m=math.inf, C_m=1.0, E_L=0.0, V_reset=0.0, V_th=8e6, I_e=2001.5)
    net.population("out", 1, cells)
    net.connect("dc", "out", neuro.one_to_one(), weight=1.0, delay=1.0)
    sim = neuro.compile(net, "loihi", scales={"out": 1.0})
    sim.run(5.0)
    assert sim.get("out", "v", raw=True)[0] == pytest.approx(2 * 2001.5 + 3 * 4095.0, abs=8)


def test_the_shift_of_inhibition_is_that_of_its_own_weights():
    """One spike of strong inhibition fits into a slot, whatever the excitatory weights are."""
    fixed = on("spinnaker", network([[-100.0], [0.002]]))
    strong, weak = fixed.projections
    assert strong.weights(strong.mantissas)[0] == pytest.approx(-100.0, rel=1e-3)
    assert weak.weights(weak.mantissas)[0] == pytest.approx(0.002, rel=0.02)
    assert strong.rounding.saturated == 0.0
