"""HOTS: kernels beside a plain reading of the paper, training that goes on, distances with known values."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.events import Events
from neuro_recognise.method import Course
from neuro_recognise.methods.hots import Hierarchy, Layers
from neuro_recognise.parts.readouts import DISTANCES, Nearest, bhattacharyya, normalised, standard
from refused import refusals_of

SIZE = (9, 7)
SMALL = Hierarchy(layers=2, radius=1, tau=3.0, centres=3, tau_factor=4.0, first="drawn")


def drawn(seed, n=150, size=SIZE):
    """Random events; now and then there is a gap of many time constants."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(0, 2000, n) + 300_000 * (rng.random(n) < 0.02)
    x, y = (rng.integers(0, side, n) for side in size)
    return Events(np.cumsum(steps) + 10**12, x, y, rng.integers(0, 2, n), size)


class Plain:
    """Time surfaces and algorithm 13 of the thesis as they stand there, one event after the other."""

    def __init__(self, s, size):
        self.s, self.size, self.centres, self.wins = s, size, [], []

    def surfaces(self, events, channel, layer):
        """The time surface of each event, (row, column, channel)."""
        r, tau, (width, height) = self.s.radius_of(layer), self.s.tau_of(layer), self.size
        last = np.full((height + 2 * r, width + 2 * r, self.s.channels_of(layer)), -np.inf)
        for t, x, y, p in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), channel, strict=True):
            last[y + r, x + r, p] = t
            yield np.exp(-(t - last[y : y + 2 * r + 1, x : x + 2 * r + 1]) / tau)

    def below(self, events, layers):
        channel = events.p.tolist() if self.s.polarity else [0] * len(events)
        for layer in range(layers):
            channel = [self.nearest(surface, layer) for surface in self.surfaces(events, channel, layer)]
        return channel

    def nearest(self, surface, layer):
        return int(np.argmin([np.linalg.norm(surface - c) for c in self.centres[layer]]))

    def learn(self, recordings, orders):
        for layer, order in enumerate(orders):
            n, first = self.s.centres_of(layer), recordings[order[0]]
            made = self.surfaces(first, self.below(first, layer), layer)
            self.centres.append([next(made).copy() for _ in range(n)])
            self.wins.append([1] * n)
            for k in order:
                for surface in self.surfaces(recordings[k], self.below(recordings[k], layer), layer):
                    self.move(surface, layer)

    def move(self, surface, layer):
        k = self.nearest(surface, layer)
        c, wins = self.centres[layer][k], self.wins[layer][k]
        alpha, beta = 0.01 / (1 + wins / 20000), np.sum(c * surface) / (np.linalg.norm(c) * np.linalg.norm(surface))
        self.centres[layer][k] = c + alpha * (surface - beta * c)
        self.wins[layer][k] += 1


@pytest.mark.parametrize("polarity", [True, False])
def test_the_paper_read_plainly(polarity):
    s = Hierarchy(layers=2, radius=2, tau=3.0, centres=3, tau_factor=4.0, polarity=polarity)
    size = (3, 3)  # all see each other: lone events would make equal prototypes, between which rounding decides
    recordings, layers = [drawn(k, 100, size) for k in range(4)], Layers(s, size, seed=5)
    layers.learn(recordings)
    plain = Plain(s, size)
    plain.learn(recordings, [np.random.default_rng([5, layer]).permutation(4) for layer in range(2)])
    for layer in range(2):
        assert layers.wins[layer].tolist() == plain.wins[layer]
        mine = layers.centres[layer].transpose(3, 0, 1, 2)
        np.testing.assert_allclose(mine, plain.centres[layer], rtol=1e-9, atol=1e-12)
    unseen = drawn(9, n=200, size=size)
    for layer in range(2):
        found = plain.below(unseen, layer + 1)
        assert layers.assigned(unseen, layer).tolist() == found
        counted = np.bincount(found, minlength=s.centres_of(layer))
        assert layers.features(unseen, layer=layer).tolist() == [[counted.tolist()]]


def test_prototypes_begin_as_surfaces_of_events_of_any_recording():
    recordings = [drawn(k) for k in range(3)]
    still = Hierarchy(layers=1, radius=1, tau=3.0, centres=5, rate=1e-12, first="drawn")
    layers = Layers(still, SIZE, seed=2)
    layers.learn(recordings)
    plain = Plain(still, SIZE)
    seen = [[s.copy() for s in plain.surfaces(one, one.p.tolist(), 0)] for one in recordings]
    sources = [
        {k for k, surfaces in enumerate(seen) if min(np.abs(centre - s).max() for s in surfaces) < 1e-9}
        for centre in layers.centres[0].transpose(3, 0, 1, 2)
    ]
    assert all(sources)
    assert len(set.union(*sources)) > 1
    assert layers.wins[0].sum() == 3 * 150 + 5


def test_a_training_goes_on_to_the_same_bits():
    recordings, whole, kept = [drawn(k) for k in range(3)], Layers(SMALL, SIZE, seed=1), []
    whole.learn(recordings, lambda layers, done, total: kept.append((layers.state(), done, total)))
    assert [part[1:] for part in kept] == [(k, 6) for k in range(1, 7)]
    for state, _, _ in kept:
        again = Layers.from_state(SMALL, SIZE, state)
        again.learn(recordings)
        for name, array in whole.state().items():
            assert np.array_equal(array, again.state()[name]), name
        assert np.array_equal(again.features(drawn(7)), whole.features(drawn(7)))
    other = Layers(SMALL, SIZE, seed=3)
    other.learn(recordings)
    assert not np.array_equal(other.centres[0], whole.centres[0])


@pytest.fixture(scope="module")
def learnt():
    layers = Layers(SMALL, (20, 20))
    layers.learn([drawn(k, 400, (20, 20)) for k in range(4)])
    return layers


@given(st.integers(0, 5), st.integers(0, 4), st.integers(0, 4), st.integers(0, 10**9))
@settings(max_examples=20, deadline=None)
def test_what_is_seen_moves_with_the_object(learnt, seed, right, down, later):
    inside = drawn(seed, 200, (10, 10))
    here = Events(inside.t, inside.x + 3, inside.y + 3, inside.p, (20, 20))
    there = Events(here.t + later, here.x + right, here.y + down, here.p, (20, 20))
    assert np.array_equal(learnt.features(here), learnt.features(there))


def test_cells_are_counted_each_by_itself(learnt):
    events = drawn(1, 300, (20, 20))
    cells = learnt.features(events, cell=8)
    assert cells.shape == (3, 3, 6)
    assert np.array_equal(cells.sum(axis=(0, 1)), learnt.features(events)[0, 0])
    corner = learnt.assigned(events, 1)[(events.x >= 16) & (events.y < 8)]
    assert cells[0, 2].tolist() == np.bincount(corner, minlength=6).tolist()
    assert learnt.features(events[:0]).tolist() == [[[0] * 6]]


def edge(along, seed):
    """An edge that moves over the field, along x or y, with jitter."""
    rng, step, across = np.random.default_rng(seed), np.repeat(np.arange(20), 20), np.tile(np.arange(20), 20)
    t = np.sort(1000 * step + rng.integers(0, 900, 400))
    x, y = (step, across) if along == "x" else (across, step)
    return Events(t, x, y, np.ones(400, int), (20, 20))


@pytest.mark.parametrize("name", DISTANCES)
def test_edges_are_told_apart_by_each_distance(name):
    recordings, labels = [edge("xy"[k % 2], k) for k in range(12)], np.arange(12) % 2
    layers = Layers(Hierarchy(layers=2, tau=3.0, tau_factor=3.0, centres=6, first="drawn"), (20, 20))
    layers.learn(recordings[:8])
    histograms, readout = np.array([layers.features(one).ravel() for one in recordings]), Nearest(distance=name)
    scores = readout.scores(readout.fit(histograms[:8], labels[:8], 3, Course()), histograms[8:])
    assert scores.argmax(axis=1).tolist() == labels[8:].tolist()
    assert np.isneginf(scores[:, 2]).all()


def test_known_values():
    one, means = np.array([[3, 1], [0, 4]]), np.array([[3.0, 1.0], [6.0, 2.0], [0.0, 8.0]])
    np.testing.assert_allclose(standard(one, means), [[0, 10**0.5, 58**0.5], [18**0.5, 40**0.5, 4]])
    half = 0.75 * 2**0.5
    np.testing.assert_allclose(normalised(one, means), [[0, 0, half], [half, half, 0]])
    np.testing.assert_allclose(bhattacharyya(one, means)[0], [0, 0, -np.log(0.5)], atol=1e-15)
    assert bhattacharyya(np.array([[1, 0]]), np.array([[0.0, 1.0]])).tolist() == [[np.inf]]
    s = Hierarchy()
    assert [(s.radius_of(k), s.tau_of(k), s.centres_of(k), s.channels_of(k)) for k in range(3)] == [
        (2, 10_000, 4, 2), (4, 100_000, 8, 4), (8, 1_000_000, 16, 8),
    ]  # fmt: skip


def test_mistakes(learnt, messages):
    fresh = Layers(SMALL, SIZE)
    messages(refusals_of(messages.cases, globals() | locals()))
