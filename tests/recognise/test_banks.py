"""Filters that leak, local maxima, and latencies, beside their definitions written out."""

import numpy as np
import pytest

from neuro.events import Events
from neuro_recognise.parts.banks import LeakyGabors, LocalMaximum, gabor_bank
from neuro_recognise.parts.encoders import Latency


def random_events(n, seed=0, side=14):
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, side, (2, n))
    return Events(np.sort(rng.integers(0, 50_000, n)), x, y, rng.integers(0, 2, n), (side, side))


@pytest.mark.parametrize(("signed", "side"), [(False, 1), (True, 1), (False, 2)])
def test_responses_leak(signed, side):
    bank = LeakyGabors(sizes=(3, 5), sigmas=(1.2, 2.0), wavelengths=(1.5, 2.5), leak=0.02, signed=signed)
    events, bounds = random_events(300), np.array([0, 120, 120, 250])
    found = bank.responses(events, bounds, side)
    assert found.shape == (3, 2, 4, 14 // side, 14 // side)
    maps, last = np.zeros((2, 4, 14 + 8, 14 + 8)), 0
    at = {}
    for k in range(250):
        maps = np.sign(maps) * np.maximum(np.abs(maps) - 2e-5 * (events.t[k] - last), 0.0)
        last = events.t[k]
        y, x = events.y[k] + 4, events.x[k] + 4
        maps[:, :, y - 2 : y + 3, x - 2 : x + 3] += (-1 if signed and not events.p[k] else 1) * bank.filters
        at[k + 1] = np.abs(maps[:, :, 4:-4, 4:-4])
    for frame, end in enumerate(bounds[1:]):
        expected = at[end].reshape(2, 4, 14 // side, side, 14 // side, side).max((3, 5))
        np.testing.assert_allclose(found[frame], expected, atol=1e-9)


def test_round_and_smooth_filters():
    plain = gabor_bank([5], [2.0], [2.5], 0.3, [0.0, 45.0], circular=True)
    assert len(np.unique(plain[0, 1][[0, 0, 4, 4], [0, 4, 0, 4]])) == 1  # the corners have minus the mean alone
    np.testing.assert_allclose(plain.sum((2, 3)), 0, atol=1e-12)
    smooth = gabor_bank([5], [2.0], [2.5], 0.3, [0.0, 45.0], circular=True, smooth=True)
    np.testing.assert_allclose(smooth[0, :, 2, 2], plain[0, :, 1:4, 1:4].mean((1, 2)))
    np.testing.assert_allclose(smooth[0, :, 0, 0], plain[0, :, :2, :2].sum((1, 2)) / 9)


def test_local_maxima():
    pool, rng = LocalMaximum(least=0.3), np.random.default_rng(1)
    responses = rng.random((2, 2, 3, 9, 8))
    sizes = (3, 5)
    found = pool.passed(responses, sizes)
    for f, s, o, i, j in np.ndindex(responses.shape):
        reach = sizes[s] // 2
        around = responses[f, s, o, max(0, i - reach) : i + reach + 1, max(0, j - reach) : j + reach + 1]
        here = responses[f, s, o, i, j]
        assert found[f, s, o, i, j] == (here if here >= 0.3 and here == around.max() else 0.0)


def test_latencies():
    encoder = Latency(first=3, window=10.0)
    responses = np.zeros((2, 2, 1, 1, 3))
    responses[0] = np.array([0.5, 0.0, 2.0, 2.0, 0.1, 1.0]).reshape(2, 1, 1, 3)
    codes, ids, lengths = encoder.encode(responses)
    assert (codes.tolist(), ids.tolist(), lengths.tolist()) == ([2.0, 2.0, 1.0], [2, 3, 5], [3, 0])
    assert encoder.channels(2, 1) == 2
    learnt = encoder.learn(codes)
    assert encoder.times(codes, learnt).tolist() == [0.0, 0.0, 5.0]
    assert encoder.times(np.array([4.0, 0.001]), learnt).tolist() == [
        0.0,
        9.0,
    ]  # stronger than all before; the last tick
