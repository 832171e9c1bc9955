"""Weights on a chip's grid while they learn, and fewer of them."""

import numpy as np
import pytest

import neuro
from neuro.chips import chip, quantise
from refused import refusals_of, refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402


def network(weight=None):
    net = neuro.Network("small", resolution=1.0)
    cell = neuro.iaf_psc_delta(tau_m=20.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)
    rng = np.random.default_rng(3)
    net.population("pixels", 40, neuro.spike_generator(spike_times=[]))
    net.population("hidden", 12, cell)
    net.population("out", 3, cell)
    first = rng.normal(0.0, 0.3, (40, 12)) if weight is None else weight
    net.connect("pixels", "hidden", neuro.all_to_all(), weight=first, delay=1.0, name="in")
    net.connect("hidden", "out", neuro.all_to_all(), weight=np.abs(rng.normal(0.0, 0.4, (12, 3))), delay=2.0, name="up")
    return net


def module_of(net=None, **words):
    words = {"dtype": torch.float64} | words
    return neuro_torch.Module(net or network(), trainable=["in", "up"], slope=1.0, **words)


def batch(n=4, steps=15, seed=1):
    found = np.nonzero(np.random.default_rng(seed).random((n, steps, 40)) < 0.15)
    return neuro_torch.Events(n, steps, {"pixels": found})


def spikes_on(net, events, backend):
    """Spikes of the output of each recording, (batch, steps, neurons)."""
    sim = neuro.compile(net, backend=backend)
    found = np.zeros((events.batch, events.steps, 3))
    for b in range(events.batch):
        sim.reset()
        train = events.trains["pixels"].of([b])
        sim.inject("pixels", (train.step + 1.0) * net.resolution, train.neuron)
        sim.run(events.steps * net.resolution)
        times, ids = sim.spikes("out")
        np.add.at(found[b], (np.rint(times / net.resolution).astype(int) - 1, ids), 1.0)
    return found


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("bits", [1, 4, 8])
def test_what_was_rounded_loses_nothing_on_loihi(bits, dtype):
    module = neuro_torch.quantised(module_of(dtype=dtype), bits)
    net = module.network()
    for wires in quantise(neuro.compile(net).program, chip("loihi")).projections:
        assert wires.rounding.rms < 1e-12
        assert wires.rounding.saturated == 0.0
    for part in neuro.compile(net).program.projections:
        levels = np.unique(part.weight)
        assert len(levels) <= 2**bits
        assert len(levels) > min(2 ** (bits - 2), part.size // 4)


def several(seed, learn):
    """A hidden layer that pixels, itself and other inputs reach; a module of some of its projections."""
    rng, net = np.random.default_rng(seed), neuro.Network("several", resolution=1.0)
    cell = neuro.iaf_psc_delta(tau_m=float(rng.uniform(5.0, 30.0)), E_L=0.0, V_reset=0.0, V_th=1.0)
    net.population("pixels", 40, neuro.spike_generator())
    net.population("others", 20, neuro.spike_generator())
    net.population("hidden", 12, cell)
    for name, source in (("in", "pixels"), ("beside", "others"), ("round", "hidden")):
        weight = neuro.normal(mean=0.1, std=float(rng.uniform(0.05, 1.0)))
        net.connect(source, "hidden", neuro.all_to_all(), weight=weight, delay=1.0, name=name)
    return neuro_torch.Module(net, learn, seed=seed, dtype=[torch.float32, torch.float64][seed % 2])


def moved(module, target):
    """By how much the chip rounds learnt weights anew, the rms of a projection relative to that of its weights."""
    fixed = quantise(neuro.compile(module.network()).program, chip(target))
    return max(wires.rounding.rms for wires in fixed.projections if wires.name in module.weights)


@pytest.mark.parametrize("seed", range(6))
def test_on_loihi_nothing_moves_where_all_weights_onto_a_population_learn(seed):
    module = several(seed, ["in", "beside", "round"])
    assert moved(neuro_torch.quantised(module, 1 + seed % 8), "loihi") < 1e-12


def test_beside_weights_that_do_not_learn_little_moves_on_loihi():
    found = [moved(neuro_torch.quantised(several(seed, ["in"]), 2 + seed % 3), "loihi") for seed in range(8)]
    assert max(found) < 2e-3
    assert min(found) < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_on_spinnaker_the_words_are_those_of_the_training(seed):
    bits = 4 + seed % 5
    module = neuro_torch.quantised(several(seed, ["in", "round"]), bits)
    neuro_torch.quantised(module, bits, "spinnaker")
    grid = module.weights.parametrizations["in"][-1]
    weight = module.weights["in"].detach()
    levels = np.rint((weight / torch.where(weight < 0, grid.below, grid.step)).double().numpy()).ravel()
    fixed = quantise(neuro.compile(module.network()).program, chip("spinnaker"))
    words = next(wires.mantissas for wires in fixed.projections if wires.name == "in")
    assert np.any(levels)
    np.testing.assert_array_equal(np.sign(words), np.sign(levels))
    for sign in (1, -1):
        assert len(np.unique(words[levels * sign > 0] / levels[levels * sign > 0])) <= 1
    assert moved(module, "spinnaker") < (2.0**-15 if module.weights["in"].dtype == torch.float32 else 2.0**-43)


def test_eight_bits_are_what_the_chip_rounds_to_by_itself():
    net = network()
    fixed = quantise(neuro.compile(net).program, chip("loihi"))
    module = neuro_torch.quantised(module_of(net))
    for wires, weight in zip(fixed.projections, module.weights.values(), strict=True):
        on_chip = wires.weights(wires.mantissas)
        np.testing.assert_allclose(weight.detach().numpy().ravel(), on_chip, rtol=1e-12)


def test_the_gradient_goes_straight_through():
    plain, rounded = module_of(network(np.full((40, 12), 0.25))), module_of(network(np.full((40, 12), 0.25)))
    neuro_torch.quantised(rounded, 8)
    weights = rounded.weights.parametrizations["in"].original
    target = torch.from_numpy(np.random.default_rng(5).normal(size=(40, 12)))
    (rounded.weights["in"] * target).sum().backward()
    torch.testing.assert_close(weights.grad, target, rtol=0, atol=0)
    assert plain.weights["in"].shape == weights.shape


def test_quantising_again_takes_the_place_of_what_was():
    """Of weights on a grid of 2 bits a grid of 8 has few levels; so what is below the first rounding is still there."""
    again = neuro_torch.quantised(neuro_torch.quantised(module_of(), 2), 8)
    once = neuro_torch.quantised(module_of(), 8)
    for name, weight in once.weights.items():
        torch.testing.assert_close(again.weights[name], weight, rtol=0, atol=0)
    optimiser = torch.optim.SGD(again.parameters(), lr=0.1)
    neuro_torch.losses.count_cross_entropy(again(batch()).spikes["out"], torch.tensor([0, 1, 2, 0])).backward()
    optimiser.step()
    assert len(again.eval()(batch()) and again.weights["in"].unique()) > 50


@pytest.mark.parametrize(("bits", "target"), [(3, "loihi"), (4, "spinnaker")])
def test_a_quantised_module_stays_so_when_it_is_pruned(bits, target):
    module = neuro_torch.quantised(module_of(), bits, target)
    pruned = neuro_torch.prune(module, {"in": 0.75})
    optimiser = torch.optim.Adam(pruned.parameters(), lr=0.05)
    for _ in range(3):
        optimiser.zero_grad()
        pruned(batch()).spikes["out"].sum().backward()
        optimiser.step()
    pruned.eval()(batch())
    assert all(len(weight.unique()) <= 2**bits for weight in pruned.weights.values())
    for wires in quantise(neuro.compile(pruned.network()).program, chip(target)).projections:
        assert wires.rounding.rms < 1e-12


def test_a_bill_of_another_network_is_refused(messages):
    module = module_of()
    bill, pruned = neuro_torch.Bill(module), neuro_torch.prune(module, 0.5)
    outcome = pruned(batch())
    messages({"pruned": refused(bill, outcome)})
    assert float(neuro_torch.Bill(pruned)(outcome).detach()) > 0.0


def test_a_state_dict_brings_back_the_grid():
    module = neuro_torch.quantised(module_of(), 5)
    other = neuro_torch.quantised(module_of(network(np.full((40, 12), 0.1))), 5)
    other.load_state_dict(module.state_dict())
    torch.testing.assert_close(other.weights["in"], module.weights["in"], rtol=0, atol=0)


def test_mistakes(messages):
    messages(refusals_of(messages.cases, globals()))


def test_pruned_synapses_are_gone_and_the_rest_is_as_it_was():
    module = module_of()
    pruned = neuro_torch.prune(module, {"in": 0.75})
    before = module.weights["in"].detach().numpy()
    part = pruned.program.projections[0]
    assert (part.layout, part.size) == ("csr", 120)
    pre, post = pruned.program.connections(0)
    np.testing.assert_array_equal(before[pre, post], pruned.weights["in"].detach().numpy())
    assert np.abs(part.weight).min() >= np.sort(np.abs(before), axis=None)[-121]
    assert pruned.program.projections[1].layout == "dense"
    outcome = pruned(batch())
    bills = [float(neuro_torch.Bill(each).dynamic(each(batch())).detach()) for each in (module, pruned)]
    assert bills[1] < bills[0]
    assert module.program.projections[0].layout == "dense"
    np.testing.assert_array_equal(outcome.spikes["out"].detach(), spikes_on(pruned.network(), batch(), "event"))
