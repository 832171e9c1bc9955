"""Kernels in 32 bits: the numbers of 64 bits within rounding, and nearly always the same spikes."""

import numpy as np
import pytest

import neuro

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402

MODELS = {"iaf_psc_delta": (neuro.iaf_psc_delta, 1.5), "iaf_psc_exp": (neuro.iaf_psc_exp, 300.0)}


def network(seed, model, recurrent):
    """Every way of the kernels: rows, listed synapses, kernels of a grid, a circle."""
    kind, unit = MODELS[model]
    rng, net = np.random.default_rng(seed), neuro.Network("random", resolution=1.0)
    cell = kind(tau_m=rng.uniform(5.0, 30.0, 16), t_ref=2.0, V_th=-62.0, V_reset=-72.0, I_e=20.0)
    net.population("a", (1, 6, 6), neuro.spike_generator())
    net.population("maps", (2, "auto", "auto"), kind(tau_m=10.0, t_ref=1.0, V_th=-62.0, V_reset=-72.0))
    net.population("hidden", 16, cell)
    net.population("out", 3, kind(tau_m=12.0, V_th=-62.0, V_reset=-72.0))
    grid = rng.normal(unit, 2.0 * unit, (2, 1, 3, 3))
    net.connect("a", "maps", neuro.grid(kernel=(3, 3), stride=1), weight=grid, delay=1.0, name="grid")
    some = neuro.normal(mean=0.5 * unit, std=unit)
    net.connect("maps", "hidden", neuro.pairwise_bernoulli(p=0.5), weight=some, delay=2.0, name="listed")
    net.connect("hidden", "out", neuro.all_to_all(), weight=some, delay=1.0, name="rows")
    if recurrent:
        net.connect("out", "hidden", neuro.all_to_all(), weight=some, delay=3.0, name="back")
    return net


def ran(net, events, dtype):
    module = neuro_torch.Module(net, list(net.projections), outputs=["hidden", "out"], dtype=dtype, slope=2.0)
    outcome = module(events)
    loss = sum((outcome.spikes[name].double() + outcome.V_m[name].double().sin()).sum() for name in module.outputs)
    loss.backward()
    return outcome, [each.grad.double().numpy() for each in module.weights.values()]


@pytest.mark.parametrize("recurrent", [False, True], ids=["layers", "recurrent"])
@pytest.mark.parametrize("model", MODELS)
def test_numbers_of_32_bits_are_those_of_64(model, recurrent):
    same = total = spikes = 0
    for seed in range(6):
        net, rng = network(seed, model, recurrent), np.random.default_rng(seed)
        events = neuro_torch.Events.of_dense({"a": rng.random((4, 25, 36)) < 0.2})
        (single, ours), (double, theirs) = (ran(net, events, dtype) for dtype in (torch.float32, torch.float64))
        equal = all(torch.equal(single.spikes[name].double(), double.spikes[name]) for name in ("hidden", "out"))
        spikes += float(double.spikes["hidden"].detach().sum())
        same, total = same + equal, total + 1
        if equal:
            for name in ("hidden", "out"):
                np.testing.assert_allclose(single.V_m[name].detach(), double.V_m[name].detach(), rtol=0, atol=1e-3)
            for a, b in zip(ours, theirs, strict=True):
                np.testing.assert_allclose(a, b, rtol=0, atol=1e-3 * np.abs(b).max())
    assert spikes > 200
    assert same >= total - 1
