"""What each filter does, against the plainest code for it; cut anywhere, the parts give what the whole gives."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from event_tests import parts_of, random_events, rows
from neuro.events import Events
from neuro.events.filters import (
    FILTERS,
    TAR,
    BackgroundActivity,
    Chain,
    Crop,
    Downsample,
    Flip,
    HotPixels,
    Jitter,
    Polarity,
    Refractory,
    Reverse,
    Rotate90,
    Scale,
    Shift,
    ShotNoise,
    TARSurfaces,
    Transpose,
    chain,
    hot_pixels,
)
from neuro.events.parts import joined_parts
from neuro.events.representations import event_frame

SIZE, WIDE = (7, 5), (9, 6)
frame = partial(event_frame, polarity="ignored")


def recording(n=400, step=2000):
    """Events of a small sensor at intervals below a step, us."""
    return random_events(n, SIZE, n * step // 2)


def literal_tar(events, tau, theta, radius):
    """Algorithm 14: all of the mask decays at every event."""
    width, height = events.sensor_size
    mask, last, keep = np.zeros((height, width)), int(events.t[0]), []
    for t, x, y, _ in rows(events):
        mask *= np.exp(-(t - last) * 1e-6 / tau)
        mask[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1] += 1
        keep.append(mask[y, x] > theta)
        last = t
    return np.array(keep)


@pytest.mark.parametrize("radius", [0, 1, 2, 9])
@pytest.mark.parametrize(("tau", "theta"), [(0.08, 2.4), (0.005, 1.3), (1e-5, 1.0)])
def test_tar_as_algorithm_14(radius, tau, theta):
    events = recording()
    keep = literal_tar(events, tau, theta, radius)
    assert 0 < keep.sum() < len(events) or tau == 1e-5
    assert TAR(SIZE, tau=tau, theta=theta, radius=radius).apply(events) == events[keep]


def test_tar_needs_more_than_theta_and_its_own_event_counts():
    same_time = Events(np.zeros(4, int), [3, 3, 4, 6], [2, 2, 2, 2], np.array([0, 1, 0, 1]), SIZE)
    assert (TAR(SIZE, theta=2.0).apply(same_time).x.tolist(), TAR(SIZE, theta=0.9).apply(same_time)) == ([4], same_time)
    assert TAR(SIZE, theta=2.0, first=1).apply(same_time).x.tolist() == [3, 4]
    events = Events(np.array([0, 10, 20]), [2, 2, 2], [2, 2, 2], [1, 1, 1], SIZE)
    assert TAR(SIZE, theta=2.5).apply(events).t.tolist() == [20]  # those that do not pass count


def literal_hats(events, tau, radius, cell):
    """HATS with an endless memory: every event of the cell and polarity is looked at again."""
    width, height = events.sensor_size
    side = 2 * radius + 1
    sums = np.zeros((-(-height // cell), -(-width // cell), 2, side, side))
    counts, seen = np.zeros(sums.shape[:2]), rows(events)
    for k, (t, x, y, p) in enumerate(seen):
        counts[y // cell, x // cell] += 1
        for t0, x0, y0, p0 in seen[:k]:
            near = max(abs(x0 - x), abs(y0 - y)) <= radius
            if near and p0 == p and (x0 // cell, y0 // cell) == (x // cell, y // cell):
                sums[y // cell, x // cell, p, y0 - y + radius, x0 - x + radius] += np.exp((t0 - t) * 1e-6 / tau)
    return sums / np.maximum(counts, 1)[:, :, None, None, None]


@pytest.mark.parametrize(("n", "tau", "step"), [(200, 0.03, 2000), (200, 2e-5, 2000), (700, 2e-6, 6)])
def test_surfaces_without_threshold_are_hats(n, tau, step):
    """The last case spans more than 600 time constants without a pause, where the unit is set anew."""
    events, surfaces = recording(n, step=step), TARSurfaces(SIZE, tau=tau, theta=0.5, radius=2, cell=3)
    assert surfaces(events) == events
    np.testing.assert_allclose(surfaces.histograms(), literal_hats(events, tau, 2, 3), rtol=1e-9, atol=1e-12)
    assert surfaces.histograms().max() > 0


def test_surfaces_pass_what_tar_passes_and_count_no_other():
    events, surfaces = recording(), TARSurfaces(SIZE, theta=1.7, tau=0.01, cell=4)
    kept = TAR(SIZE, theta=1.7, tau=0.01).apply(events)
    assert surfaces(events) == kept
    assert 0 < len(kept) < len(events)
    alone = TARSurfaces(SIZE, theta=100.0)
    assert len(alone(events)) == 0
    assert not alone.histograms().any()


@pytest.mark.parametrize("kind", [TAR, TARSurfaces])
@pytest.mark.parametrize("begin", [-(2**63), -(2**62) - 5, 0, 2**63 - 10_000])
def test_activity_is_forgotten_over_any_span(kind, begin):
    """Between int64's ends times differ by more than int64 holds."""
    near, after = [begin, begin + 1, begin + 2], [2**63 - 3, 2**63 - 2, 2**63 - 1]
    seen = kind(SIZE, tau=0.001, theta=2.4)(Events([*near, *after], [1] * 6, [1] * 6, [0] * 6, SIZE))
    assert seen.t.tolist() == [near[2], after[2]]


def test_background_as_the_definition():
    events, dt = recording(), 5000
    keep = [
        any(t - t0 <= dt and max(abs(x - x0), abs(y - y0)) == 1 for t0, x0, y0, _ in rows(events)[:k])
        for k, (t, x, y, _) in enumerate(rows(events))
    ]
    assert 0 < sum(keep) < len(keep)
    assert BackgroundActivity(SIZE, dt_us=dt).apply(events) == events[np.array(keep)]
    limit = Events(np.array([0, 100, 201]), [2, 3, 2], [1, 2, 3], [0, 1, 0], SIZE)
    assert BackgroundActivity(SIZE, dt_us=100).apply(limit).t.tolist() == [100]


@pytest.mark.parametrize(("extend", "kept"), [(False, [0, 100, 200]), (True, [0, 200])])
def test_refractory(extend, kept):
    events = Events(np.array([0, 60, 99, 100, 200]), [1] * 5, [1] * 5, [1, 0, 1, 0, 1], SIZE)
    assert Refractory(SIZE, period_us=100, extend=extend).apply(events).t.tolist() == kept
    both = Events(np.array([0, 1]), [1, 2], [1, 1], [1, 1], SIZE)
    assert (Refractory(SIZE, period_us=100).apply(both), Refractory(SIZE, period_us=0).apply(events)) == (both, events)


def test_hot_pixels_are_found_and_left_out():
    events = recording() + Events(np.arange(300) * 1000, [6] * 300, [0] * 300, [1] * 300, SIZE)
    assert (hot_pixels(events).tolist(), hot_pixels(events, times=40.0).tolist()) == ([[6, 0]], [])
    span_s = float(events.t[-1] - events.t[0]) * 1e-6
    rate = frame(events)[0, 6] / span_s
    assert hot_pixels([events[:100], events[100:]], above_hz=rate * 0.999).tolist() == [[6, 0]]
    for parts in (events, [events[:100], events[100:]]):
        assert hot_pixels(parts, above_hz=rate * 1.001).tolist() == []
    assert HotPixels(SIZE, hot_pixels(events)).apply(events) == events[(events.x != 6) | (events.y != 0)]
    assert (HotPixels(SIZE).apply(events), hot_pixels([]).shape) == (events, (0, 2))

    for count, found in ((10, []), (11, [[4, 2]])):
        assert hot_pixels(Events(np.arange(count), [4] * count, [2] * count, [1] * count, SIZE)).tolist() == found


def test_polarity_and_crop():
    events = recording()
    inside = events[(events.x >= 2) & (events.x < 5) & (events.y >= 1)]
    assert Crop(SIZE, x=(2, 5), y=(1, 5), move=False).apply(events) == inside
    cropped = Crop(SIZE, x=(2, 5), y=(1, 5)).apply(events)
    assert cropped.sensor_size == (3, 4)
    assert np.array_equal(frame(cropped), frame(events)[1:, 2:5])
    assert Crop(SIZE).apply(events) == events
    for keep in (0, 1):
        assert Polarity(SIZE, keep=keep).apply(events) == events[events.p == keep]


def test_downsample():
    events = recording()
    small = Downsample(SIZE, factor=(2, 3)).apply(events)
    assert (small.sensor_size, small) == ((4, 2), Events(events.t, events.x // 2, events.y // 3, events.p, (4, 2)))
    signs = [1] * 5 + [0] * 4 + [0, 1, 0, 0, 0, 0] + [1] * 4
    x, y = [0, 1, 0, 1, 2] + [0, 1] * 7, [0, 0, 1, 1] + [0] * 15
    summed = Downsample(SIZE, integrate=4).apply(Events(np.arange(19), x, y, signs, SIZE))
    assert rows(summed) == [(3, 0, 0, 1), (8, 0, 0, 0), (14, 0, 0, 0), (18, 0, 0, 1)]


TURNS = [
    (Flip(SIZE, "x"), lambda f: f[:, ::-1]), (Flip(SIZE, "y"), lambda f: f[::-1]), (Transpose(SIZE), lambda f: f.T),
    *((Rotate90(SIZE, k), lambda f, k=k: np.rot90(f, k)) for k in range(-1, 5))
]  # fmt: skip


@pytest.mark.parametrize(("turn", "as_frame"), TURNS, ids=lambda v: str(v) if isinstance(v, Flip | Rotate90) else "")
def test_space(turn, as_frame):
    events = recording()
    turned = turn.apply(events)
    assert np.array_equal(frame(turned), as_frame(frame(events)))
    assert turned.sensor_size == turn.out_size
    assert np.array_equal(turned.t, events.t)
    assert np.array_equal(turned.p, events.p)


def test_shift_and_scale():
    events = recording()
    assert np.array_equal(Shift(SIZE, by_us=-7).apply(events).t, events.t - 7)
    assert np.array_equal(Shift(SIZE, to_us=5).apply(events).t, events.t - events.t[0] + 5)
    assert np.array_equal(Scale(SIZE, factor=3).apply(events).t, events.t[0] + 3 * (events.t - events.t[0]))
    assert np.array_equal(Scale(SIZE, factor=3, origin_us=0).apply(events).t, 3 * events.t)
    few = Events([1, 3, 4], *[[0] * 3] * 3, SIZE)
    assert Scale(SIZE, 0.5, origin_us=0).apply(few).t.tolist() == [0, 2, 2]


def test_reverse():
    events = Events(np.array([5, 5, 9]), [0, 1, 2], [0, 0, 1], [1, 1, 0], SIZE)
    assert rows(Reverse(SIZE).apply(events)) == [(5, 2, 1, 1), (9, 1, 0, 0), (9, 0, 0, 0)]
    twice = Reverse(SIZE).apply(Reverse(SIZE).apply(events))
    assert (twice, Reverse(SIZE, invert=False).apply(events).p.tolist()) == (events, [0, 1, 1])


@settings(max_examples=60)
@given(seed=st.integers(0, 1000), amount=st.integers(0, 100_000))
def test_jitter_is_sorted_bounded_and_loses_nothing(seed, amount):
    events = recording(60)
    marked = Events(events.t, np.arange(60), np.zeros(60, int), events.p, (60, 1))
    shaken = Jitter((60, 1), amount_us=amount, seed=seed).apply(marked)
    assert (np.diff(shaken.t) >= 0).all()
    assert sorted(shaken.x) == list(range(60))
    moved = shaken.t - events.t[shaken.x]
    assert np.abs(moved).max() <= amount
    ties = np.diff(shaken.t) == 0
    assert (np.diff(shaken.x.astype(int))[ties] > 0).all()


def test_jitter_is_even_and_keyed():
    n = 20_000
    events = Events(np.arange(n) * 1000, *[np.zeros(n, int)] * 3, SIZE)
    moved = Jitter(SIZE, amount_us=2).apply(events).t - events.t
    counts = np.bincount(moved + 2)
    assert len(counts) == 5
    assert np.abs(counts - n / 5).max() < 5 * np.sqrt(n * 0.16)
    assert not np.array_equal(moved, Jitter(SIZE, amount_us=2, seed=1).apply(events).t - events.t)


def noise_only(stop=10_000_000, start=0, **options):
    """The noise alone: two events of a polarity that noise has too are taken out again."""
    ends = Events(np.array([start, stop]), [0, 0], [0, 0], [1, 1], SIZE)
    noisy = rows(ShotNoise(SIZE, **options).apply(ends))
    noisy.remove((start, 0, 0, 1))
    noisy.remove((stop, 0, 0, 1))
    return np.array(noisy)


def test_noise_is_poisson():
    noise, expected = noise_only(rate_hz=20.0), 20.0 * 10 * SIZE[0] * SIZE[1]
    assert abs(len(noise) - expected) < 5 * np.sqrt(expected)
    per_pixel = np.bincount(noise[:, 2] * SIZE[0] + noise[:, 1], minlength=35)
    assert np.abs(per_pixel - expected / 35).max() < 5 * np.sqrt(expected / 35)
    assert abs(noise[:, 3].mean() - 0.5) < 5 * 0.5 / np.sqrt(expected)
    gaps = np.diff(noise[:, 0])
    assert abs(gaps.std() / gaps.mean() - 1.0) < 0.05
    per_bin = np.bincount(noise[:, 0] // 1500)
    assert abs(per_bin.var() / per_bin.mean() - 1.0) < 0.1


def test_noise_is_a_function_of_time_and_seed():
    all_of_it, late = noise_only(rate_hz=50.0), noise_only(rate_hz=50.0, start=4_000_321)
    assert np.array_equal(late, all_of_it[all_of_it[:, 0] >= 4_000_321])
    assert not np.array_equal(noise_only(rate_hz=50.0, seed=1), all_of_it)


def test_noise_keeps_the_events_and_comes_first():
    events = recording()
    noisy = rows(ShotNoise(SIZE, rate_hz=5.0).apply(events))
    assert len(noisy) > len(events) + 10
    left = iter(noisy)
    assert all(event in left for event in rows(events))
    assert [row[0] for row in noisy] == sorted(row[0] for row in noisy)
    crowd = Events(np.arange(0, 2000), *[np.full(2000, 6)] * 1, np.full(2000, 4), np.ones(2000, int), SIZE)
    noisy = rows(ShotNoise(SIZE, rate_hz=1000.0).apply(crowd))
    places = {t: k for k, (t, x, y, p) in enumerate(noisy) if (x, y, p) == (6, 4, 1)}
    assert all(places[t] >= k for k, (t, *_) in enumerate(noisy))


MADE = [
    TAR(WIDE, tau=0.002, theta=1.5), TAR(WIDE, tau=0.002, theta=3.0, radius=2, first=7),
    TARSurfaces(WIDE, tau=0.002, theta=1.5, cell=4), TARSurfaces(WIDE, tau=1e-6, theta=1.5),
    BackgroundActivity(WIDE, dt_us=900), Refractory(WIDE, period_us=3000),
    Refractory(WIDE, period_us=3000, extend=True), HotPixels(WIDE, [(3, 2), (8, 5)]), Polarity(WIDE, keep=0),
    Crop(WIDE, x=(2, 7), y=(0, 4)), Downsample(WIDE, factor=2), Downsample(WIDE, factor=(4, 3), integrate=3),
    Shift(WIDE, by_us=11), Shift(WIDE, to_us=0), Scale(WIDE, factor=0.37), Reverse(WIDE),
    Jitter(WIDE, amount_us=2500, seed=3), Flip(WIDE), Rotate90(WIDE, turns=3), Transpose(WIDE),
    ShotNoise(WIDE, rate_hz=40.0, seed=5),
    chain(Jitter(WIDE, 700), Crop(WIDE, x=(1, 8)), Reverse((7, 6)), TAR((7, 6), tau=0.002, theta=1.2)),
    chain(ShotNoise(WIDE, 30.0), BackgroundActivity(WIDE, 800), Jitter(WIDE, 3000, seed=1), Downsample(WIDE, 3, 2))
]  # fmt: skip


def joined(parts):
    return joined_parts(list(parts))


@st.composite
def cut_recordings(draw):
    n, rng = draw(st.integers(0, 300)), np.random.default_rng(draw(st.integers(0, 2**32)))
    start = draw(st.sampled_from([0, -5000, 10**12]))
    t = start + np.cumsum(rng.integers(0, draw(st.sampled_from([2, 60, 2000])), n))
    events = Events(t, rng.integers(0, 9, n), rng.integers(0, 6, n), rng.integers(0, 2, n), WIDE)
    return events, parts_of(events, draw(st.lists(st.integers(0, n), max_size=12)))


@pytest.mark.parametrize("made", MADE, ids=str)
@settings(max_examples=15)
@given(recording=cut_recordings())
def test_cutting_does_not_matter(made, recording):
    events, parts = recording
    made.reset()
    whole, rest = made(events), made.finish()
    assert (joined(made(part) for part in parts), made.finish()) == (whole, rest)
    assert (joined([whole, rest]), joined([whole[:0], *made.stream(parts)])) == (made.apply(events), made.apply(events))


def test_surfaces_do_not_depend_on_the_cuts():
    events = random_events(500, WIDE, 75_000)
    whole, parts = TARSurfaces(WIDE, tau=2e-6), TARSurfaces(WIDE, tau=2e-6)
    whole(events)
    for k in range(0, 500, 7):
        parts(events[k : k + 7])
    assert np.array_equal(whole.histograms(), parts.histograms())


def test_every_filter_is_tested_and_says_what_it_is():
    assert {type(made) for made in MADE} >= set(FILTERS.values())
    for kind in FILTERS.values():
        assert repr(kind(SIZE)).startswith(f"{kind.__name__}(sensor_size=(7, 5)")
        assert kind.__doc__


def events_at(*t):
    zeros = [0] * len(t)
    return Events(t, zeros, zeros, zeros, WIDE)


def test_reset_and_fresh_forget():
    tar = TAR(WIDE, theta=1.5)
    assert (len(tar(events_at(0, 1))), len(tar.fresh()(events_at(2))), len(tar(events_at(2)))) == (1, 0, 1)
    tar.reset()
    assert len(tar(events_at(0))) == 0


def test_a_chain_has_its_own_state():
    tar = TAR(WIDE, theta=1.5)
    both = chain(tar, Shift(WIDE, 5))
    tar(events_at(0, 0, 0))
    assert (both(events_at(0, 1)).t.tolist(), len(tar(events_at(1)))) == ([6], 1)
    assert chain(both, both).apply(events_at(0, 1, 2)).t.tolist() == [12]


@pytest.mark.parametrize("made", [made for made in MADE if isinstance(made, Chain)], ids=lambda _: "")
def test_a_chain_is_its_filters_one_by_one(made):
    events = random_events(500, WIDE, 75_000)
    step_by_step = events
    for one in made.filters:
        step_by_step = one.apply(step_by_step)
    assert made.apply(events) == step_by_step
    assert len(step_by_step) > 20


def test_metadata_and_size_come_through():
    events = Events(*[np.zeros(1, int)] * 4, WIDE, {"camera": "a"})
    for made in MADE:
        out = made.apply(events)
        assert (out.metadata, out.sensor_size) == ({"camera": "a"}, made.out_size)
        assert made.apply(events[:0]).sensor_size == made.out_size


def test_read_only_and_strided_events():
    events = random_events(100, WIDE)
    for column in (events.t, events.x, events.y, events.p):
        column.setflags(write=False)
    odd = events[::2]
    plain = Events(*(getattr(odd, name).copy() for name in "txyp"), WIDE)
    for made in MADE:
        assert made.apply(odd) == made.apply(plain)
