"""Registers that overflow while a network runs: counted, told, errors where strict, and avoided where possible."""

import warnings

import numpy as np
import pytest

import neuro
from beside import beside
from neuro.chips import chip, filled, quantise


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


@pytest.mark.parametrize(("tau_syn", "scale"), [(2.0, 1e5), (80.0, 1e5), (80.0, 2e4), (2.0, 5e5)])
def test_how_much_of_its_registers_an_input_takes_says_whether_it_wraps(tau_syn, scale):
    sim = neuro.compile(constant_drive(tau_syn), backend="loihi", scales={"out": scale})
    fixed = quantise(sim.program, chip("loihi"), scales={"out": scale})
    (share,) = filled(fixed, {"in": np.ones((1, 399, 4))}).values()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", neuro.OverflowWarning)
        sim.run(400.0)
    wrapped = {f"{what} wraps of out" for what in ("input", "current")} & sim.counts().native.keys()
    assert (share >= 1.0) == bool(wrapped)
    on = quantise(sim.program, chip("spinnaker"))
    assert filled(on, {"in": np.ones((1, 399, 4))}) == {}  # its slots saturate


def test_an_overflow_is_told_once_with_a_way_out():
    sim = neuro.compile(constant_drive(80.0), backend="loihi", scales={"out": 1e5})
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sim.run(400.0)
    texts = [str(warning.message) for warning in told if "current wraps" in str(warning.message)]
    assert len(texts) == 1
    assert texts[0].endswith("\n  hint: scales={'out': 2.5e+04} makes all registers a quarter as full")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.run(1.0)
    assert sim.counts().native["current wraps of out"] > 0


def test_an_overflow_stops_a_strict_run():
    sim = neuro.compile(constant_drive(80.0), backend="loihi", scales={"out": 1e5}, strict=True)
    with pytest.raises(neuro.ModelError, match="current wraps of out"):
        sim.run(400.0)


(WRAPPED,) = beside(__file__, "wrapped")
"""Mantissa, spikes of each step and registers; u and v of nengo-loihi 1.1.0's `CompartmentState`; what is counted."""


@pytest.mark.parametrize("case", WRAPPED)
def test_sums_wrap_as_in_nengo_loihi_and_are_counted(case):
    words = ("weight", "arriving", "registers", "u", "v", "native")
    weight, arriving, registers, u, v, native = (WRAPPED[case][word] for word in words)
    net = neuro.Network("wraps", resolution=1.0)
    times = [[k + 1.0 for k, spikes in enumerate(arriving) if spikes > i] for i in range(5)]
    net.population("in", 5, neuro.spike_generator(spike_times=times))
    net.population("out", 1, neuro.loihi_lif(vth=131071, **registers))
    net.connect("in", "out", neuro.all_to_all(), neuro.loihi_static(weight_exp=7), weight=weight, delay=1.0)
    for state in "uv":
        net.probe(state, "out", state)
    sim = neuro.compile(net, backend="loihi")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sim.run(len(arriving) + 1.0)
    first = {str(warning.message).split(" up to step")[0] for warning in told}
    assert first == {f"backend 'loihi': 1 {what}" for what in native}  # told once each, at the first
    assert sim.trace("u")[1][1 : len(u) + 1, 0].tolist() == u
    assert sim.trace("v")[1][1 : len(v) + 1, 0].tolist() == v
    assert sim.counts().native == native


def test_a_conductance_of_spinnaker_that_wraps_is_counted():
    net = neuro.Network("g", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=[np.arange(1.0, 50.0)]))
    cells = neuro.spinnaker_lif(exc_shift=15, exc_decay=2**32 - 1, exc_init=2**32 - 1, r_m=0)
    net.population("out", 1, cells)
    net.connect("in", "out", neuro.all_to_all(), weight=65535.0, delay=1.0)
    net.probe("g", "out", "g_exc")
    sim = neuro.compile(net, backend="spinnaker")
    with pytest.warns(neuro.OverflowWarning, match="1 current wraps of out"):
        sim.run(4.0)
    assert sim.trace("g")[1].min() < 0.0


def test_float_backends_take_strict_too():
    for backend in ("event", "reference"):
        neuro.compile(constant_drive(2.0), backend=backend, strict=True).run(5.0)


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("weight", [20.0, -20.0])
def test_slots_of_spinnaker_that_saturate_are_told(weight):
    net = neuro.Network("drive", resolution=1.0)
    net.population("in", 40, neuro.spike_generator(spike_times=[[2.0]] * 40))
    net.population("out", 1, neuro.iaf_psc_delta())
    net.connect("in", "out", neuro.all_to_all(), weight=weight, delay=1.0)
    sim = neuro.compile(net, "spinnaker", shifts={"out": (5, 5)})
    with pytest.warns(neuro.OverflowWarning, match="1 slot saturations of out"):
        sim.run(10.0)
    assert sim.counts().native["slot saturations of out"] == 1
