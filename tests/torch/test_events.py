"""Sparse batches: what they hold, how they are joined and chosen, what is refused."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as arrays

import neuro
from refused import refusals_of

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402
from neuro_torch import Events  # noqa: E402

DENSE = arrays.arrays(np.bool_, st.tuples(st.integers(1, 4), st.integers(1, 6), st.integers(1, 5)))


@given(dense=DENSE)
def test_dense_and_back(dense):
    events = Events.of_dense({"a": dense})
    assert (len(events), events.steps) == dense.shape[:2]
    np.testing.assert_array_equal(events.dense("a", dense.shape[2]), dense)
    np.testing.assert_array_equal(events.counts("a", dense.shape[2]), dense.sum(1))
    again = Events.join([events[b] for b in range(len(events))])
    np.testing.assert_array_equal(again.dense("a", dense.shape[2]), dense)
    np.testing.assert_array_equal(events[::-1].dense("a", dense.shape[2]), dense[::-1])


@given(dense=DENSE, seed=st.integers(0, 99))
def test_any_order_and_doubled_spikes_are_the_same_batch(dense, seed):
    batch, steps, neurons = dense.shape
    found = np.array(dense.nonzero())
    doubled = np.concatenate((found, found[:, ::2]), axis=1)
    mixed = doubled[:, np.random.default_rng(seed).permutation(doubled.shape[1])]
    events = Events(batch, steps, {"a": tuple(mixed)})
    np.testing.assert_array_equal(events.dense("a", neurons), dense)
    assert len(events.trains["a"].step) == found.shape[1]


def test_rows_end_where_steps_do():
    events = Events(2, 3, {"a": ([0, 0, 1, 1], [0, 2, 1, 1], [4, 1, 0, 3])})
    assert events.trains["a"].rows(3).tolist() == [0, 1, 1, 2, 2, 4, 4]


def test_recordings_of_a_camera():
    recording = neuro.events.Events(
        t=[100, 900, 1100, 5100, 9200], x=[0, 0, 3, 1, 2], y=[0, 0, 1, 2, 0], p=[0, 0, 1, 1, 0], sensor_size=(4, 3)
    )
    events = Events.of_recordings([recording, recording], "pixels", shape=(2, 3, 4), step=1.0, duration=6.0)
    assert (len(events), events.steps) == (2, 6)
    where = np.argwhere(events.dense("pixels", 24)[0]).tolist()
    assert where == [[0, 0], [1, 12 + 4 + 3], [5, 12 + 8 + 1]]
    merged = Events.of_recordings([recording], "pixels", shape=(2, 2), step=0.5, duration=12.0, scale=2, start=1.0)
    assert np.argwhere(merged.dense("pixels", 4)[0]).tolist() == [[0, 1], [8, 2], [16, 1]]
    played = neuro.Network("played", resolution=1.0)
    played.population("pixels", "auto", neuro.event_camera(events=recording))
    played.probe("seen", "pixels")
    sim = neuro.compile(played)
    sim.run(6.0)
    times, ids = sim.spikes("pixels")
    assert sorted({(int(t) - 1, int(i)) for t, i in zip(times, ids, strict=True)}) == [tuple(w) for w in where]


def test_a_data_loader():
    data = [(Events(1, 5, {"a": ([0, 0], [k % 5, 1], [k, 0])}), k) for k in range(7)]
    loader = torch.utils.data.DataLoader(data, batch_size=3, collate_fn=neuro_torch.collate)
    sizes = []
    for events, labels in loader:
        sizes.append(len(events))
        for b, label in enumerate(labels.tolist()):
            assert events.dense("a", 7)[b, label % 5, label] == 1
    assert sizes == [3, 3, 1]
    assert len(neuro_torch.collate([each for each, _ in data])) == 7


def test_refusals(messages):
    messages(refusals_of(messages.cases, globals()))
