import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neuro.events import DVS, DVSParameters, dvs_events

BAD_LIGHT = "image has a negative or infinite intensity, expected 0 or more"
IDEAL = DVSParameters(mismatch=0.0, refractory=0.0, leak=0.0, noise=0.0, floor=1e-9)


def log_ramp(values):
    """One pixel whose log intensity takes these values."""
    return np.exp(np.asarray(values, float)).reshape(-1, 1, 1)


def test_a_ramp_has_one_event_per_threshold():
    events = dvs_events([0, 1_000_000], log_ramp([-3.0, -1.0]), IDEAL)
    assert len(events) in (9, 10)  # the tenth lies on the last image
    np.testing.assert_allclose(events.t[:9], np.arange(1, 10) * 100_000, atol=1)
    assert events.p.all()
    down = dvs_events([0, 1_000_000], log_ramp([-1.0, -2.9]), IDEAL)
    assert len(down) == 9
    assert not down.p.any()


def test_thresholds_of_their_own():
    p = DVSParameters(threshold_on=0.5, threshold_off=0.25, mismatch=0, refractory=0, leak=0, noise=0, floor=1e-9)
    events = dvs_events([0, 1000, 2000], log_ramp([-3.0, -1.9, -3.0]), p)
    assert events.p.tolist() == [1, 1, 0, 0, 0, 0]  # 1.1 up leaves 0.1; 1.1 down from there


def test_a_moving_edge():
    width, contrast = 40, 1.0
    x = np.arange(width)
    images = [np.tile(np.exp(-3 + contrast * (x < edge)), (3, 1)) for edge in range(5, 36)]
    events = dvs_events(1000 * np.arange(len(images)), images, IDEAL)
    per_pixel = np.zeros((3, width), int)
    np.add.at(per_pixel, (events.y, events.x), 1)
    steps = round(contrast / 0.2)
    assert ((per_pixel[:, 5:35] == steps) | (per_pixel[:, 5:35] == steps - 1)).all()
    assert per_pixel[:, :5].sum() + per_pixel[:, 35:].sum() == 0
    assert events.p.all()
    assert (events.t // 1000 - (events.x.astype(int) - 5)).max() <= 1


def test_flicker_balances():
    """0.55 up: 2 thresholds of 0.2; then 0.95 down and up again: 4 each; the last rise ends half way."""
    light = log_ramp(-2 + 0.55 * np.sin(2 * np.pi * np.arange(401) / 100))
    events = dvs_events(1000 * np.arange(401), light, IDEAL)
    assert "".join("+" if on else "-" for on in events.p) == "++" + 3 * "----++++" + "----+"


def test_refractory_pixels_are_blind():
    p = DVSParameters(mismatch=0.0, refractory=50_000.0, leak=0.0, noise=0.0, floor=1e-9)
    events = dvs_events([0, 1_000_000], log_ramp([-3.0, -1.0]), p)
    np.testing.assert_allclose(np.diff(events.t), 150_000, atol=1)
    fast = dvs_events([0, 10_000, 500_000], log_ramp([-3.0, -1.0, -1.0]), p)
    assert len(fast) == 1


def test_leak_and_noise_rates():
    image = np.full((50, 50), 0.5)
    leak = DVS((50, 50), DVSParameters(mismatch=0.0, refractory=0.0, leak=2.0, noise=0.0))
    leak.feed(0, image)
    events = leak.feed(10_100_000, image)
    assert len(events) == 2500 * 20
    assert events.p.all()
    noise = DVS((50, 50), DVSParameters(leak=0.0, noise=4.0), seed=3)
    noise.feed(0, image)
    events = noise.feed(10_000_000, image)
    n = 2500 * 10 * 4
    assert abs(len(events) - n) < 5 * np.sqrt(n)
    assert abs(events.p.mean() - 0.5) < 0.01
    gaps = np.diff(events.t[(events.x == 3) & (events.y == 7)])
    assert 0.5 < gaps.std() / gaps.mean() < 1.5


def test_mismatch_spreads_thresholds():
    images = [np.full((50, 50), np.exp(v)) for v in (-4.0, -1.0)]
    counts = []
    for mismatch in (0.0, 0.05):
        p = DVSParameters(mismatch=mismatch, refractory=0.0, leak=0.0, noise=0.0, floor=1e-9)
        events = dvs_events([0, 1000], images, p)
        counts.append(np.bincount(events.y * 50 + events.x.astype(int), minlength=2500).std())
    assert counts[0] < 1e-9 < 1.0 < counts[1]


@given(st.integers(0, 10_000), st.lists(st.integers(1, 50), min_size=1, max_size=4), st.floats(0, 3000))
@settings(max_examples=30, deadline=None)
def test_more_images_of_a_line_change_nothing(seed, cuts, refractory):
    """Cutting an interval of constant slope moves times by rounding only."""
    rng = np.random.default_rng(seed)
    p = DVSParameters(refractory=refractory, leak=5.0, noise=5.0, floor=1e-9)
    start, end = rng.normal(-3, 1, (2, 6, 5))
    times = np.concatenate([[0], np.cumsum(cuts) * 1000])
    line = [np.exp(start + (end - start) * t / times[-1]) for t in times]
    whole = dvs_events(times[[0, -1]], [line[0], line[-1]], p, seed=seed)
    parts = dvs_events(times, line, p, seed=seed)
    assert abs(len(whole) - len(parts)) <= 1
    if len(whole) == len(parts):
        a, b = (np.lexsort((e.t, e.x, e.y)) for e in (whole, parts))
        assert np.abs(whole.t[a] - parts.t[b]).max(initial=0) <= 1


def test_same_seed_same_events_and_reset():
    images = np.random.default_rng(0).random((5, 20, 30))
    times = np.arange(5) * 10_000
    one = dvs_events(times, images, seed=1)
    assert one == dvs_events(times, images, seed=1)
    assert one != dvs_events(times, images, seed=2)
    camera = DVS((30, 20), seed=1)
    for _ in range(2):
        parts = [camera.feed(int(t), image) for t, image in zip(times, images, strict=True)]
        assert np.array_equal(np.concatenate([e.records() for e in parts]), one.records())
        camera.reset()


def test_many_events_fit():
    """One pixel with more events than the first buffer holds."""
    p = DVSParameters(threshold_on=0.01, mismatch=0.0, refractory=0.0, leak=0.0, noise=0.0, floor=1e-9)
    events = dvs_events([0, 1_000_000], log_ramp([-13.0, 0.005]), p)
    assert len(events) == 1300


def test_integer_images_have_a_full_scale():
    p = DVSParameters(mismatch=0.0)
    shades = np.array([[[10, 200]], [[200, 10]]], np.uint8)
    assert dvs_events([0, 1000], shades, p) == dvs_events([0, 1000], shades / 255.0, p)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda c: c.feed(5, np.ones((2, 2))), "image at 5 us, expected later than the one before, at 5 us"),
        (lambda c: c.feed(6, np.ones((2, 3))), "image has shape (2, 3), expected (2, 2)"),
        (lambda c: c.feed(6, -np.ones((2, 2))), BAD_LIGHT),
        (lambda c: c.feed(6, np.full((2, 2), np.nan)), BAD_LIGHT),
        (lambda c: DVS((2, 2), seed=-1), "seed is -1, expected 0 or more"),
        (lambda c: DVSParameters(leak=-1.0), "leak is -1.0, expected a number of at least 0.0"),
        (lambda c: DVSParameters(threshold_on=0.0), "threshold_on is 0.0, expected a number of at least 0.01"),
        (lambda c: dvs_events([0], np.ones((2, 2, 2))), "images have shape (2, 2, 2), expected (1, height, width)"),
    ],
)  # fmt: skip
def test_messages(act, message):
    camera = DVS((2, 2))
    camera.feed(5, np.ones((2, 2)))
    with pytest.raises(ValueError) as error:  # noqa: PT011 (the text is compared below)
        act(camera)
    assert str(error.value) == message
