import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.compare import differences
from neuro.compare.differences import ComparedSpikes, Divergence, distance, divergence, evenly, same_steps

LIBRARY = "the extra 'compare' is not installed"


def train(pairs, size=4, h=0.5):
    steps, ids = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2).T
    return ComparedSpikes(size, steps * h, steps, ids)


def test_divergence_by_hand():
    first = train([(2, 0), (4, 1), (9, 2)])
    assert divergence(first, train([(2, 0), (4, 1), (9, 2)])) is None
    assert divergence(first, train([(2, 0), (5, 1), (9, 2)])) == Divergence(2.0, 1, True)
    assert divergence(first, train([(2, 0), (4, 0), (4, 1), (9, 2)])) == Divergence(2.0, 0, False)
    assert divergence(first, train([(2, 0), (4, 1)])) == Divergence(4.5, 2, True)
    assert divergence(first, train([(2, 0), (4, 1), (9, 2), (9, 3)])) == Divergence(4.5, 3, False)
    assert divergence(train([]), train([])) is None
    assert divergence(train([]), train([(1, 3)])) == Divergence(0.5, 3, False)
    twice, once = train([(2, 0), (2, 0), (3, 1)]), train([(2, 0), (3, 1)])
    assert divergence(twice, once) == Divergence(1.0, 0, True)
    assert same_steps(twice, once)
    assert not same_steps(twice, train([(2, 0), (3, 2)]))


spike_sets = st.sets(st.tuples(st.integers(1, 60), st.integers(0, 3)), max_size=40)


@settings(max_examples=60)
@given(spike_sets, spike_sets)
def test_divergence_is_none_exactly_where_all_is_equal(a, b):
    found = divergence(train(a), train(b))
    assert (found is None) == (a == b)
    if found is not None:
        step, neuron = min(a ^ b)
        assert found == Divergence(step * 0.5, neuron, (step, neuron) in a)


@pytest.fixture(scope="module")
def library():
    pytest.importorskip("elephant", reason=LIBRARY)


# COST_MS = 10: a spike moved by 4 ms costs 0.4, one removed 1, one moved by 25 ms is removed and added: 2
BY_HAND = {
    "equal": ([(10, 0)], [(10, 0)], 0.0, 2),
    "moved": ([(10, 0)], [(18, 0)], 0.4, 2),
    "removed": ([(10, 0), (40, 0)], [(10, 0)], 1.0, 3),
    "too far": ([(10, 0)], [(60, 0)], 2.0, 2),
    "another neuron's": ([(10, 0)], [(10, 1)], 2.0, 2),
    "two neurons": ([(10, 0), (10, 1)], [(12, 0), (14, 1)], 0.3, 4),
}


@pytest.mark.parametrize("what", BY_HAND)
def test_distance_by_hand(library, what):
    a, b, edits, count = BY_HAND[what]
    found = distance(train(a), train(b), 100.0)
    assert (found.edits, found.spikes) == (pytest.approx(edits, abs=1e-12), count)
    assert (found.per_spike, found.neurons, found.until_ms) == (pytest.approx(edits / count), 4, 100.0)


@settings(max_examples=25)
@given(spike_sets, spike_sets)
def test_distance_is_symmetric_and_0_only_where_equal(library, a, b):
    there, back = distance(train(a), train(b), 40.0), distance(train(b), train(a), 40.0)
    assert (there.edits, there.edits == 0.0) == (pytest.approx(back.edits, abs=1e-9), a == b)
    assert 0.0 <= there.per_spike <= 1.0 + 1e-12


def test_distances_of_silence_many_neurons_and_long_trains(library, monkeypatch):
    found = distance(train([]), train([]), 10.0)
    assert (found.edits, found.per_spike, found.spikes) == (0.0, 0.0, 0)
    both = [train([(5, i) for i in range(1000)], 1000), train([(6, i) for i in range(1000)], 1000)]
    found = distance(*both, 10.0)
    assert (found.neurons, found.edits) == (differences.MOST_NEURONS, pytest.approx(0.05 * differences.MOST_NEURONS))
    assert (evenly(5, 100).tolist(), evenly(101, 3).tolist()) == ([0, 1, 2, 3, 4], [0, 50, 100])
    monkeypatch.setattr(differences, "MOST_SPIKES", 10)
    a, b = train([(2 * k, 0) for k in range(1, 31)], 1), train([(2 * k, 0) for k in range(1, 9)], 1)
    found = distance(a, b, 40.0)
    assert found.until_ms == 11.0  # of the 11th spike
    assert (found.spikes, found.edits) == (18, 2.0)
    monkeypatch.setattr(differences, "_library", lambda: None)
    assert distance(train([(1, 0)]), train([]), 10.0) is None
