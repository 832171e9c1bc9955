"""What is read, set, saved and reset while an emulated chip runs."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro.run.compiled import ApproximationWarning
from neuro.run.simulation import Simulation
from refused import refused

CHIPS = ("loihi", "spinnaker")


def fed(weight: object = 400.0, synapse: object = None, **words: float) -> neuro.Network:
    """Two sources onto two neurons, each to each."""
    net = neuro.Network("fed", resolution=1.0)
    source = net.population("source", 2, neuro.spike_generator(spike_times=[[2.0, 9.0, 20.0], [4.0, 9.0, 21.0]]))
    cells = net.population("cells", 2, neuro.iaf_psc_exp(**words))
    net.connect(source, cells, neuro.all_to_all(), synapse or neuro.static(), weight=weight, name="in")
    return net


def made(net: neuro.Network, backend: str) -> Simulation:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ApproximationWarning)
        return neuro.compile(net, backend)


@pytest.mark.parametrize("backend", CHIPS)
def test_neurons_that_come_to_differ_receive_their_own_words(backend: str):
    """A shared word becomes one for each synapse; the loop must read the new ones at once."""
    sim, right = made(fed(), backend), made(fed(), "reference")
    for each in (sim, right):
        each.set("cells", tau_m=np.array([5.0, 40.0]))
        each.run(30.0)
    assert np.abs(sim.get("cells", "V_m") - right.get("cells", "V_m")).max() < 0.05
    assert right.get("cells", "V_m").max() > -69.0


@pytest.mark.parametrize("backend", CHIPS)
def test_weights_are_rounded_once_however_often_the_scale_changes(backend: str):
    sim = made(fed(np.array([[400.0, 313.0], [111.0, 57.0]])), backend)
    first = sim.get("in", "weight")
    for tau in (5.0, 9.0, 6.5, 10.0):
        sim.set("cells", tau_m=tau)
    assert np.array_equal(sim.get("in", "weight"), first)


@pytest.mark.parametrize("backend", CHIPS)
def test_a_reset_brings_the_described_weights_back_at_any_scale(backend: str):
    sim = made(fed(), backend)
    sim.set_weights("in", [100.0, 200.0, 300.0, 50.0])
    sim.set("cells", tau_m=20.0)
    sim.reset(weights=True)
    assert sim.get("in", "weight") == pytest.approx(400.0, rel=0.01)


@pytest.mark.parametrize("backend", CHIPS)
def test_a_saved_state_has_its_scale_and_its_shared_weight(backend: str, tmp_path: Path):
    saved, other = made(fed(), backend), made(fed(), backend)
    saved.set("cells", tau_m=20.0)
    saved.save(tmp_path / "state.h5")
    other.set_weights("in", [100.0, 200.0, 300.0, 50.0])
    other.restore(tmp_path / "state.h5")
    assert np.array_equal(other.get("in", "weight"), saved.get("in", "weight"))
    for sim in (saved, other):
        sim.run(30.0)
    assert np.array_equal(other.get("cells", "V_m"), saved.get("cells", "V_m"))


@pytest.mark.parametrize("backend", CHIPS)
def test_an_amplitude_that_was_set_holds_from_step_0_after_a_reset(backend: str):
    net = neuro.Network("driven", resolution=1.0)
    source = net.population("source", 1, neuro.dc_generator(amplitude=500.0))
    cells = net.population("cells", 1, neuro.iaf_psc_exp())
    net.connect(source, cells, neuro.all_to_all())
    sim = made(net, backend)
    sim.run(10.0)
    sim.set("source", amplitude=0.0)
    sim.reset()
    sim.run(10.0)
    assert sim.get("cells", "V_m") == pytest.approx(-70.0)


def learner() -> Simulation:
    """Neurons that are taught by both sources."""
    return made(fed(400.0, neuro.stdp(lambda_=0.2, Wmax=900.0), I_e=900.0), "loihi")


@pytest.mark.parametrize("raw", [False, True])
def test_reading_what_is_learnt_sends_nothing_earlier(raw: bool, tmp_path: Path):
    """What the last step taught is sent one step later, whether it was read and saved before or not."""
    through, saved, other = learner(), learner(), learner()
    for k in range(9, 22):
        for sim in (through, saved):
            sim.run(k - sim.time)
        saved.get("in", "weight", raw=raw)
        saved.save(tmp_path / f"{k}.h5")
        other.restore(tmp_path / f"{k}.h5")
        for sim in (through, other):
            sim.run(4.0)
        assert np.array_equal(through.get("cells", "V_m"), other.get("cells", "V_m"))
        through.restore(tmp_path / f"{k}.h5")


def test_a_projection_that_learns_keeps_its_scale(messages):
    sim = learner()
    messages({"in": refused(sim.set, "cells", tau_m=20.0)})
    assert sim.get("cells", "tau_m") == pytest.approx(10.0)
    sim.set("cells", V_th=-50.0)


@pytest.mark.parametrize("chip", ["loihi", "spinnaker"])
def test_words_are_set_together_or_not_at_all(chip, messages):
    net = neuro.Network("together", resolution=1.0)
    net.population("out", 2, neuro.iaf_psc_exp())
    sim = neuro.compile(net, backend=chip)
    sim.set("out", E_L=-60.0, V_reset=-60.0)
    np.testing.assert_allclose(sim.get("out", "V_m"), -70.0, atol=1e-4)
    sim.set("out", E_L=-65.0, V_reset=-65.0, V_m=-62.0)
    np.testing.assert_allclose(sim.get("out", "V_m"), -62.0, atol=1e-4)
    messages({f"{chip} {word}": refused(sim.set, "out", tau_m=20.0, **{word: 1e6}) for word in ("V_th", "V_m")})
    assert (sim.get("out", "tau_m") == 10.0).all()


@pytest.mark.parametrize("chip", ["loihi", "spinnaker"])
def test_a_current_that_overflows_is_refused_and_changes_nothing(chip, messages):
    net = neuro.Network("current", resolution=1.0)
    net.population("dc", 1, neuro.dc_generator(amplitude=100.0))
    net.population("out", 2, neuro.iaf_psc_exp())
    net.connect("dc", "out", neuro.all_to_all(), weight=1.0, delay=1.0)
    sim = neuro.compile(net, backend=chip)
    messages({chip: refused(sim.set, "dc", amplitude=1e11)})
    assert sim.get("dc", "amplitude").tolist() == [100.0]
    sim.run(20.0)


def test_mantissas_that_are_set_are_those_that_are_described(messages):
    for told in ([3.0, 101.0, -101.0], [2.0, 7.0, 254.0]):
        net = neuro.Network("native", resolution=1.0)
        net.population("in", 3, neuro.spike_generator(spike_times=[[1.0]] * 3))
        net.population("out", 1, neuro.loihi_lif(du=4095, dv=0, vth=131071))
        net.connect(
            "in", "out", neuro.all_to_all(), neuro.loihi_static(), weight=np.array(told)[:, None], delay=1.0, name="w"
        )
        described = neuro.compile(net, backend="loihi")
        other = neuro.compile(net, backend="loihi")
        other.set_weights("w", np.zeros(3))
        other.set_weights("w", np.array(told))
        for sim in (described, other):
            sim.run(3.0)
        assert (described.get("out", "v") == other.get("out", "v")).all()
        assert (described.get("w", "weight", raw=True) == other.get("w", "weight", raw=True)).all()
        messages({"w": refused(other.set_weights, "w", [1.5, 2.0, 3.0])})


def test_a_state_register_takes_whole_numbers_only(messages):
    net = neuro.Network("registers", resolution=1.0)
    net.population("out", 2, neuro.loihi_lif(vth=100))
    sim = neuro.compile(net, backend="loihi")
    messages({"v": refused(sim.set, "out", v=[3.0, 0.7])})
    assert sim.get("out", "v").tolist() == [0.0, 0.0]


@pytest.mark.parametrize("order", [("I_syn_ex", "I_syn_in"), ("I_syn_in", "I_syn_ex")])
def test_the_one_current_of_loihi_is_the_sum_of_both_that_are_set(order):
    net = neuro.Network("sum", resolution=1.0)
    net.population("source", 1, neuro.spike_generator())
    net.population("cells", 2, neuro.iaf_psc_exp(tau_syn_in=2.0, tau_syn_ex=2.0))
    net.connect("source", "cells", neuro.all_to_all(), weight=500.0)
    sim = neuro.compile(net, "loihi")
    values = {"I_syn_ex": 400.0, "I_syn_in": np.array([-100.0, -700.0])}
    sim.set("cells", **{name: values[name] for name in order})
    assert sim.get("cells", "I_syn_ex") == pytest.approx([300.0, 0.0], rel=0.02)
    assert sim.get("cells", "I_syn_in") == pytest.approx([0.0, -300.0], rel=0.02)


def test_a_state_of_learning_by_an_earlier_version_is_refused_and_changes_nothing():
    sim = made(fed(np.array([100.0, 200.0, 300.0, 50.0]), neuro.stdp(Wmax=400.0)), "loihi")
    sim.run(15.0)
    state = sim._engine.snapshot()
    sim.run(15.0)
    before = sim.get("cells", "V_m"), sim.get("in", "weight")
    del state["plastic.0.tx"]
    assert "the snapshot lacks 'plastic.0.tx': an earlier version" in refused(sim._engine.restore, state)
    assert np.array_equal(sim.get("cells", "V_m"), before[0])
    assert np.array_equal(sim.get("in", "weight"), before[1])


MANTISSAS = {"mixed": np.arange(-256, 255), "excitatory": np.arange(256), "inhibitory": np.arange(-255, 1)}


def wired(weight, **registers):
    """One compartment for each weight, all driven by one spike of one source."""
    weight = np.atleast_1d(np.asarray(weight, dtype=float))
    net = neuro.Network("words", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("out", weight.size, neuro.loihi_lif(vth=131071))
    net.connect("in", "out", neuro.all_to_all(), neuro.loihi_static(**registers), weight=weight[None], name="p")
    return net


def test_a_weight_that_the_exponent_shifts_to_nothing_is_told():
    with pytest.warns(neuro.ApproximationWarning) as told:
        sim = neuro.compile(wired(254.0, weight_exp=-8), backend="loihi")
    assert [str(warning.message).split(": ", 2)[2] for warning in told] == [
        "projection 'p': 100.0% of the weights other than 0 become 0\n  hint: use a larger weight_exp",
        "projection 'p': 100.0% is the rms error of the weights\n  hint: use a larger weight_exp",
    ]
    assert sim.get("p", "weight").tolist() == [0.0]
    assert sim.get("p", "weight", raw=True).tolist() == [254]


def test_a_negative_weight_that_the_shift_makes_larger_is_told():
    with pytest.warns(neuro.ApproximationWarning, match="300.0% is the rms error of the weights"):
        sim = neuro.compile(wired(-4.0, weight_exp=-4), backend="loihi")
    assert sim.get("p", "weight").tolist() == [-16.0]


def test_bits_that_the_weight_memory_does_not_keep_are_told_with_a_way_out():
    hint = "hint: use mantissas that are multiples of 16"
    with pytest.warns(neuro.ApproximationWarning, match=hint):
        sim = neuro.compile(wired(100.0, num_weight_bits=5), backend="loihi")
    assert sim.get("p", "weight").tolist() == [96.0]


def test_a_loss_within_the_limits_is_read_but_not_warned_of():
    sim = neuro.compile(wired([127.0, 126.0]), backend="loihi")
    assert sim.get("p", "weight").tolist() == [126.0, 126.0]
    assert sim.get("p", "weight", raw=True).tolist() == [127, 126]


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("mode", MANTISSAS)
@pytest.mark.parametrize("exponent", [-8, -1, 0, 7])
def test_every_weight_reads_as_what_a_spike_adds_and_can_be_written_back(mode, exponent):
    sim = neuro.compile(wired(MANTISSAS[mode], sign_mode=mode, weight_exp=exponent), backend="loihi")
    acting = sim.get("p", "weight")
    sim.set_weights("p", acting)
    assert sim.get("p", "weight").tolist() == acting.tolist()
    sim.run(2.0)
    assert sim.get("out", "u").tolist() == (64.0 * 2.0**exponent * acting).tolist()


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_a_weight_that_learns_reads_as_what_it_sends():
    net = neuro.Network("plastic", resolution=1.0)
    net.population("in", 4, neuro.spike_generator())
    net.population("out", 1, neuro.iaf_psc_exp())
    weight = np.array([[200.0], [330.0], [415.0], [700.0]])
    net.connect("in", "out", neuro.all_to_all(), neuro.stdp(Wmax=700.0), weight=weight, delay=1.0, name="p")
    for exponent in (0, -3):
        scales = {"out": neuro.compile(net, backend="loihi")._engine.fixed.populations[1].volt}
        sim = neuro.compile(net, backend="loihi", exponents={"p": exponent}, scales={"out": scales["out"] / 2**8})
        raw, step = sim.get("p", "weight", raw=True), sim._engine.fixed.projections[0].step[0]
        kept = raw >> -exponent << -exponent
        np.testing.assert_allclose(sim.get("p", "weight"), kept * step, rtol=1e-12)
