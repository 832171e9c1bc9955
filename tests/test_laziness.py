"""What is computed lazily, kept in buffers or slept through shows nowhere: event gives what the reference gives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import neuro
from alike import alike
from neuro.run.simulation import Simulation


def both(net: neuro.Network, seed: int = 1) -> tuple[Simulation, Simulation]:
    return neuro.compile(net, backend="reference", seed=seed), neuro.compile(net, backend="event", seed=seed)


def one_cell(model: neuro.Neuron, spikes: list[float], weight: float) -> neuro.Network:
    net = neuro.Network("one", resolution=0.1)
    drive = net.population("drive", 1, neuro.spike_generator(spike_times=[spikes]))
    cells = net.population("cells", 1, model)
    net.connect(drive, cells, neuro.one_to_one(), weight=weight, delay=0.1)
    return net


@pytest.mark.parametrize("pause", [700.0, 1430.0, 2005.0])
@pytest.mark.parametrize(
    "model",
    [
        neuro.iaf_psc_exp(),
        neuro.iaf_psc_exp(tau_syn_ex=0.5),
        neuro.iaf_psc_exp(tau_syn_ex=30.0, tau_syn_in=0.1),
        neuro.iaf_psc_exp(tau_m=200.0),
        neuro.iaf_psc_alpha(),
        neuro.iaf_psc_alpha(tau_syn_ex=0.5, tau_m=100.0),
        neuro.iaf_psc_alpha(tau_syn_ex=30.0),
    ],
)
def test_a_long_silence_leaves_what_steps_would_leave(model, pause):
    again = 5.0 + pause
    net = one_cell(model, [5.0, again, again + 1.0, again + 2.0], 20000.0)
    step_by_step, at_once = neuro.compile(net, seed=1), neuro.compile(net, seed=1)
    at_once.run(again - 0.1)
    step_by_step.run(5.0)
    for _ in range(int((pause - 0.1) / 10.0)):  # what is read is brought up; a value that is set wakes the neuron
        step_by_step.run(10.0)
        step_by_step.set("cells", V_m=step_by_step.get("cells", "V_m"))
    step_by_step.run(again - 0.1 - step_by_step.time)
    for state in ("V_m", "I_syn_ex"):
        assert at_once.get("cells", state) == pytest.approx(step_by_step.get("cells", state), rel=1e-9, abs=1e-12)
    at_once.run(50.0)
    step_by_step.run(50.0)
    assert np.isfinite(at_once.get("cells", "V_m")).all()
    assert len(at_once.spikes("cells")[0]) >= 2
    assert np.array_equal(at_once.spikes("cells")[0], step_by_step.spikes("cells")[0])


def test_a_neuron_fires_after_a_long_silence():
    sims = alike(one_cell(neuro.iaf_psc_exp(), [5.0, 2010.0, 2011.0, 2012.0], 3e3), 2050.0)
    assert len(sims[0].spikes("cells")[0]) > 1


def plastic(t_ref: float, delay: float, **rule: float) -> neuro.Network:
    """Two sources onto two neurons that fire as often as they can, by synapses that do not drive them."""
    net = neuro.Network("plastic", resolution=1.0)
    times = [[3.0, 40.0, 90.0, 400.0], [10.0, 260.0]]
    drive = net.population("drive", 2, neuro.spike_generator(spike_times=times))
    cells = net.population("cells", 2, neuro.iaf_psc_delta(t_ref=t_ref, I_e=1e5))
    net.connect(drive, cells, neuro.all_to_all(), neuro.stdp(**rule), weight=1e-3, delay=delay, name="learnt")
    return net


@pytest.mark.parametrize("delay", [1.0, 25.0, 60.0])
def test_histories_hold_the_spikes_of_a_shorter_refractoriness(delay):
    reference, event = both(plastic(2.0, delay))
    for sim in (reference, event):
        sim.run(100.0)
        sim.set("cells", t_ref=0.0)
        sim.run(350.0)
        sim.set("cells", t_ref=[5.0, 0.0])
        sim.run(150.0)
    assert np.array_equal(event.spikes("cells")[1], reference.spikes("cells")[1])
    assert event.weights("learnt")[2] == pytest.approx(reference.weights("learnt")[2], rel=1e-12)


def test_wider_histories_are_kept_by_reset_and_files(tmp_path):
    reference, event = both(plastic(2.0, 25.0))
    for sim in (reference, event):
        sim.run(100.0)
        sim.set("cells", t_ref=0.0)
    event.save(tmp_path / "state.h5")
    other = neuro.compile(plastic(2.0, 25.0), backend="event", seed=1)
    other.restore(tmp_path / "state.h5")
    for sim in (reference, event, other):
        sim.run(400.0)
    assert other.weights("learnt")[2] == pytest.approx(reference.weights("learnt")[2], rel=1e-12)
    for sim in (reference, event):
        sim.reset()
        sim.run(300.0)
    assert np.array_equal(event.spikes("cells")[0], reference.spikes("cells")[0])
    assert event.weights("learnt")[2] == pytest.approx(reference.weights("learnt")[2], rel=1e-12)


def test_making_room_in_a_history_does_not_clip_within_a_delivery_interval():
    """The 29th post spike finds the history full at 80 ms; n falls through b at 88 ms, and NEST clips at 100 ms."""
    net = neuro.Network("clipped", resolution=0.1)
    posts = [*np.arange(2.0, 57.0, 2.0), 80.0]
    pre = net.population("pre", 1, neuro.spike_generator(spike_times=[[1.0]]))
    drive = net.population("drive", 1, neuro.spike_generator(spike_times=[posts]))
    cells = net.population("cells", 1, neuro.iaf_psc_delta(V_th=1e4, t_ref=1.9))
    net.connect(drive, cells, neuro.one_to_one(), weight=1e5, delay=0.1)
    net.signal("reward", to=cells)
    rule = neuro.stdp_dopa(
        signal="reward", Wmax=100.0, tau_n=50.0, tau_c=2000.0, b=0.01, A_plus=10.0, A_minus=0.0, deliver_interval=500
    )
    net.connect(pre, cells, neuro.all_to_all(), rule, weight=99.0, delay=20.0, name="learnt")
    seen = []
    for sim in both(net):
        sim.run(5.0)
        sim.signal("reward", 0.01 * np.exp(83.0 / 50.0))
        for until in (42.0, 100.0, 101.0, 130.0):
            sim.run(until - sim.time)
            seen.append(sim.weights("learnt")[2][0])
    assert seen[1] == 100.0 > seen[2] > seen[3]
    assert seen[4:] == pytest.approx(seen[:4], rel=1e-12)


def test_weights_set_one_by_one_behind_a_fast_poisson_generator():
    net = neuro.Network("fast", resolution=0.1)
    drive = net.population("drive", 3, neuro.poisson_generator(rate=600000.0))
    cells = net.population("cells", 3, neuro.iaf_psc_exp(V_th=1e6))
    others = net.population("others", 3, neuro.iaf_psc_exp(V_th=1e6))
    net.connect(drive, cells, neuro.one_to_one(), weight=1.0, delay=0.5, name="to_cells")
    net.connect(drive, others, neuro.one_to_one(), weight=2.0, delay=0.3, name="to_others")
    for first in (0.0, 5.0):
        reference, event = both(net)
        for sim in (reference, event):
            sim.run(first)
            sim.set_weights("to_cells", [1.0, -2.0, 3.0])
            sim.run(0.1)
        for _ in range(8):
            for population in ("cells", "others"):
                for state in ("V_m", "I_syn_ex", "I_syn_in"):
                    assert event.get(population, state) == pytest.approx(reference.get(population, state), rel=1e-12)
            reference.run(0.1)
            event.run(0.1)
        assert event.counts() == reference.counts()


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize(("start", "first"), [(0.0, 1.2), (0.1, 1.2), (0.2, 1.3)])
def test_a_current_that_starts_at_once_begins_where_nest_begins_it(backend, start, first):
    """NEST 3.10 emits no current in the first step: start = 0 and start = h give the same trace."""
    net = neuro.Network("current", resolution=0.1)
    source = net.population("source", 1, neuro.dc_generator(amplitude=100.0, start=start))
    cells = net.population("cells", 1, neuro.iaf_psc_exp())
    net.connect(source, cells, neuro.one_to_one(), weight=1.0, delay=1.0)
    net.probe("V", cells, "V_m", every=0.1)
    sim = neuro.compile(net, backend=backend)
    sim.run(3.0)
    times, v = sim.trace("V")
    assert times[np.argmax(v[:, 0] > -70.0)] == pytest.approx(first)
    assert v[np.argmax(v[:, 0] > -70.0), 0] + 70.0 == pytest.approx(0.03980067, abs=1e-8)


def test_weights_and_amplitudes_of_a_current_act_where_nest_lets_them_act():
    """NEST 3.10: an amplitude that is set at 1 ms changes V_m first at 2.2 ms, over a delay of 1 ms."""
    net = neuro.Network("current", resolution=0.1)
    source = net.population("source", 1, neuro.dc_generator(amplitude=0.0))
    cells = net.population("cells", 1, neuro.iaf_psc_exp())
    net.connect(source, cells, neuro.one_to_one(), weight=1.0, delay=1.0, name="wire")
    net.probe("V", cells, "V_m", every=0.1)
    seen = []
    for sim in both(net):
        sim.run(1.0)
        sim.set("source", amplitude=200.0)
        sim.run(2.0)
        sim.set_weights("wire", 0.5)
        sim.run(2.0)
        times, v = sim.trace("V")
        seen.append(v[:, 0])
        assert times[np.argmax(v[:, 0] > -70.0)] == pytest.approx(2.2)
        assert v[np.argmax(v[:, 0] > -70.0), 0] + 70.0 == pytest.approx(0.07960133, abs=1e-8)
        growth = np.diff(v[:, 0])
        assert times[1 + np.argmax(growth[25:] < 0.6 * growth[24:-1]) + 25] == pytest.approx(4.2)
    assert np.array_equal(seen[0], seen[1])


def test_a_current_that_is_set_at_every_step_keeps_no_history():
    net = neuro.Network("current", resolution=0.1)
    source = net.population("source", 1, neuro.dc_generator(amplitude=0.0))
    cells = net.population("cells", 1, neuro.iaf_psc_exp(V_th=1e3))
    net.connect(source, cells, neuro.one_to_one(), weight=1.0, delay=0.5, name="wire")
    reference, event = both(net)
    for k in range(100):
        for sim in (reference, event):
            sim.set("source", amplitude=float(k % 7) * 100.0)
            sim.run(0.1)
    assert event.get("cells", "V_m") == pytest.approx(reference.get("cells", "V_m"), abs=1e-12)
    event.run(10.0)
    event.set("source", amplitude=1.0)
    state = event._engine.snapshot()
    assert len(state["current.0"]) <= 2


def test_the_lowest_potential_bounds_a_neuron_while_it_sleeps():
    """Inhibition holds V_m at V_min for a while: in one long step it would rise from far below."""
    net = one_cell(neuro.iaf_psc_alpha(V_min=-75.0, tau_syn_in=60.0), [5.0], -300.0)
    reference, event = both(net)
    for sim in (reference, event):
        sim.run(30.0)
        sim.run(170.0)
    assert event.get("cells", "V_m") == pytest.approx(reference.get("cells", "V_m"), abs=1e-9)
    assert -75.0 < event.get("cells", "V_m")[0] < -70.0


@pytest.mark.parametrize("delay", [0.1, 2.0])
@pytest.mark.parametrize("silent", [slice(None), slice(64, 128)])
def test_a_generator_that_falls_silent_sends_what_is_under_way_and_nothing_old(delay: float, silent: slice):
    def potentials(backend: str) -> list[NDArray[np.float64]]:
        net = neuro.Network("hush", resolution=0.1)
        noise = net.population("noise", 200, neuro.poisson_generator(rate=2000.0))
        cells = net.population("cells", 200, neuro.iaf_psc_delta(V_th=1e9))
        net.connect(noise, cells, neuro.one_to_one(), weight=1.0, delay=delay)
        sim = neuro.compile(net, backend)
        found, rate = [], np.full(200, 2000.0)
        for level in (0.0, 2000.0, 0.0, 1000.0):
            sim.run(4.0)
            rate[silent] = level
            sim.set("noise", rate=rate)
            for length in (0.1, 0.3, 5.0):
                sim.run(length)
                found.append(sim.get("cells", "V_m"))
        return found

    for expected, found in zip(potentials("reference"), potentials("event"), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
