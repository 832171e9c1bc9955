"""Cut anywhere, the parts give what the whole gives; and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.events import Events
from neuro.events.filters import (
    FILTERS,
    TAR,
    BackgroundActivity,
    Chain,
    Crop,
    Downsample,
    FilterError,
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

SIZE = (9, 6)
MADE = [
    TAR(SIZE, tau=0.002, theta=1.5),
    TAR(SIZE, tau=0.002, theta=3.0, radius=2, first=7),
    TARSurfaces(SIZE, tau=0.002, theta=1.5, cell=4),
    TARSurfaces(SIZE, tau=1e-6, theta=1.5),
    BackgroundActivity(SIZE, dt_us=900),
    Refractory(SIZE, period_us=3000),
    Refractory(SIZE, period_us=3000, extend=True),
    HotPixels(SIZE, [(3, 2), (8, 5)]),
    Polarity(SIZE, keep=0),
    Crop(SIZE, x=(2, 7), y=(0, 4)),
    Downsample(SIZE, factor=2),
    Downsample(SIZE, factor=(4, 3), integrate=3),
    Shift(SIZE, by_us=11),
    Shift(SIZE, to_us=0),
    Scale(SIZE, factor=0.37),
    Reverse(SIZE),
    Jitter(SIZE, amount_us=2500, seed=3),
    Flip(SIZE),
    Rotate90(SIZE, turns=3),
    Transpose(SIZE),
    ShotNoise(SIZE, rate_hz=40.0, seed=5),
    chain(Jitter(SIZE, 700), Crop(SIZE, x=(1, 8)), Reverse((7, 6)), TAR((7, 6), tau=0.002, theta=1.2)),
    chain(ShotNoise(SIZE, 30.0), BackgroundActivity(SIZE, 800), Jitter(SIZE, 3000, seed=1), Downsample(SIZE, 3, 2)),
]


def joined(parts):
    parts = list(parts)
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
    return Events(*columns, parts[0].sensor_size)


@st.composite
def cut_recordings(draw):
    n = draw(st.integers(0, 300))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    start = draw(st.sampled_from([0, -5000, 10**12]))
    t = start + np.cumsum(rng.integers(0, draw(st.sampled_from([2, 60, 2000])), n))
    events = Events(t, rng.integers(0, 9, n), rng.integers(0, 6, n), rng.integers(0, 2, n), SIZE)
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=12)))
    return events, [events[a:b] for a, b in zip([0, *cuts], [*cuts, n], strict=True)]


@pytest.mark.parametrize("made", MADE, ids=str)
@settings(max_examples=20, deadline=None)
@given(recording=cut_recordings())
def test_cutting_does_not_matter(made, recording):
    events, parts = recording
    made.reset()
    whole = made(events)
    rest = made.finish()
    assert joined(made(part) for part in parts) == whole
    assert made.finish() == rest
    assert joined([whole, rest]) == made.apply(events)
    assert joined([whole[:0], *made.stream(parts)]) == made.apply(events)


def test_surfaces_do_not_depend_on_the_cuts():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.integers(0, 300, 500))
    events = Events(t, rng.integers(0, 9, 500), rng.integers(0, 6, 500), rng.integers(0, 2, 500), SIZE)
    whole, parts = TARSurfaces(SIZE, tau=2e-6), TARSurfaces(SIZE, tau=2e-6)
    whole(events)
    for k in range(0, 500, 7):
        parts(events[k : k + 7])
    assert np.array_equal(whole.histograms(), parts.histograms())


def test_every_filter_is_tested():
    assert {type(made) for made in MADE} >= set(FILTERS.values())


def events_at(*t, size=SIZE):
    zeros = np.zeros(len(t), int)
    return Events(np.array(t, dtype=np.int64), zeros, zeros, zeros, size)


def test_reset_and_fresh_forget():
    tar = TAR(SIZE, theta=1.5)
    assert len(tar(events_at(0, 1))) == 1
    assert len(tar.fresh()(events_at(2))) == 0
    assert len(tar(events_at(2))) == 1
    tar.reset()
    assert len(tar(events_at(0))) == 0


def test_a_chain_has_its_own_state():
    tar = TAR(SIZE, theta=1.5)
    both = chain(tar, Shift(SIZE, 5))
    tar(events_at(0, 0, 0))
    assert both(events_at(0, 1)).t.tolist() == [6]
    assert len(tar(events_at(1))) == 1
    assert chain(both, both).apply(events_at(0, 1, 2)).t.tolist() == [12]


@pytest.mark.parametrize("made", [made for made in MADE if isinstance(made, Chain)], ids=lambda _: "")
def test_a_chain_is_its_filters_one_by_one(made):
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.integers(0, 300, 500))
    events = Events(t, rng.integers(0, 9, 500), rng.integers(0, 6, 500), rng.integers(0, 2, 500), SIZE)
    step_by_step = events
    for one in made.filters:
        step_by_step = one.apply(step_by_step)
    assert made.apply(events) == step_by_step
    assert len(step_by_step) > 20


def test_metadata_and_size_come_through():
    events = Events(*[np.zeros(1, int)] * 4, SIZE, {"camera": "a"})
    for made in MADE:
        out = made.apply(events)
        assert out.metadata == {"camera": "a"}
        assert out.sensor_size == made.out_size
        assert made.apply(events[:0]).sensor_size == made.out_size


def test_read_only_and_strided_events():
    t = np.arange(100)
    events = Events(t, t % 9, t % 6, t % 2, SIZE)
    for column in (events.t, events.x, events.y, events.p):
        column.setflags(write=False)
    odd = events[::2]
    plain = Events(*(getattr(odd, name).copy() for name in "txyp"), SIZE)
    for made in MADE:
        assert made.apply(odd) == made.apply(plain)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TAR(SIZE, tau=0.0), "TAR: tau = 0: expected a number > 0 s"),
        (lambda: TAR(SIZE, tau=float("nan")), "TAR: tau = .nan: expected a finite number > 0 s"),
        (lambda: TAR(SIZE, theta=-1), "TAR: theta = -1: expected a number > 0 events"),
        (lambda: TAR(SIZE, radius=1.5), "TAR: radius = 1.5: expected a whole number >= 0"),
        (lambda: TAR(SIZE, first=-1), "TAR: first = -1: expected a whole number >= 0"),
        (lambda: TAR((0, 3)), "TAR: sensor_size = (0, 3): expected width and height of 1 to 65536 px"),
        (lambda: TARSurfaces(SIZE, cell=0), "TARSurfaces: cell = 0: expected a whole number >= 1"),
        (
            lambda: TARSurfaces(SIZE, tau="1"),
            "TARSurfaces: tau = '1': expected a number > 0 s\n  hint: write 1 without quotes",
        ),
        (
            lambda: BackgroundActivity(SIZE, -1),
            "BackgroundActivity: dt_us = -1: expected a whole number of us from 0 to 2^63 - 1",
        ),
        (
            lambda: Refractory(SIZE, True),
            "Refractory: period_us = true: expected a whole number of us from 0 to 2^63 - 1",
        ),
        (lambda: Refractory(SIZE, 1, 2), "Refractory: extend = 2: expected true or false"),
        (lambda: HotPixels(SIZE, [(1, 6)]), "HotPixels: pixel (1, 6), expected one of the 9x6 sensor"),
        (lambda: HotPixels(SIZE, [(-1, 0)]), "HotPixels: pixel (-1, 0), expected one of the 9x6 sensor"),
        (lambda: HotPixels(SIZE, [3]), "HotPixels: pixels = [3]: expected pairs of column and row, whole numbers"),
        (lambda: Polarity(SIZE, 2), "Polarity: keep = 2: expected a whole number >= 0 and <= 1"),
        (lambda: Crop(SIZE, x=(3, 3)), "Crop: x = (3, 3): expected (first, after the last) within 0 to 9 px"),
        (lambda: Crop(SIZE, y=(0, 7)), "Crop: y = (0, 7): expected (first, after the last) within 0 to 6 px"),
        (lambda: Crop(SIZE, move=1), "Crop: move = 1: expected true or false"),
        (lambda: Downsample(SIZE, 0), "Downsample: factor = 0: expected a whole number >= 1 or a pair of them"),
        (lambda: Downsample(SIZE, 2, 0), "Downsample: integrate = 0: expected a whole number >= 1"),
        (lambda: Shift(SIZE, 0.5), "Shift: by_us = 0.5: expected a whole number of us from -2^63 to 2^63 - 1"),
        (lambda: Shift(SIZE, 1, 2), "Shift: by_us = 1: expected 0 where to_us is given"),
        (lambda: Scale(SIZE, -1.0), "Scale: factor = -1: expected a number > 0"),
        (lambda: Reverse(SIZE, None), "Reverse: invert has no value: expected true or false"),
        (lambda: Jitter(SIZE, -1), "Jitter: amount_us = -1: expected a whole number of us from 0 to 2^63 - 1"),
        (lambda: Jitter(SIZE, 1, -1), "Jitter: seed = -1: expected a whole number >= 0 and <= 9223372036854775807"),
        (lambda: Flip(SIZE, "z"), "Flip: axis = 'z': expected one of x, y\n  hint: known: x, y"),
        (lambda: Rotate90(SIZE, 0.5), "Rotate90: turns = 0.5: expected a whole number"),
        (lambda: ShotNoise(SIZE, 0), "ShotNoise: rate_hz = 0: expected a number > 0 Hz"),
        (lambda: chain(), "Chain: filters = (): expected at least one"),
        (lambda: chain(len), "Chain: filter 0 is <built-in function len>, expected a filter such as TAR((346, 260))"),
        (lambda: chain(Transpose(SIZE), Flip(SIZE)), "Chain: filter 1, Flip, is for 9x6, expected 6x9"),
        (lambda: hot_pixels([], times=0), "hot_pixels: times = 0: expected a number > 0"),
        (lambda: hot_pixels([], above_hz=-1), "hot_pixels: above_hz = -1: expected a number > 0"),
        (
            lambda: hot_pixels([events_at(0), events_at(1, size=(3, 3))]),
            "hot_pixels: events of a 3x3 sensor, expected 9x6",
        ),
        (
            lambda: hot_pixels(events_at(5, 5), above_hz=1.0),
            "hot_pixels: all events have one time, expected a recording that lasts, for above_hz",
        ),
        (lambda: Flip(SIZE)(events_at(0, size=(6, 9))), "Flip: events of a 6x9 sensor, expected 9x6"),
        (
            lambda: list(Flip(SIZE).stream([events_at(5), events_at(4)])),
            "Flip: time runs back from 5 to 4 us, expected the next part of the same recording; reset() before another "
            "one",
        ),
        (
            lambda: Shift(SIZE, 10).apply(events_at(2**63 - 5)),
            "Shift: 9223372036854775803 us moved by 10 us, expected a time that 64 bits can hold",
        ),
        (
            lambda: Scale(SIZE, 2.0).apply(events_at(0, 2**52)),
            "Scale: 4503599627370496 us is too far from the origin at 0 us for a factor of 2.0, expected a product "
            "below 2^53 us, which is exact",
        ),
        (
            lambda: ShotNoise(SIZE, 1.0).apply(events_at(0, 10**15)),
            "ShotNoise: 1000000000000001 us would get 5.4e+10 noise events, expected at most 268435456 in one part; "
            "cut the recording, or look for a jump in its times",
        ),
    ],
)
def test_messages(make, message):
    with pytest.raises(FilterError) as error:
        make()
    assert str(error.value) == message
