"""Registers that overflow while a network runs: counted, told, errors where strict, and avoided where possible."""

import warnings

import numpy as np
import pytest

import neuro


def constant_drive(tau_syn):
    """A neuron that hears its strong input in every step."""
    net = neuro.Network("drive", resolution=1.0)
    net.population("in", 4, neuro.spike_generator(spike_times=[np.arange(1.0, 400.0)] * 4))
    cells = neuro.iaf_psc_exp(tau_m=5.0, tau_syn_ex=tau_syn, tau_syn_in=tau_syn, t_ref=2.0)
    net.population("out", 1, cells)
    net.connect("in", "out", neuro.all_to_all(), weight=200.0, delay=1.0)
    return net


@pytest.mark.parametrize("tau_syn", [2.0, 20.0, 80.0])
def test_automatic_scales_leave_room_for_input_in_every_step(tau_syn):
    spikes = {}
    for backend in ("event", "loihi"):
        sim = neuro.compile(constant_drive(tau_syn), backend=backend)
        sim.run(400.0)
        spikes[backend] = sim.counts().spikes
        assert sim.counts().native == {}
    assert abs(spikes["loihi"] - spikes["event"]) <= 1


def test_an_overflow_is_told_once_with_a_way_out():
    sim = neuro.compile(constant_drive(80.0), backend="loihi", scales={"out": 1e5})
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sim.run(400.0)
    texts = [str(warning.message) for warning in told if "current wraps" in str(warning.message)]
    assert len(texts) == 1
    assert texts[0].endswith("\n  hint: scales={'out': 2.5e+04} leaves 4 times the room")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.run(1.0)
    assert sim.counts().native["current wraps of out"] > 0


def test_an_overflow_stops_a_strict_run():
    sim = neuro.compile(constant_drive(80.0), backend="loihi", scales={"out": 1e5}, strict=True)
    with pytest.raises(neuro.ModelError, match="current wraps of out"):
        sim.run(400.0)


def test_a_sum_beyond_32_bits_is_counted_too():
    net = neuro.Network("sum", resolution=1.0)
    net.population("in", 2064, neuro.spike_generator(spike_times=[[1.0]] * 2064))
    net.population("out", 1, neuro.loihi_lif(du=4095, dv=4095, vth=131071))
    net.connect("in", "out", neuro.all_to_all(), neuro.loihi_static(weight_exp=7), weight=254.0, delay=1.0)
    sim = neuro.compile(net, backend="loihi")
    with pytest.warns(neuro.OverflowWarning, match="1 current wraps of out"):
        sim.run(3.0)


def test_float_backends_take_strict_too():
    for backend in ("event", "reference"):
        neuro.compile(constant_drive(2.0), backend=backend, strict=True).run(5.0)
