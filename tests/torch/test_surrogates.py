"""Surrogates: the shape that is told, the same in tensors and in kernels."""

import numpy as np
import pytest

from neuro import ModelError
from neuro.kernels.jit import inner, kernel
from neuro_torch.surrogates import SURROGATES, ArcTan, FastSigmoid, Slayer, Triangle, derivative_at, surrogate_of

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
X = np.linspace(-3.0, 3.0, 241)


@pytest.mark.parametrize("kind", SURROGATES.values(), ids=SURROGATES)
@pytest.mark.parametrize("slope", [None, 0.7, 40.0])
def test_tensors_and_kernels_agree(kind, slope):
    surrogate = surrogate_of(kind.name, slope)
    at = inner(derivative_at)

    @kernel
    def every(code, slope, x, out):
        for i in range(x.size):
            out[i] = at(code, slope, x[i])

    found = np.empty_like(X)
    every(surrogate.code, surrogate.slope, X, found)
    np.testing.assert_allclose(surrogate.derivative(torch.from_numpy(X)).numpy(), found, rtol=1e-14, atol=1e-300)
    assert found == pytest.approx([derivative_at(surrogate.code, surrogate.slope, x) for x in X], rel=1e-14)


@pytest.mark.parametrize("kind", SURROGATES.values(), ids=SURROGATES)
def test_one_at_the_threshold_and_less_on_both_sides(kind):
    at = kind().derivative(torch.from_numpy(X)).numpy()
    assert at[X.size // 2] == 1.0
    np.testing.assert_allclose(at, at[::-1], rtol=1e-12, atol=1e-15)
    assert np.all(np.diff(at[: X.size // 2 + 1]) >= 0.0)


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


@pytest.mark.parametrize(
    ("told", "slope", "message"),
    [
        ("fast_sigmod", None, "unknown surrogate 'fast_sigmod'"),
        ("triangle", 0, "surrogate 'triangle': slope = 0: expected a number > 0"),
        ("arctan", float("nan"), "surrogate 'arctan': slope = nan: expected a number > 0"),
        (FastSigmoid(3.0), 2.0, "slope = 2.0: the surrogate has one already, 3"),
    ],
)
def test_mistakes(told, slope, message):
    with pytest.raises(ModelError) as caught:
        surrogate_of(told, slope)
    assert str(caught.value).startswith(message)
