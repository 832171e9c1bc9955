"""Losses: closed forms, gradients by differences, and how little it takes to train by them."""

import itertools
import math

import numpy as np
import pytest

from refused import refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
from neuro_torch import losses  # noqa: E402


def drawn(seed, batch=3, steps=7, neurons=4, rate=0.3):
    return torch.from_numpy((np.random.default_rng(seed).random((batch, steps, neurons)) < rate).astype(np.float64))


def by_steps(spikes):
    """The definition of the time of a first spike, as a polynomial."""
    return torch.cumprod(1.0 - spikes, dim=1).sum(dim=1)


@pytest.mark.parametrize("rate", [0.0, 0.1, 0.3, 0.9, 1.0])
def test_first_spike_is_the_polynomial_and_its_derivative(rate):
    spikes = drawn(1, rate=rate).requires_grad_()
    weights = torch.randn(3, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    (ours,) = torch.autograd.grad((losses.first_spike_steps(spikes) * weights).sum(), spikes)
    (theirs,) = torch.autograd.grad((by_steps(spikes) * weights).sum(), spikes)
    torch.testing.assert_close(losses.first_spike_steps(spikes), by_steps(spikes), rtol=0, atol=0)
    torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-13)


def test_the_gradient_of_a_time_is_what_one_spike_more_or_less_does():
    spikes = drawn(3)
    asked = spikes.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(losses.first_spike_steps(asked).sum(), asked)
    for place in itertools.product(*map(range, spikes.shape)):
        turned = spikes.detach().clone()
        turned[place] = 1.0 - turned[place]
        sign = 1.0 if spikes[place] == 0.0 else -1.0
        change = losses.first_spike_steps(turned).sum() - losses.first_spike_steps(spikes).sum()
        assert float(sign * change) == float(gradient[place])


def test_a_silent_neuron_learns_from_the_time_of_its_first_spike():
    spikes = torch.zeros(1, 5, 2, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(losses.first_spike(spikes, torch.tensor([1])), spikes)
    assert torch.all(gradient[0, :, 1] < 0.0)
    assert torch.all(gradient[0, :, 0] > 0.0)
    assert torch.all(gradient[0, 1:, 1] > gradient[0, :-1, 1])  # an early spike is worth more


@pytest.mark.parametrize(
    "loss",
    [
        losses.count_cross_entropy,
        lambda v, y: losses.count_cross_entropy(v, y, scale=0.3),
        losses.potential_cross_entropy,
        lambda v, y: losses.potential_cross_entropy(v, y, over="max"),
        lambda v, y: losses.potential_cross_entropy(v, y, over="last", scale=2.0),
        lambda v, y: losses.potential_mse(v, torch.where(v.detach() > 0.0, 0.4, torch.nan)),
        lambda v, y: losses.van_rossum(v, torch.full_like(v, 0.4), tau=3.0),
    ],
)
def test_gradients_by_differences(loss):
    values = torch.randn(3, 6, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(5)).requires_grad_()
    labels = torch.tensor([0, 3, 1])
    assert torch.autograd.gradcheck(lambda v: loss(v, labels), values, eps=1e-6, atol=1e-8)


def test_count_cross_entropy_in_closed_form():
    spikes = torch.zeros(1, 4, 3, dtype=torch.float64)
    spikes[0, :3, 1] = 1.0
    spikes[0, 0, 2] = 1.0
    expected = -math.log(math.exp(3.0) / (math.exp(3.0) + math.exp(1.0) + 1.0))
    assert float(losses.count_cross_entropy(spikes, torch.tensor([1]))) == pytest.approx(expected, rel=1e-14)


def test_first_spike_in_closed_form():
    spikes = torch.zeros(1, 10, 2, dtype=torch.float64)
    spikes[0, 2, 0] = spikes[0, 6, 1] = 1.0
    loss = losses.first_spike(spikes, torch.tensor([0]), tau=8.0, resolution=5.0)
    assert float(loss) == pytest.approx(math.log1p(math.exp(-(6 - 2) * 5.0 / 8.0)), rel=1e-14)


def test_potential_mse_where_something_is_asked():
    wanted = torch.tensor([[[1.0, torch.nan], [4.0, 0.0]]])
    assert float(losses.potential_mse(torch.ones(1, 2, 2), wanted)) == pytest.approx((0.0 + 9.0 + 1.0) / 3.0)


def test_van_rossum_in_closed_form():
    one, other = (torch.zeros(1, 40, 1, dtype=torch.float64) for _ in range(2))
    one[0, 5] = 1.0
    assert float(losses.van_rossum(one, other)) == pytest.approx(0.5, rel=1e-14)
    other[0, 12] = 1.0
    expected = 1.0 - math.exp(-7 * 0.5 / 3.0)
    assert float(losses.van_rossum(one, other, tau=3.0, resolution=0.5)) == pytest.approx(expected, rel=1e-13)


def test_decisions():
    spikes = torch.zeros(4, 5, 3)
    spikes[0, :3, 2] = spikes[0, 0, 1] = 1.0  # most
    spikes[1, 4, 0] = spikes[1, 1, 2] = 1.0  # equal: the first
    spikes[2, 1, 1] = spikes[2, 1, 2] = 1.0  # equal and at once: the lower number
    assert losses.decisions(spikes).tolist() == [2, 2, 1, -1]


zeros, tensor = torch.zeros, torch.tensor


def test_mistakes(messages):
    count, first, mse = losses.count_cross_entropy, losses.first_spike, losses.potential_mse
    one, many, label = zeros(1, 3, 4), zeros(2, 3, 4), tensor([1])
    wrong = [(count, zeros(2, 3), zeros(2)), (first, many, zeros(3)), (count, many, tensor([1, 4]))]
    wrong += [(first, many, tensor([1, -1])), (losses.van_rossum, one, zeros(1, 3, 5)), (mse, many, zeros(2, 4))]
    wrong.append((mse, one, torch.full((1, 3, 4), torch.nan)))
    told = {str(k): refused(*call) for k, call in enumerate(wrong)}
    told["tau"] = refused(first, one, label, tau=0.0)
    messages(told | {"over": refused(losses.potential_cross_entropy, one, label, over="men")})
