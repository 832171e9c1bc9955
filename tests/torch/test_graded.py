"""Graded neurons by torch: payloads as on event, gradients as finite differences, messages in the bill."""

import numpy as np
import pytest

import neuro
from graded import STEPS, network, twin
from neuro.chips import chip, price

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402


def module(net, **words):
    words = {"dtype": torch.float64, "outputs": ["1", "2", "3"]} | words
    return neuro_torch.Module(net, list(net.projections), **words)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("by", [None, "torch", "steps"])
def test_payloads_are_those_of_integers(seed, by):
    net, parts, wires = network(seed)
    found, expected = module(net, by=by)({"0": torch.zeros(1, STEPS, parts[0][1].shape[1])}), twin(parts, wires)
    for name, sent in found.spikes.items():
        own = expected[int(name)][1:]
        assert np.array_equal(sent[0, :, : own.shape[1]].detach().numpy(), own)
        assert int(found.counts[name].sum()) == np.count_nonzero(own)


def changes(vth):
    """Two layers of whole numbers, with delays: far from thresholds, so that a step of one weight passes none."""
    net = neuro.Network("changes", resolution=1.0)
    net.population("in", 2, neuro.graded_spike_train(spikes=[[1.0, 0, 9], [2.0, 1, -4], [4.0, 0, -7], [5.0, 1, 6]]))
    net.population("hidden", 3, neuro.sigma_delta(vth=vth, bias=90))
    net.population("code", 2, neuro.delta_encoder(vth=vth))
    net.population("out", 2, neuro.sigma_decoder())
    net.connect("in", "hidden", neuro.all_to_all(), weight=[40.0, -70.0, 20.0, 30.0, -80.0, 50.0], delay=1.0, name="up")
    net.connect("in", "code", neuro.all_to_all(), weight=[30.0, -20.0, 10.0, 60.0], delay=2.0, name="aside")
    net.connect(
        "hidden", "out", neuro.all_to_all(), weight=[20.0, -30.0, 50.0, 10.0, -40.0, 70.0], delay=1.0, name="down"
    )
    net.connect("code", "out", neuro.all_to_all(), weight=[1.0, -2.0, 3.0, 4.0], delay=1.0, name="on")
    return net


def no_slope(x, slope):
    return 0.0 * x


@pytest.mark.parametrize("by", [None, "steps"])
@pytest.mark.parametrize("vth", [0, 100])
def test_gradients_are_finite_differences(by, vth):
    net = changes(vth)
    learn = ["up", "aside", "down", "on"]
    own = neuro_torch.Module(net, learn, dtype=torch.float64, by=by, surrogate=no_slope)
    batch = {"in": torch.zeros(1, 9, 2, dtype=torch.float64)}
    share = torch.randn(9, 2, dtype=torch.float64, generator=torch.manual_seed(1))

    def value():
        return (own(batch).spikes["out"][0] * share).sum()

    value().backward()
    for name, weight in own.weights.items():
        for place in np.ndindex(*weight.shape):
            with torch.no_grad():
                ends = []
                for way in (1.0, -2.0):
                    weight[place] += way
                    ends.append(float(value()))
                weight[place] += 1.0
            assert float(weight.grad[place]) == pytest.approx((ends[0] - ends[1]) / 2), (name, place)


def test_a_change_that_is_not_sent_learns():
    net = neuro.Network("small", resolution=1.0)
    net.population("in", 1, neuro.graded_spike_train(spikes=[[1.0, 0, 3]]))
    net.population("hidden", 1, neuro.sigma_delta(vth=8))
    net.population("out", 1, neuro.sigma_decoder())
    net.connect("in", "hidden", neuro.all_to_all(), weight=2.0, delay=1.0, name="up")
    net.connect("hidden", "out", neuro.all_to_all(), weight=1.0, delay=1.0, name="down")
    own = neuro_torch.Module(net, ["up"], dtype=torch.float64)
    found = own({"in": torch.zeros(1, 4, 1)}).spikes["out"]
    assert not found.any()
    found.sum().backward()
    assert own.weights["up"].grad > 0.0


def test_the_bill_prices_messages():
    net = changes(100)
    own = neuro_torch.Module(net, ["up"], dtype=torch.float64)
    found = own({"in": torch.zeros(1, 9, 2)})
    taken = neuro_torch.Bill(own, "loihi2")(found)
    sim = neuro.compile(net, "loihi2")
    sim.run(9.0)
    ceiling = price(sim.program, sim.taken().raw_counts, None, chip("loihi2")).as_dict()["dynamic_high_j"]
    assert float(taken.detach()) == pytest.approx(ceiling)
    taken.backward()
    assert own.weights["up"].grad.any()  # what is near to the threshold of sending


def test_a_product_of_two_inputs():
    net = neuro.Network("gated", resolution=1.0)
    net.population("in", 2, neuro.graded_spike_train(spikes=[[1.0, 0, 3], [1.0, 1, -5], [3.0, 0, 4], [3.0, 1, 7]]))
    net.population("out", 1, neuro.graded_product(vth=20))
    for k, receptor in enumerate(("first", "second")):
        rule = neuro.pairs(pre=[k], post=[0])
        net.connect("in", "out", rule, neuro.static(receptor=receptor), weight=2.0, delay=1.0, name=receptor)
    own = neuro_torch.Module(net, ["first"], dtype=torch.float64, surrogate=no_slope)
    found = own({"in": torch.zeros(1, 5, 2)}).spikes["out"][0, :, 0]
    sim = neuro.compile(net, "event")
    sim.run(5.0)
    assert found.tolist() == [0.0, -60.0, 0.0, 112.0, 0.0] == [0.0, *np.insert(sim.payloads("out")[2], 1, 0), 0.0]
    found[3].backward()
    assert own.weights["first"].grad.tolist() == [4 * 14.0]
