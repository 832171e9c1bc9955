"""`DVS.see` told where the image may have changed."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from event_tests import refusal
from neuro.events import DVS, DVSParameters


@given(
    st.integers(0, 10_000),
    st.integers(1, 150),
    st.integers(1, 40),
    st.sampled_from(["uint8", "uint16", "float32", "float64"]),
    st.sampled_from([0.0, 5.0]),
    st.sampled_from([0.0, 200.0]),
)
@settings(max_examples=60)
def test_a_true_promise_changes_nothing(seed, width, height, kind, noise, cutoff):
    rng = np.random.default_rng(seed)
    p = DVSParameters(leak_rate_hz=noise, shot_noise_rate_hz=noise, cutoff_hz=cutoff)
    told, plain = (DVS((width, height), p, seed=seed) for _ in range(2))
    top = np.iinfo(kind).max if kind[0] == "u" else 1.0
    image = (top * rng.random((height, width))).astype(kind)
    for k in range(8):
        x0, x1 = np.sort(rng.integers(0, width + 1, 2)).tolist()
        y0, y1 = np.sort(rng.integers(0, height + 1, 2)).tolist()
        image[y0:y1, x0:x1] = (top * rng.random((y1 - y0, x1 - x0))).astype(kind)
        expected = plain.see(image, 20_000 * k)
        assert told.see(image, 20_000 * k, changed=(x0, y0, x1, y1)) == expected


def test_what_was_not_promised_is_seen_later():
    camera = DVS((256, 4), DVSParameters.ideal())
    image = np.full((4, 256), 0.2, np.float32)
    camera.see(image, 0, changed=(0, 0, 0, 0))
    image[0, 0] = image[3, 255] = 0.5
    assert np.unique(camera.see(image, 1000, changed=(0, 0, 1, 1)).x).tolist() == [0]
    assert len(camera.see(image, 2000, changed=(0, 0, 0, 0))) == 0
    assert np.unique(camera.see(image, 3000).x).tolist() == [255]


def test_few_and_many_events_are_in_the_same_order():
    """By time, then by row and column, for any number of events."""
    rng = np.random.default_rng(0)
    for n in (1, 6, 7, 8, 30):
        camera = DVS((40, n), DVSParameters.ideal(), seed=n)
        camera.see(0.3 + 0.1 * rng.random((n, 40)), 0)
        for k in range(1, 5):
            e = camera.see(0.3 + 0.1 * rng.random((n, 40)), 100 * k)
            assert np.array_equal(np.lexsort((e.x, e.y, e.t)), np.arange(len(e)))


EXPECTED = "expected x0, y0, x1, y1 with 0 <= x0 <= x1 <= 3 and 0 <= y0 <= y1 <= 2"


@pytest.mark.parametrize(
    "box",
    [(-1, 0, 1, 1), (0, 0, 4, 1), (0, 0, 1, 3), (2, 0, 1, 1), (0, 2, 1, 1), (0, 0, 1.5, 1)],
)
def test_the_part_must_be_on_the_image(box):
    camera = DVS((3, 2))
    camera.see(np.ones((2, 3)), 0)
    assert refusal(camera.see, np.ones((2, 3)), 10, changed=box) == f"image at 10 us: changed is {box}, {EXPECTED}"
    assert len(camera.see(0.5 * np.ones((2, 3)), 10)) > 0
