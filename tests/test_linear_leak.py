"""iaf_linear_leak beside its closed forms: straight lines that end at E_L."""

import numpy as np
import pytest

import neuro
from neuro.model.neurons import iaf_linear_leak

REST = {"E_L": 0.0, "V_reset": 0.0, "V_th": 20.0}


def alone(
    model: iaf_linear_leak, v_0: float = 0.0, spikes: tuple[float, ...] = (), weight: float = 1.0, ms: float = 20.0
):
    """V_m of one neuron after each step of 0.1 ms, and its spikes."""
    net = neuro.Network("alone", resolution=0.1)
    net.population("input", 1, neuro.spike_generator(spike_times=[list(spikes)]))
    net.population("cell", 1, model, initial={"V_m": v_0})
    net.connect("input", "cell", neuro.all_to_all(), weight=weight, delay=1.0)
    net.probe("v", "cell", "V_m", every=0.1)
    sim = neuro.compile(net)
    sim.run(ms)
    times, values = sim.trace("v")
    return times, values[:, 0], sim.spikes("cell")[0]


def test_a_jump_leaks_in_a_straight_line_and_ends_at_rest():
    t, v, _ = alone(iaf_linear_leak(leak=0.7, **REST), spikes=(2.0,), weight=5.0)
    np.testing.assert_allclose(v, np.where(t >= 2.95, np.clip(5.0 - 0.7 * (t - 3.0), 0.0, None), 0.0), atol=1e-12)
    assert np.all(v[t > 3.0 + 5.0 / 0.7] == 0.0)


def test_below_rest_it_rises():
    t, v, _ = alone(iaf_linear_leak(leak=0.7, **REST), v_0=-5.0)
    np.testing.assert_allclose(v, np.clip(-5.0 + 0.7 * t, None, 0.0), atol=1e-12)
    assert v[-1] == 0.0


@pytest.mark.parametrize("v_0", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("slope", [-0.9, -0.3, 0.3, 0.9])
def test_a_current_bends_the_line_at_rest(v_0, slope):
    """The current alone moves V by `slope` mV/ms, the leak of 0.5 mV/ms holds it back."""
    t, v, _ = alone(iaf_linear_leak(leak=0.5, C_m=100.0, I_e=100.0 * slope, **REST), v_0=v_0)
    towards = slope - 0.5 * np.sign(v_0)
    arrives = -v_0 / towards if v_0 * towards <= 0.0 else np.inf
    away = np.sign(slope) * max(abs(slope) - 0.5, 0.0)
    until = np.minimum(t, arrives)
    np.testing.assert_allclose(v, v_0 + towards * until + away * (t - until), atol=1e-12)


def test_it_fires_at_the_period_of_a_straight_line():
    """t_ref, from V_reset to E_L at I / C_m + leak, from there to V_th at I / C_m - leak; the next step fires."""
    model = iaf_linear_leak(leak=1.5, C_m=200.0, I_e=800.0, t_ref=2.0, E_L=0.0, V_reset=-1.0, V_th=7.03)
    _, _, spikes = alone(model, ms=200.0)
    np.testing.assert_allclose(np.diff(spikes), 2.0 + np.ceil(10.0 * (1.0 / 5.5 + 7.03 / 2.5)) / 10.0)
    assert spikes.size == 40


def test_input_is_lost_while_refractory():
    model = iaf_linear_leak(leak=1.0, t_ref=3.0, **REST)
    _, v, spikes = alone(model, spikes=(1.0, 3.0, 8.0), weight=20.0)
    np.testing.assert_allclose(spikes, [2.0, 9.0])
    assert np.all(v == 0.0)


def test_it_sleeps_where_a_step_changes_nothing():
    model = iaf_linear_leak(leak=0.5, C_m=100.0, **REST)
    arithmetic, c, s, i_0 = model.arithmetic, np.zeros(model.width), np.zeros((2, 1)), np.zeros(1)
    arithmetic.constants(np.array(list(model.parameters().values())), 0.1, c)

    def quiet(v, current, held=0.0):
        s[:, 0], i_0[0] = (v, held), current
        return arithmetic.quiet(s, c, i_0, 0, 1)

    assert quiet(0.0, 0.0)
    assert quiet(0.0, 50.0)  # held by the leak
    assert not quiet(0.0, 51.0)
    assert not quiet(1e-12, 0.0)
    assert not quiet(0.0, 0.0, held=1.0)
    assert not iaf_linear_leak.linear


def test_no_leak_keeps_what_came():
    _, v, _ = alone(iaf_linear_leak(leak=0.0, **REST), spikes=(1.0, 5.0), weight=3.0)
    assert v[-1] == 6.0
