import numpy as np
import pytest

from neuro.events import msd_segments


def literal(t, tau, threshold):
    bounds, v, last = [0], 0.0, t[0] if len(t) else 0
    for k, now in enumerate(t):
        v, last = v * np.exp((last - now) * 1e-6 / tau) + 1.0, now
        if v >= threshold:
            bounds.append(k + 1)
            v = 0.0
    return bounds


def test_without_leak_it_counts():
    assert msd_segments(np.zeros(32, np.int64), threshold=10.0).tolist() == [0, 10, 20, 30]


def test_slow_events_make_no_segment():
    assert msd_segments(np.arange(100) * 20_000, tau=0.02, threshold=2.0).tolist() == [0]


def test_as_the_definition():
    t = np.cumsum(np.random.default_rng(0).integers(0, 300, 5000))
    assert msd_segments(t).tolist() == literal(t, 0.02, 150.0)
    assert msd_segments(np.array([], np.int64)).tolist() == [0]
    assert msd_segments(t - 10**15).tolist() == msd_segments(t).tolist()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tau": 0.0}, "tau is 0.0 s, expected more than 0"),
        ({"threshold": -1.0}, "threshold is -1.0 events, expected more than 0"),
    ],
)
def test_messages(options, message):
    with pytest.raises(ValueError, match=message):
        msd_segments(np.arange(3), **options)
