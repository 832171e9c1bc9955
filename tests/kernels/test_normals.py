"""Normal numbers of the compiled pass: those of NumPy, bit for bit."""

import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

import neuro
from neuro.core.keyed_random import generator
from neuro.kernels.normals import PIECE, Normals
from neuro.model import distributions

BOUNDS = [(-np.inf, np.inf), (0.05, np.inf), (-np.inf, -1.0), (-0.2, 0.3)]


def by_piece(value: Any, seed: int, n: int) -> NDArray[np.float64]:
    pieces = [piece.copy() for piece in value.pieces(generator(seed, "weight", "x"), n)]
    assert len(pieces) == -(-n // PIECE)
    return np.concatenate(pieces)


def test_a_million_numbers_with_their_tails():
    """The rare ways of the method are taken often: beyond 3.65 standard deviations some 260 times."""
    values, normals = np.empty(PIECE), Normals(generator(5, "weight", "x"))
    told = []
    for _ in range(16):
        assert normals.fill(values, 0.0, 1.0, -np.inf, np.inf)
        told.append(values.copy())
    expected = generator(5, "weight", "x").normal(0.0, 1.0, 16 * PIECE)
    assert np.count_nonzero(np.abs(expected) > 3.654) > 200
    assert np.array_equal(np.concatenate(told).view(np.int64), (expected + 0.0).view(np.int64))


@given(
    seed=st.integers(0, 2**63 - 1),
    n=st.sampled_from([1, 1023, PIECE - 1, PIECE, PIECE + 1, 2 * PIECE + 4097]),
    mean=st.sampled_from([0.0, 1.5, -0.75]),
    std=st.sampled_from([0.0, 1e-3, 0.75, 2.0]),
    bounds=st.sampled_from(BOUNDS),
)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_what_is_drawn_is_the_same_either_way(seed: int, n: int, mean: float, std: float, bounds: tuple[float, float]):
    low, high = bounds
    if not low - 3.0 * std < mean < high + 3.0 * std or (std == 0.0 and not low <= mean <= high):
        return
    value = neuro.normal(mean=mean, std=std, low=low, high=high)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distributions, "_MANY", 1)
        found = by_piece(value, seed, n)
    expected = value.checked_sample(generator(seed, "weight", "x"), n)
    assert np.array_equal(found.view(np.int64), expected.view(np.int64))


def test_without_the_tables_numpy_draws_the_same(monkeypatch: pytest.MonkeyPatch):
    value = neuro.normal(mean=1.0, std=0.5, low=0.2)
    expected = by_piece(value, 3, distributions._MANY + 5)
    monkeypatch.setitem(sys.modules, "numba.np.random._constants", None)
    monkeypatch.delitem(sys.modules, "neuro.kernels.normals")
    found = np.concatenate(list(value.pieces(generator(3, "weight", "x"), distributions._MANY + 5)))
    assert "neuro.kernels.normals" not in sys.modules
    assert np.array_equal(found.view(np.int64), expected.view(np.int64))


def test_few_are_drawn_at_once():
    value = neuro.normal(mean=1.0, std=0.5)
    (piece,) = value.pieces(generator(1, "weight", "x"), 200_000)
    assert np.array_equal(piece, value.checked_sample(generator(1, "weight", "x"), 200_000))


def test_bounds_that_hardly_any_value_keeps_are_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(distributions, "_MANY", 1)
    value = neuro.normal(mean=0.0, std=1.0, low=30.0)
    with pytest.raises(
        neuro.ModelError, match="fewer than 1 in 1000 values is between low and high: expected wider bounds"
    ):
        by_piece(value, 1, 100)


def test_numbers_too_large_are_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(distributions, "_MANY", 1)
    with pytest.raises(neuro.ModelError, match="expected finite numbers"):
        list(neuro.normal(mean=1.7e308, std=1.7e308).pieces(generator(1, "weight", "x"), 100))


def test_a_subclass_draws_what_it_says(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(distributions, "_MANY", 1)

    class shifted(distributions.normal):
        def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
            return np.full(n, 7.0)

    monkeypatch.setattr(distributions.DISTRIBUTIONS, "check", lambda part: None)
    (piece,) = shifted(mean=1.0).pieces(generator(1, "weight", "x"), 100)
    assert np.array_equal(piece, np.full(100, 7.0))
