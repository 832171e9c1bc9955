"""Surrogates: the shape that is told, the same in tensors and in kernels."""

import math
import pickle
import re

import numpy as np
import pytest

import neuro
from neuro.kernels.jit import compiled, kernel
from neuro_torch.surrogates import SURROGATES, ArcTan, FastSigmoid, Own, Slayer, Surrogate, Triangle, surrogate_of
from refused import refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402

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


def test_mistakes(messages):
    wrong = [("fast_sigmod", None), ("triangle", 0), ("arctan", math.nan), (FastSigmoid(3.0), 2.0), (gauss, -1.0)]
    wrong += [(each, None) for each in (Bare(2.0), FastSigmoid, lambda x, slope: x, around(), of_one)]
    wrong += [(each, None) for each in (of_tensors, of_words, nowhere(), divided)]
    told = {str(k): refused(surrogate_of, *words) for k, words in enumerate(wrong)}
    messages({case: re.sub("line [0-9]+", "line N", text.replace(__name__, "here")) for case, text in told.items()})
