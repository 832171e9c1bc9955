"""What reads as a weight on Loihi is what a spike sends; what the exponent and the weight bits take is told."""

import numpy as np
import pytest

import neuro

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
