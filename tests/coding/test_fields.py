"""Encoders of vectors: which neurons spike, how often and when, and what they refuse."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro import coding
from neuro.coding import FIELDS, Dimension, OneHot, Places, Population, Tiles
from refused import refusals_of

UNIT = [Dimension(low=0.0, high=1.0)] * 3
MIXED = [Dimension(low=-1.0, high=1.0), Dimension(), Dimension(states=4, first=2)]


def made(kind, dimensions=MIXED):
    """A small one."""
    return kind([one for one in dimensions if one.states]) if kind is OneHot else kind(dimensions, 2, 5)


@pytest.mark.parametrize("kind", FIELDS.values())
@given(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4), st.integers(2, 5), st.integers(2, 40), st.booleans())
def test_spikes_are_in_order_and_of_active_neurons(kind, numbers, state, ticks, drawn):
    encoder = made(kind)
    vectors = np.array([[*numbers[:2], state], [*numbers[2:], state]])[:, -len(encoder.dimensions) :]
    offsets, when, ids = encoder.spikes(vectors, ticks, np.random.default_rng(1) if drawn else None)
    assert offsets[0] == 0
    assert offsets[-1] == len(when) == len(ids)
    for k, vector in enumerate(vectors):
        mine = slice(offsets[k], offsets[k + 1])
        order = list(zip(when[mine], ids[mine], strict=True))
        assert order == sorted(set(order))
        assert not order or 1 <= order[0][0] <= order[-1][0] < ticks
        neurons, activity = encoder.activity(vector)
        assert set(ids[mine]) <= set(neurons) <= set(range(encoder.size))
        assert len(encoder.cells(vector)) == encoder.active
        assert set(encoder.cells(vector)) <= set(neurons)
        assert (activity > 0.0).all()
        assert (activity <= 1.0).all()


@pytest.mark.parametrize("kind", [Places, Population])
def test_a_neuron_spikes_in_proportion_to_its_activity(kind):
    encoder, ticks, rng = kind(UNIT, 1, 6), 2001, np.random.default_rng(1)
    vector = np.array([0.1, 0.55, 0.8])
    neurons, activity = encoder.activity(vector)
    regular, drawn = (
        np.bincount(encoder.spikes(vector[None], ticks, how)[2], minlength=encoder.size)[neurons] for how in (None, rng)
    )
    expected = activity * (ticks - 1) / coding.PERIOD
    assert np.abs(regular - expected).max() <= 1.0
    assert np.abs(drawn - expected).max() <= 5.0 * np.sqrt(expected.max())


@given(st.floats(-1.0, 2.0), st.integers(3, 12))
def test_bells_are_those_of_the_population_code(x, n):
    neurons, activity = Population(UNIT[:1], fields=n).activity(np.array([x]))
    known = coding.population(np.clip(x, 0.0, 1.0), n, 0.0, 1.0, 1.0)
    assert neurons.tolist() == np.flatnonzero(known >= 0.01).tolist()
    np.testing.assert_allclose(activity, known[neurons], rtol=1e-9)


def test_known_fields():
    pair, vector = Population(UNIT[:2], group=2, fields=5), np.array([0.3, 0.9])
    x, y = (coding.population(value, 5, 0.0, 1.0, 1.0) for value in vector)
    product = np.outer(y, x).ravel()
    neurons, activity = pair.activity(vector)
    assert neurons.tolist() == np.flatnonzero(product >= 0.01).tolist()
    np.testing.assert_allclose(activity, product[neurons], rtol=1e-9)
    assert pair.cells(vector).tolist() == [product.argmax()]
    near, far = np.array([0.2, 0.2]), np.array([0.2 + 1e-3, 0.2 + 1e-3])
    tiles, places = Tiles(UNIT[:2], fields=5, active=5), Places(UNIT[:2], fields=5, active=5)
    assert (tiles.size, tiles.active) == (places.size, places.active) == (5 * 36, 5)
    assert len(set(tiles.cells(near - 1e-3)) - set(tiles.cells(far))) == 1
    there = near + 0.2 / 5
    assert len(set(tiles.cells(there - 1e-3)) - set(tiles.cells(there + 1e-3))) == 1
    steps = [
        len(set(places.cells(np.full(2, x))) - set(places.cells(np.full(2, x + 0.04)))) for x in (0.21, 0.25, 0.29)
    ]
    assert max(steps) > 1
    assert Tiles(UNIT, active=2).size == 2 * 7**3
    encoder = OneHot([Dimension(states=4, first=2), Dimension(low=-1.0, high=1.0, whole=True)])
    assert (encoder.size, encoder.active, encoder.cells(np.array([2.0, -1.0])).tolist()) == (7, 2, [0, 4])
    assert encoder.cells(np.array([5.0, 1.0])).tolist() == [3, 6]
    encoder = Places([Dimension()], 1, 8, 1)
    encoder.learn(np.random.default_rng(1).normal(100.0, 3.0, (1000, 1)))
    assert [encoder.cells(np.array([x]))[0] for x in (0.0, 100.5, 1e6)] == [0, 4, 7]


def test_refusals(messages):
    messages(refusals_of(messages.cases, globals()))
