"""Losses: closed forms, gradients by differences, and how little it takes to train by them."""

import math
import pickle
import re

import numpy as np
import pytest

import neuro
from neuro.kernels.jit import compiled, kernel
from neuro_torch.surrogates import SURROGATES, ArcTan, FastSigmoid, Own, Slayer, Surrogate, Triangle, surrogate_of
from refused import refusals_of, refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")


import neuro_torch  # noqa: E402
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
    one, many = zeros(1, 3, 4), zeros(2, 3, 4)
    messages(refusals_of(messages.cases, globals() | locals()))


X = np.linspace(-3.0, 3.0, 241)


def gauss(x, slope):
    return math.exp(-((slope * x) ** 2))


def flat(x, slope):
    """Of two parts, one of them a number alone."""
    if abs(x) > 1.0 / slope:
        return 0.0
    return 1.0


def scaled(x, slope):
    return max(0.1, gauss(x, slope) - slope)


@pytest.mark.parametrize("told", [*SURROGATES, gauss, flat, scaled], ids=[*SURROGATES, "gauss", "flat", "scaled"])
@pytest.mark.parametrize("slope", [None, 0.7, 40.0])
def test_tensors_and_kernels_agree(told, slope):
    surrogate = surrogate_of(told, slope)
    at = compiled(surrogate.at)

    @kernel
    def every(slope, x, out):
        for i in range(x.size):
            out[i] = at(x[i], slope)

    found = np.empty_like(X)
    every(surrogate.slope, X, found)
    np.testing.assert_allclose(surrogate.derivative(torch.from_numpy(X)).numpy(), found, rtol=1e-14, atol=1e-300)
    assert found == pytest.approx([surrogate.at(x, surrogate.slope) for x in X], rel=1e-14)


@pytest.mark.parametrize("told", [*SURROGATES, gauss, flat], ids=[*SURROGATES, "gauss", "flat"])
def test_all_ways_learn_by_it(told):
    net, rng = neuro.Network("small", resolution=1.0), np.random.default_rng(1)
    net.population("a", 6, neuro.spike_generator())
    net.population("hidden", 5, neuro.iaf_psc_delta(V_th=-62.0))
    net.population("out", 2, neuro.iaf_psc_delta(V_th=-62.0))
    net.connect("a", "hidden", neuro.all_to_all(), weight=rng.normal(2.0, 2.0, 30))
    net.connect("hidden", "out", neuro.all_to_all(), weight=rng.normal(2.0, 2.0, 10))
    given = {"a": torch.from_numpy((rng.random((3, 20, 6)) < 0.4).astype(np.float64))}
    found = []
    for by in ("kernels", "torch", "steps"):
        module = neuro_torch.Module(net, "a_hidden", surrogate=told, slope=1.5, dtype=torch.float64, by=by)
        module(given).spikes["out"].sum().backward()
        found.append(module.weights["a_hidden"].grad)
    assert found[0].abs().sum() > 0
    for each in found[1:]:
        torch.testing.assert_close(each, found[0], rtol=1e-12, atol=1e-13)
    copy = pickle.loads(pickle.dumps(module))
    assert copy.surrogate == module.surrogate


def test_a_function_of_ones_own_keeps_types():
    for kind in (torch.float32, torch.bfloat16):
        assert surrogate_of(flat).derivative(torch.zeros(2, 3, dtype=kind)).dtype is kind
    assert repr(Own(gauss, slope=2.0)) == "Own(gauss, slope=2)"


@pytest.mark.parametrize(
    ("surrogate", "integral"),
    [
        (FastSigmoid(5.0), lambda x: x / (1.0 + 5.0 * np.abs(x))),
        (ArcTan(2.0), lambda x: np.arctan(0.5 * np.pi * 2.0 * x) / (0.5 * np.pi * 2.0)),
        (Slayer(3.0), lambda x: np.sign(x) * (1.0 - np.exp(-3.0 * np.abs(x))) / 3.0),
        (Triangle(0.3), lambda x: x - 0.15 * x * np.abs(x)),
    ],
    ids=lambda part: getattr(part, "name", ""),
)
def test_it_is_the_derivative_of_what_it_is_named_after(surrogate, integral):
    h = 1e-6
    difference = (integral(X + h) - integral(X - h)) / (2.0 * h)
    smooth = np.abs(X) > h
    np.testing.assert_allclose(surrogate.derivative(torch.from_numpy(X)).numpy()[smooth], difference[smooth], atol=1e-8)


class Bare(Surrogate):
    name = "bare"

    def derivative(self, x):
        return torch.exp(-x.square())


def around():
    k = 2.0

    def inside(x, slope):
        return math.exp(-k * abs(x))

    return inside


def of_one(x):
    return x


def of_tensors(x, slope):
    return torch.exp(-x.square())


def of_words(x, slope):
    return {"near": x, "far": slope}["near"]


def nowhere():
    made = {}
    exec("def made(x, slope): return x", made)
    return made["made"]


def divided(x, slope):
    return math.inf if x == 0.0 else slope


def test_surrogates_that_cannot_be(messages):
    wrong = [("fast_sigmod", None), ("triangle", 0), ("arctan", math.nan), (FastSigmoid(3.0), 2.0), (gauss, -1.0)]
    wrong += [(each, None) for each in (Bare(2.0), FastSigmoid, lambda x, slope: x, around(), of_one)]
    wrong += [(each, None) for each in (of_tensors, of_words, nowhere(), divided)]
    told = {str(k): refused(surrogate_of, *words) for k, words in enumerate(wrong)}
    messages({case: re.sub("line [0-9]+", "line N", text.replace(__name__, "here")) for case, text in told.items()})
