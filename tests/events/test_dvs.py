import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro import ModelError
from neuro.events import DVS, DVSParameters, dvs_events, frames_of

US = 1e6


def pure(**changes):
    """Equal, noiseless pixels with the log for a curve."""
    return DVSParameters.ideal(**{"linear_below": 0.0, "floor": 1e-9, **changes})


def log_ramp(values):
    """One pixel whose log intensity takes these values."""
    return np.exp(np.asarray(values, float)).reshape(-1, 1, 1)


def counts(events, size):
    """ON and OFF events of each pixel, (2, height, width)."""
    out = np.zeros((2, size[1], size[0]), int)
    np.add.at(out, (1 - events.p, events.y, events.x), 1)
    return out


def still(size, parameters, *, light=0.5, us=10_000_000, seed=0):
    """What a camera says of a grey wall."""
    camera, wall = DVS(size, parameters, seed=seed), np.full((size[1], size[0]), light)
    return camera.record([(0, wall), (us, wall)])


def test_thresholds_of_their_own():
    p = pure(pos_thres=0.5, neg_thres=0.25)
    events = dvs_events([0, 1000, 2000], log_ramp([-3.0, -1.9, -3.0]), p)
    assert events.p.tolist() == [1, 1, 0, 0, 0, 0]  # 1.1 up leaves 0.1; 1.1 down from there


def test_an_object_that_passes_leaves_as_many_off_as_on():
    rng, images = np.random.default_rng(4), np.full((40, 9, 70), 90, np.uint8)
    shape = rng.integers(0, 255, (9, 12))
    for k in range(1, 39):
        images[k, :, k : k + 12] = shape
    on, off = counts(dvs_events(1000 * np.arange(40), images, DVSParameters.ideal()), (70, 9))
    assert on.sum() > 500
    np.testing.assert_array_equal(on, off)


def test_the_curve_is_that_of_v2e():
    """lin_log of v2e on its 256 greys, but for the log of 255: a constant that no event depends on."""
    grey = np.arange(256.0)
    v2e = np.where(grey <= 20, grey * np.log(20) / 20, np.log(np.maximum(grey, 1)))
    np.testing.assert_allclose(DVSParameters().log_intensity(grey / 255) + np.log(255), v2e, atol=1e-12)
    np.testing.assert_allclose(pure(floor=0.1).log_intensity([0.0, 0.9]), np.log([0.1, 1.0]), atol=1e-12)


@pytest.mark.parametrize("images_after", [1, 1000])
def test_step_response_of_limited_bandwidth(images_after):
    """ln 4 (1 - exp(-t/tau)) meets threshold k at -tau ln(1 - 0.2 k / ln 4), however many images show it."""
    bright = (255 * 0.8 + 20) / 275
    tau = US / (2 * np.pi * 100 * bright)
    later = [(1 + (k + 1) * 1_000_000 // images_after, np.full((1, 1), 0.8)) for k in range(images_after)]
    events = DVS((1, 1), pure(cutoff_hz=100.0)).record([(0, np.full((1, 1), 0.2)), (1, np.full((1, 1), 0.8)), *later])
    expected = -tau * np.log(1 - 0.2 * np.arange(1, 7) / np.log(4))
    np.testing.assert_allclose(events.t, expected, atol=2)


@pytest.mark.parametrize("ratio", [0.25, 4.0])
def test_attenuation_and_phase(ratio):
    """At its events the signal is known, so a sine fitted to them is what the low pass left."""
    f, amplitude, threshold = 10.0, 0.15, 0.01
    bright, t = (255 * 0.5 + 20) / 275, np.arange(0, 1_000_001, 500)
    light = log_ramp(np.log(0.5) + amplitude * np.sin(2e-6 * np.pi * f * t))
    events = dvs_events(t, light, pure(pos_thres=threshold, neg_thres=threshold, cutoff_hz=f / ratio / bright))
    level, late = threshold * np.cumsum(2.0 * events.p - 1.0), events.t > 300_000
    angle = 2e-6 * np.pi * f * events.t[late]
    (s, c, _), *_ = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle), np.ones(len(angle))], 1), level[late])
    assert np.hypot(s, c) / amplitude == pytest.approx(1 / np.hypot(1, ratio), rel=0.02)
    assert np.arctan2(c, s) == pytest.approx(-np.arctan(ratio), abs=0.03)


def test_refractory_period_is_a_smallest_interval():
    images = np.random.default_rng(5).random((50, 8, 9))
    p = DVSParameters(refractory_period_s=0.003, shot_noise_rate_hz=300.0, leak_rate_hz=50.0, cutoff_hz=200.0)
    events = dvs_events(np.arange(50) * 2000, images, p)
    pixel = events.y * 9 + events.x.astype(int)
    gaps = np.concatenate([np.diff(events.t[pixel == k]) for k in range(72)])
    assert len(gaps) > 1000
    assert 2999 <= gaps.min() < 3100


def test_leak_rate():
    p = pure(sigma_thres=0.03, leak_rate_hz=2.0, noise_rate_cov_decades=0.0)
    events = still((50, 50), p, us=10_100_000)
    assert len(events) == 2500 * 20
    assert events.p.all()


def test_leak_rates_differ_from_pixel_to_pixel():
    """Else all pixels of a still scene fire at the same time."""
    events = still((40, 40), pure(leak_rate_hz=1.0, noise_rate_cov_decades=0.2), us=500_000_000)
    rates = counts(events, (40, 40))[0].ravel() / 500
    assert np.log10(rates).std() == pytest.approx(0.2, rel=0.1)
    assert np.log10(rates).mean() == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(("light", "share"), [(0.0, 1 - 0.75 * 20 / 275), (0.5, 1 - 0.75 * 147.5 / 275), (1.0, 0.25)])
def test_shot_noise_is_less_in_the_light(light, share):
    events = still((50, 50), DVSParameters.ideal(shot_noise_rate_hz=4.0), light=light, seed=3)
    n = 2500 * 10 * 4 * share
    assert abs(len(events) - n) < 4 * np.sqrt(n)
    assert abs(events.p.mean() - 0.5) < 4 * 0.5 / np.sqrt(n)
    each = counts(events, (50, 50)).sum(0)
    assert each.var() / each.mean() == pytest.approx(1.0, abs=0.12)  # Poisson: 0.028 is one sigma
    gaps = np.diff(events.t)
    assert gaps.std() / gaps.mean() == pytest.approx(1.0, abs=0.05)


def test_mismatch_spreads_thresholds():
    images = [np.full((50, 50), np.exp(v)) for v in (-4.0, -0.99)]
    found = [counts(dvs_events([0, 1000], images, pure(sigma_thres=s)), (50, 50))[0] for s in (0.0, 0.02)]
    assert (found[0] == 15).all()
    assert (3.01 / found[1]).std() == pytest.approx(0.02, rel=0.15)


def one_pixel(times, logs, on, off, leak, blind):
    """Twin of the kernel for one pixel without noise and limit of bandwidth; times in us, leak per us."""
    found, v, listen = [], 0.0, -1.0
    for k, t1 in enumerate(times[1:]):
        rate, t = (logs[k + 1] - logs[k]) / (t1 - times[k]) + leak, max(times[k], listen)
        while t < t1:
            goal = on if rate > 0 else -off
            end = v + rate * (t1 - t)
            if rate == 0 or (abs(end - goal) > 1e-9 and (end < goal) == (rate > 0)):
                v = end
                break
            t, v = min(t + (goal - v) / rate, t1), 0.0
            found.append((t, int(rate > 0)))
            t = listen = t + blind
    return found


@given(
    st.integers(0, 10_000), st.floats(0, 3000), st.floats(0, 20), st.lists(st.integers(1, 40), min_size=1, max_size=9)
)
@settings(max_examples=30)
def test_pixels_are_those_of_the_twin(seed, blind, leak, gaps):
    """On images of which parts stay the same; more than one block."""
    rng, times = np.random.default_rng(seed), np.concatenate([[0], np.cumsum(gaps) * 500])
    logs = [rng.normal(-3, 0.5, (7, 11))]
    for _ in gaps:
        logs.append(np.where(rng.random((7, 11)) < 0.2, rng.normal(-3, 0.5, (7, 11)), logs[-1]))
    logs = np.array(logs)
    p = pure(refractory_period_s=1e-6 * blind, leak_rate_hz=leak, noise_rate_cov_decades=0.0)
    events = dvs_events(times, np.exp(logs), p)
    for y, x in np.ndindex(7, 11):
        mine = (events.x == x) & (events.y == y)
        twin = one_pixel(times, np.log(np.exp(logs[:, y, x]) + 1e-9), 0.2, 0.2, 0.2e-6 * leak, blind)
        assert events.p[mine].tolist() == [on for _, on in twin]
        np.testing.assert_allclose(events.t[mine], [t for t, _ in twin], atol=1.01)


def test_looking_longer_at_the_same_changes_nothing():
    """Everything on: what stays the same is the same, shown a hundred times or once."""
    images = np.random.default_rng(2).random((3, 9, 20)).astype(np.float32)
    p = DVSParameters(cutoff_hz=3.0, leak_rate_hz=3.0, shot_noise_rate_hz=3.0)
    often = [(1000 * k, images[(k + 100) // 101 % 3 if k else 0]) for k in range(203)]
    once = [often[k] for k in (0, 1, 101, 102, 202)]
    one, other = DVS((20, 9), p).record(often), DVS((20, 9), p).record(once)
    assert len(one) == len(other) > 600
    a, b = (np.lexsort((e.t, e.x, e.y)) for e in (one, other))
    assert np.abs(one.t[a] - other.t[b]).max() <= 1
    assert np.array_equal(one.p[a], other.p[b])


@pytest.mark.parametrize("cutoff", [0.0, 50.0])
def test_same_seed_same_events_however_cut(cutoff):
    images, times = np.random.default_rng(0).random((6, 20, 30)), np.arange(6) * 10_000
    p = DVSParameters(leak_rate_hz=5.0, shot_noise_rate_hz=20.0, cutoff_hz=cutoff)
    frames, one = list(zip(times.tolist(), images, strict=True)), dvs_events(times, images, p, seed=1)
    assert one == dvs_events(times, images, p, seed=1)
    assert one != dvs_events(times, images, p, seed=2)
    assert (np.diff(one.t) >= 0).all()
    camera = DVS((30, 20), p, seed=1)
    for _ in range(2):
        parts = [*camera.watch(iter(frames[:2])), *camera.watch(iter(frames[2:3])), camera.record(frames[3:])]
        assert [len(parts), np.concatenate([e.records() for e in parts]).tolist()] == [3, one.records().tolist()]
        camera.reset()


def test_the_origin_of_time_does_not_matter():
    images, times = np.random.default_rng(0).random((5, 20, 30)), np.arange(5) * 10_000
    p = DVSParameters(leak_rate_hz=5.0, shot_noise_rate_hz=20.0, cutoff_hz=100.0)
    one, late = dvs_events(times, images, p), dvs_events(times + 1_763_000_000_000_000, images, p)
    assert np.array_equal(late.t - 1_763_000_000_000_000, one.t)
    assert np.array_equal(late.x, one.x)


def test_many_events_fit():
    """One pixel with more events than the first buffer holds, within 1 us."""
    p = pure(pos_thres=0.01, refractory_period_s=0.0)
    assert len(dvs_events([0, 1], log_ramp([-13.0, 0.005]), p)) == 1300
    steep, limited = np.tile(log_ramp([-13.0, -1.0, -2.0]), (1, 2, 3)), pure(pos_thres=0.01, cutoff_hz=1e4)
    events = dvs_events([0, 100_000, 100_001], steep, limited)
    assert len(events) in range(6 * 1198, 6 * 1201)
    assert (np.diff(events.t) >= 0).all()


def test_small_buffers_change_nothing():
    """What is left of a pixel's interval is made up for when there is room again, to rounding."""
    images = np.random.default_rng(7).random((6, 3, 4))
    p = DVSParameters(pos_thres=0.02, neg_thres=0.02, sigma_thres=0.0, cutoff_hz=20.0, shot_noise_rate_hz=300.0)
    large, small = DVS((4, 3), p), DVS((4, 3), p)
    total = 0
    for k, image in enumerate(images):
        small._out = tuple(part[:2] for part in small._out)
        one, other = large.see(image, 20_000 * k), small.see(image, 20_000 * k)
        assert len(one) == len(other)
        a, b = (np.lexsort((e.t, e.x, e.y)) for e in (one, other))
        assert np.abs(one.t[a] - other.t[b]).max(initial=0) <= 1
        assert np.array_equal(one.p[a], other.p[b])
        total += len(one)
    assert total > 1000


def test_times_are_rounded_down():
    camera = DVS((1, 1), DVSParameters.ideal())
    camera.see(np.full((1, 1), 0.1), 7)
    assert camera.see(np.full((1, 1), 0.2), 1007).t.tolist() == [295, 584, 872]  # 7 + 1000 k 0.2 / ln 2


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float16", "float32"])
def test_types_of_images(kind):
    """Integers have their type's largest value as full scale; memory may lie in any order."""
    shades = np.array([[[0, 10], [200, 255]], [[200, 255], [3, 7]]], np.uint8)
    expected = dvs_events([0, 1000], shades / 255.0)
    given = (shades * 257.0).astype(kind) if kind == "uint16" else shades if kind == "uint8" else (shades / 255.0)
    found = dvs_events([0, 1000], np.asfortranarray(given.astype(kind)))
    assert counts(found, (2, 2)).tolist() == counts(expected, (2, 2)).tolist()
    np.testing.assert_allclose(found.t, expected.t, atol=10 if kind == "float16" else 1)


def test_frames_of_a_function_of_time():
    assert [t for t, _ in frames_of(lambda t: np.zeros((1, 1)), 5, 2105)] == [5, 1005, 2005, 2105]
    image = np.zeros((1, 1))

    def scene(t):
        """Still, then e^2 brighter within 2 ms; gives the same array each time."""
        image[0, 0] = 0.1 * np.exp(np.clip((t - 30_000) / 1000, 0, 2.001))
        return image

    frames = list(frames_of(scene, 0, 100_000, step_us=20_000, change=0.1))
    times = np.array([t for t, _ in frames])
    assert times[[0, -1]].tolist() == [0, 100_000]
    assert 20 < len(times) < 60
    assert np.diff(times)[(times[:-1] < 30_000) | (times[:-1] > 32_000)].max() >= 5_000
    np.testing.assert_allclose(DVS((1, 1), pure()).record(frames).t, 30_000 + 200 * np.arange(1, 11), atol=40)
    jump = list(frames_of(lambda t: np.full((1, 1), 0.9 if t > 777 else 0.1), 0, 1000, change=0.1, shortest_us=4))
    assert [t for t, image in jump if image < 0.5][-1] in range(773, 778)


def test_a_wrong_first_image_is_forgotten():
    camera = DVS((2, 2), pure())
    with pytest.raises(ModelError):
        camera.see(-HALF, 0)
    assert (len(camera.see(HALF, 0)), len(camera.see(2 * HALF, 1000))) == (0, 4 * 3)


HALF = np.full((2, 2), 0.5)


def test_messages(messages):
    camera, other = (DVS((2, 2), pure()) for _ in range(2))
    for one in (camera, other):
        one.see(np.ones((2, 2)), 5)
    messages.calls(globals() | locals())
    assert camera.see(HALF, 1005) == other.see(HALF, 1005)


# told where the image may have changed


@given(
    st.integers(0, 10_000), st.integers(1, 150), st.integers(1, 40),
    st.sampled_from(["uint8", "uint16", "float32", "float64"]), st.sampled_from([0.0, 5.0]),
    st.sampled_from([0.0, 200.0])
)  # fmt: skip
@settings(max_examples=40)
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
    camera, image = DVS((256, 4), DVSParameters.ideal()), np.full((4, 256), 0.2, np.float32)
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


def test_the_part_must_be_on_the_image(messages):
    camera = DVS((3, 2))
    camera.see(np.ones((2, 3)), 0)
    messages.calls(globals() | locals())
    assert len(camera.see(0.5 * np.ones((2, 3)), 10)) > 0
