"""Time constants that learn have gradients where two of them are equal, too."""

import pytest

import neuro
from neuro.compiler import compile_network

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from neuro_torch.stepping import Stepper  # noqa: E402
from neuro_torch.surrogates import FastSigmoid  # noqa: E402


@pytest.mark.parametrize("model", ["iaf_psc_exp", "iaf_psc_alpha"])
@pytest.mark.parametrize("tau", [0.001, 0.4, 10.0])
def test_equal_time_constants_have_gradients(model, tau):
    net = neuro.Network("equal", resolution=1.0)
    net.population("a", 1, neuro.spike_generator(spike_times=[2.0]))
    cell = getattr(neuro, model)(tau_m=20.0, tau_syn_ex=20.0, tau_syn_in=3.0, V_th=1000.0)
    net.population("b", 1, cell)
    net.connect("a", "b", neuro.all_to_all(), weight=300.0, delay=1.0)
    stepper = Stepper(compile_network(net, 0), surrogate=FastSigmoid())

    def mean(tau_m, tau_syn):
        stepper.begin(parameters={"b": {"tau_m": tau_m, "tau_syn_ex": tau_syn}})
        found = []
        for _ in range(20):
            stepper.step()
            found.append(stepper.state("b", "V_m").mean())
        return torch.stack(found).mean()

    both = [torch.full((1,), tau, dtype=torch.float64, requires_grad=True) for _ in range(2)]
    mean(*both).backward()
    assert all(bool(torch.isfinite(each.grad).all()) for each in both)
    e = 1e-5 * tau
    up, down = (torch.full((1,), tau + way, dtype=torch.float64) for way in (e, -e))
    along = (mean(up, up) - mean(down, down)) / (2 * e)
    assert sum(each.grad.item() for each in both) == pytest.approx(along.item(), rel=1e-5, abs=1e-12)
