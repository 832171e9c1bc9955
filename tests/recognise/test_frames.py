"""The front end of frames: segments, what filters see, responses and codes beside their definitions; votes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import convolve2d, correlate2d
from scipy.stats import binomtest

from neuro.apps import evaluate, wilson
from neuro.coding import log_intensity_to_latency
from neuro.events import Events, recordings, save
from neuro_recognise.method import SILENT, choose
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.observations import observe, observed
from neuro_recognise.parts.banks import Counts, Gabors, Leaky, LeakyGabors, LocalMaximum, Sobels, Surface, gabor_bank
from neuro_recognise.parts.frames import Frames, Latency, majority, potentials
from neuro_recognise.recogniser import learn, method_of
from refused import refused

FRONT = Remus().fitting((34, 34))


def responses(events, front=FRONT):
    seen = front.inside(events)
    return front.bank.responses(seen, front.segmenter.bounds(seen.t), front.pool.side)


def spikes(events, front=FRONT):
    """Times, ids and offsets of a recording's frames."""
    seen = front.observe(events)
    offsets = np.concatenate(([0], np.cumsum(seen["lengths"])))
    return front.encoder.times(seen["codes"], {}), seen["ids"].astype(np.int64), offsets


def random_events(n=2000, seed=0, size=(34, 34), low=0):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 100_000, n))
    x, y = (np.clip(rng.normal(side / 2, side / 6, n), low, side - 1).astype(int) for side in size)
    return Events(t, x, y, rng.integers(0, 2, n), size)


def test_banks():
    bank = Gabors().filters
    assert bank.shape == (4, 4, 9, 9)
    np.testing.assert_allclose(bank.sum((2, 3)), 0, atol=1e-12)
    np.testing.assert_allclose((bank**2).sum((2, 3)), 1)
    np.testing.assert_allclose(bank, bank[:, :, ::-1, ::-1])  # even, so turning it changes nothing
    np.testing.assert_allclose(bank[:, 0], bank[:, 2].transpose(0, 2, 1), atol=1e-12)
    assert (bank[0, :, :3] == 0).all()
    bank = gabor_bank([5], [2.0], [2.5], 0.3, [45.0], literal=True)
    x, y, c = 1, -2, np.sqrt(0.5)
    across, along = c * x + c * y, -c * x + c * y
    g = np.exp(-(across**2 + 0.09 * along**2) / 8) * np.cos(2 * np.pi * across / 2.5)
    assert bank[0, 0, 2 + y, 2 + x] == pytest.approx(g)
    plain = gabor_bank([5], [2.0], [2.5], 0.3, [0.0, 45.0], circular=True)
    assert len(np.unique(plain[0, 1][[0, 0, 4, 4], [0, 4, 0, 4]])) == 1  # the corners have minus the mean alone
    np.testing.assert_allclose(plain.sum((2, 3)), 0, atol=1e-12)
    smooth = gabor_bank([5], [2.0], [2.5], 0.3, [0.0, 45.0], circular=True, smooth=True)
    np.testing.assert_allclose(smooth[0, :, 2, 2], plain[0, :, 1:4, 1:4].mean((1, 2)))
    np.testing.assert_allclose(smooth[0, :, 0, 0], plain[0, :, :2, :2].sum((1, 2)) / 9)


def test_sobels_answer_to_a_rise_in_their_direction():
    """Of a plane that rises in a direction, by as much as its slope's share in theirs; the filters of an axis are
    those of Sobel, and wider ones their means."""
    bank = Sobels(sizes=(3, 5)).filters
    assert bank.shape == (2, 8, 5, 5)
    np.testing.assert_allclose(bank[0, 0, 1:4, 1:4] * np.sqrt(12), [[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]])
    np.testing.assert_allclose(bank[0, 2], bank[0, 0].T, atol=1e-12)
    blurred = convolve2d(bank[0, 0, 1:4, 1:4], np.outer([1, 2, 1], [1, 2, 1]))
    np.testing.assert_allclose(bank[1, 0], blurred / np.linalg.norm(blurred), atol=1e-12)
    np.testing.assert_allclose((bank**2).sum((2, 3)), 1)
    y, x = np.mgrid[-2:3, -2:3]
    for o, angle in enumerate(np.deg2rad(Sobels().orientations)):
        answers = (bank * (np.cos(angle) * x + np.sin(angle) * y)).sum((2, 3))
        expected = [np.cos(angle - np.pi / 4 * np.arange(8))] * 2
        np.testing.assert_allclose(answers / answers[:, [o]], expected, atol=1e-12)
    assert refused(Sobels, sizes=(4,)) == "sizes: found 4: expected odd numbers, so that a filter has a middle"
    assert "sizes[0] = 1" in refused(Sobels, sizes=(1,))


@pytest.mark.parametrize(("bank", "scales", "directions"), [("gabors", 4, 4), ("sobel", 1, 8)])
def test_responses_are_correlate_rectify_pool(bank, scales, directions):
    events, front = random_events(), FRONT.changed({"bank": bank})
    bounds, got = front.segmenter.bounds(events.t), responses(events, front)
    assert got.shape == (len(bounds) - 1, scales, directions, 17, 17)
    for f in range(len(got)):
        image = np.zeros((34, 34))
        np.add.at(image, (events.y[bounds[f] : bounds[f + 1]], events.x[bounds[f] : bounds[f + 1]]), 1)
        for s in range(scales):
            for o in range(directions):
                response = np.maximum(correlate2d(image, front.bank.filters[s, o], mode="same"), 0)
                np.testing.assert_allclose(got[f, s, o], response.reshape(17, 2, 17, 2).max((1, 3)), atol=1e-10)


def test_spikes_are_the_code_of_the_strongest_scale():
    events = random_events(seed=2)
    times, ids, offsets = spikes(events)
    assert (times.dtype, offsets.dtype) == ("f8", "i8")
    for f, response in enumerate(responses(events)):
        fused = response.max(0).ravel() / response.max()
        expected = {
            int(i): min(np.floor(log_intensity_to_latency(fused[i], 0.1, 1.0, 64.0)), 63.0)
            for i in np.flatnonzero(fused >= 0.1)
        }
        part = slice(offsets[f], offsets[f + 1])
        assert dict(zip(ids[part].tolist(), times[part].tolist(), strict=True)) == expected
        order = list(zip(times[part], ids[part], strict=True))
        assert (order, times[part][0]) == (sorted(order), 0.0)


@given(st.integers(0, 2**32), st.integers(0, 1500), st.sampled_from([0.5, 1.0, 3.0]))
@settings(max_examples=15, deadline=None)
def test_any_recording(seed, n, resolution):
    times, ids, offsets = spikes(random_events(n, seed), FRONT.changed({"resolution": resolution}))
    assert offsets[0] == 0
    assert offsets[-1] == len(times) == len(ids)
    assert (np.diff(offsets) > 0).all()
    assert ((times >= 0) & (times < 64)).all()
    np.testing.assert_array_equal(times / resolution, np.rint(times / resolution))
    assert ((ids >= 0) & (ids < 4 * 17 * 17)).all()


def test_polarity_does_not_matter_and_few_events_outside_are_left_out():
    events = random_events()
    other = Events(events.t, events.x, events.y, 1 - events.p, events.sensor_size)
    assert all(np.array_equal(a, b) for a, b in zip(spikes(events), spikes(other), strict=True))
    events = random_events(size=(35, 35))
    assert (events.x < 35).all()
    inside = events[(events.x < 34) & (events.y < 34)]
    assert all(np.array_equal(a, b) for a, b in zip(spikes(events), spikes(inside), strict=True))
    assert refused(FRONT.observe, random_events(10, size=(128, 128), low=40)) == (
        "10 of 10 events lie outside of the 34x34 field: expected at most 5%\n"
        "  hint: crop the recording round the object first, train with a larger 'size', or find several objects: "
        "'neuro recognise detect'"
    )


@pytest.fixture
def folder(tmp_path):
    for k in range(4):
        path = tmp_path / "set" / str(k % 2) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(random_events(500 * k, seed=k), path)
    return tmp_path / "set"


def same(a, b):
    arrays = all(
        np.array_equal(one[name], other[name])
        for one, other in zip(a.evidence, b.evidence, strict=True)
        for name in ("codes", "ids", "lengths", "ends")
    )
    return arrays and np.array_equal(a.labels, b.labels) and (a.names, a.classes) == (b.names, b.classes)


def test_kept_spikes_and_a_part_of_them(folder, tmp_path, monkeypatch):
    data, cache = recordings(folder), tmp_path / "cache"
    shown = observe(FRONT, data, cache=cache)
    frames = Frames.of(shown)
    assert (len(shown), shown.labels.tolist()) == (4, [0, 0, 1, 1])
    assert (shown.names, len(frames.offsets)) == (("0/0.bin", "0/2.bin", "1/1.bin", "1/3.bin"), len(frames) + 1)
    assert set(frames.recording.tolist()) == {1, 3}  # the others are too short for a frame
    assert [file.suffix for file in cache.rglob("*") if file.is_file()] == [".h5"]
    with monkeypatch.context() as m:
        m.setattr(Remus, "observe", lambda *_: pytest.fail("computed again"))
        assert same(observe(FRONT.changed({"theta": 20.0, "epochs": 1}), data, cache=cache), shown)
    damaged = next(cache.rglob("*.h5"))
    damaged.unlink()  # what is open is read on
    damaged.write_bytes(b"half a file")
    assert same(observe(FRONT, data, cache=cache), shown)
    observe(FRONT.changed({"min_response": 0.2}), data, cache=cache)
    assert len(list(cache.rglob("*.h5"))) == 2
    data = recordings(folder)
    shown = observe(FRONT, data, cache=tmp_path / "cache")
    part = shown.take([3, 1])
    assert (part.names, part.labels.tolist()) == (("1/3.bin", "0/2.bin"), [1, 0])
    frames = Frames.of(part)
    times, ids, offsets = spikes(data[3].load())
    n = len(offsets) - 1
    assert frames.recording.tolist() == [0] * n + [1] * (len(frames) - n)
    assert np.array_equal(frames.offsets[: n + 1], offsets)
    assert np.array_equal(frames.codes[: offsets[-1]], times)
    assert np.array_equal(frames.ids[: offsets[-1]], ids)
    turned = frames.take(np.arange(len(frames))[::-1])
    assert np.array_equal(turned.codes[-len(times) :][-offsets[1] :], times[: offsets[1]])
    assert np.array_equal(turned.recording, frames.recording[::-1])
    assert same(shown.take(range(4)), shown)
    assert len(Frames.of(shown.take([]))) == 0


@pytest.mark.parametrize("segmenter", ["msd", "hes", "counts", "ses", "whole"])
def test_what_has_been_shown_until_a_time(segmenter):
    """Frames that are cut off a whole recording are those of its beginning alone."""
    front, events = FRONT.changed({"segmenter": segmenter}), random_events(4000, seed=3)
    times = [0, 20_000, 50_000, 70_001, 10**6]
    for us, found in zip(times, front.observe_until(events, times), strict=True):
        alone = front.observe(events[: int(np.searchsorted(events.t, events.t[0] + us, "right"))])
        assert all(np.array_equal(found[name], alone[name]) for name in ("codes", "ids", "lengths", "ends"))
    assert len(found["lengths"])


def test_the_first_spikes_of_a_frame():
    every, few = (FRONT.changed({"first": n}).observe(random_events()) for n in (0, 20))
    starts = np.cumsum(every["lengths"]) - every["lengths"]
    assert (few["lengths"] == 20).all()
    assert (every["lengths"] > 20).all()
    for name in ("codes", "ids"):
        assert np.array_equal(few[name], np.concatenate([every[name][a : a + 20] for a in starts]))


def test_all_scales_merged_are_the_spikes_of_each_scale():
    """Those of each scale by itself, scaled by the largest response of the frame, in the order of their ticks."""
    values = responses(random_events())
    codes, ids, lengths = FRONT.encoder.encode(values)
    all_codes, all_ids, all_lengths = replace(FRONT.encoder, scales="all").encode(values)
    ends, all_ends = np.cumsum(lengths), np.cumsum(all_lengths)
    for k, frame in enumerate(values):
        one = slice(ends[k] - lengths[k], ends[k])
        every = slice(all_ends[k] - all_lengths[k], all_ends[k])
        merged = sorted(zip(all_codes[every].tolist(), all_ids[every].tolist(), strict=True))
        assert merged == list(zip(all_codes[every].tolist(), all_ids[every].tolist(), strict=True))
        relative = (frame / frame.max()).reshape(len(frame), -1)
        scale, place = np.nonzero(relative >= 0.1)
        ticks = np.minimum(log_intensity_to_latency(relative[scale, place], 0.1, 1.0, 64.0) // 1.0, 63)
        assert merged == sorted(zip(ticks.astype(int).tolist(), place.tolist(), strict=True))
        # The first spike of a place is that of its strongest scale.
        first = {place: tick for tick, place in reversed(merged)}
        assert first == dict(zip(ids[one].tolist(), codes[one].tolist(), strict=True))


def test_each_filter_codes_between_its_smallest_and_its_largest_response():
    """Line 3722 of the thesis: spikes of each filter by itself are eq. 15, then all are merged."""
    front = FRONT.changed({"scales": "all", "ranges": "filter", "literal": True})
    values = responses(random_events(), front)
    values[0, 0, 0] = np.where(values[0, 0, 0] > 0, 3.0, 0.0)
    values[0, 0, 1][values[0, 0, 1] < values[0, 0, 1].max()] *= 1e-10
    codes, ids, lengths = front.encoder.encode(values)
    ends = np.cumsum(lengths)
    for k, frame in enumerate(values):
        every = slice(ends[k] - lengths[k], ends[k])
        expected = []
        for scale, orientation in np.ndindex(4, 4):
            response = frame[scale, orientation]
            spiking = response > 1e-9 * response.max()
            low, high = response[spiking].min(), response.max()
            ticks = np.zeros(spiking.sum())
            if low < high:
                ticks = np.minimum(log_intensity_to_latency(response[spiking], low, high, 64.0) // 1.0, 63)
            places = orientation * 17 * 17 + np.flatnonzero(spiking)
            expected += zip(ticks.astype(int).tolist(), places.tolist(), strict=True)
        assert list(zip(codes[every].tolist(), ids[every].tolist(), strict=True)) == sorted(expected)
    assert [len(each) for each in front.encoder.encode(np.zeros((2, 4, 4, 17, 17)))] == [0, 0, 2]


def test_features_name_the_recording(tmp_path):
    (tmp_path / "set" / "a").mkdir(parents=True)
    save(random_events(10, size=(128, 128), low=40), tmp_path / "set" / "a" / "1.bin")
    message = refused(observe, FRONT, recordings(tmp_path / "set"), cache=tmp_path / "cache")
    assert message.startswith(f"{tmp_path}/set/a/1.bin: 10 of 10 events lie outside of the 34x34 field")


def test_real_recordings(shared):
    data = recordings(shared / "data" / "nmnist" / "nmnist_train1000_bin.zip")
    frames, counts = [], []
    for item in data[::40]:
        lengths = FRONT.observe(item.load())["lengths"]
        frames.append(len(lengths))
        counts.append(lengths.mean())
    assert 17 < np.mean(frames) < 22
    assert 350 < np.mean(counts) < 480


@pytest.mark.parametrize(("signed", "side"), [(False, 1), (True, 1), (False, 2)])
def test_responses_leak(signed, side):
    bank = LeakyGabors(sizes=(3, 5), sigmas=(1.2, 2.0), wavelengths=(1.5, 2.5), leak=0.02, signed=signed)
    events, bounds = random_events(300, size=(14, 14)), np.array([0, 120, 120, 250])
    found = bank.responses(events, bounds, side)
    assert found.shape == (3, 2, 4, 14 // side, 14 // side)
    maps, last, at = np.zeros((2, 4, 14 + 8, 14 + 8)), 0, {}
    for k in range(250):
        maps = np.sign(maps) * np.maximum(np.abs(maps) - 2e-5 * (events.t[k] - last), 0.0)
        last, y, x = events.t[k], events.y[k] + 4, events.x[k] + 4
        maps[:, :, y - 2 : y + 3, x - 2 : x + 3] += (-1 if signed and not events.p[k] else 1) * bank.filters
        at[k + 1] = np.abs(maps[:, :, 4:-4, 4:-4])
    for frame, end in enumerate(bounds[1:]):
        expected = at[end].reshape(2, 4, 14 // side, side, 14 // side, side).max((3, 5))
        np.testing.assert_allclose(found[frame], expected, atol=1e-9)


def test_local_maxima():
    pool, rng = LocalMaximum(least=0.3), np.random.default_rng(1)
    responses, sizes = rng.random((2, 2, 3, 9, 8)), (3, 5)
    found = pool.passed(responses, sizes)
    for f, s, o, i, j in np.ndindex(responses.shape):
        reach = sizes[s] // 2
        around = responses[f, s, o, max(0, i - reach) : i + reach + 1, max(0, j - reach) : j + reach + 1]
        here = responses[f, s, o, i, j]
        assert found[f, s, o, i, j] == (here if here >= 0.3 and here == around.max() else 0.0)


def test_latencies():
    encoder, responses = Latency(first=3, window=10.0), np.zeros((2, 2, 1, 1, 3))
    responses[0] = np.array([0.5, 0.0, 2.0, 2.0, 0.1, 1.0]).reshape(2, 1, 1, 3)
    codes, ids, lengths = encoder.encode(responses)
    assert (codes.tolist(), ids.tolist(), lengths.tolist()) == ([2.0, 2.0, 1.0], [2, 3, 5], [3, 0])
    assert encoder.channels(2, 1) == 2
    learnt = encoder.learn(codes)
    assert encoder.times(codes, learnt).tolist() == [0.0, 0.0, 5.0]
    late = encoder.times(np.array([4.0, 0.001]), learnt)
    assert late.tolist() == [0.0, 9.0], "stronger than all before; the last tick"


def test_votes():
    wins = np.array([[3, 1, 0], [2, 2, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]])
    sums = np.array([[5.0, 9.0, 0.0], [1.0, 2.0, 9.0], [0.0, 1.0, 0.5], [0.0, 0.0, 0.0], [4.0, 1.0, 0.0]])
    assert choose(majority(wins, sums)).tolist() == [0, 1, SILENT, SILENT, 0]
    assert choose(potentials(sums)).tolist() == [1, 2, 1, SILENT, 0]
    np.testing.assert_allclose(majority(wins, sums)[1], [2, 2 + 1 / 3, 2 / 3])  # the whole part are frames
    found = evaluate(np.array([0, 1, 1, -1]), np.array([0, 1, 0, 1]), ("a", "b"))
    assert (found.confusion.tolist(), found.n, found.correct, found.accuracy) == ([[1, 1, 0], [0, 1, 1]], 4, 2, 0.5)
    assert found.as_words()["silent"] == 1
    assert evaluate(np.array([], int), np.array([], int), ("a",)).interval == (0.0, 1.0)


@given(st.lists(st.tuples(st.integers(0, 4), st.sampled_from([-1.0, 0.0, 0.5, 2.0])), min_size=2, max_size=5))
def test_equals_are_told_apart_by_their_sums(classes):
    wins, sums = (np.array([column], float) for column in zip(*classes, strict=True))
    found = majority(wins, sums)
    if not wins.any():
        assert np.isnan(found).all()
        return
    assert np.array_equal(np.floor(found), wins)
    assert choose(found)[0] == max(range(len(classes)), key=lambda k: (wins[0, k], sums[0, k], -k))


@given(st.data(), st.integers(1, 5000))
def test_wilson_is_scipys(data, n):
    correct = data.draw(st.integers(0, n))
    expected = binomtest(correct, n).proportion_ci(method="wilson")
    assert wilson(correct, n) == pytest.approx((expected.low, expected.high), abs=1e-12)


SIZE = (9, 7)


def some(seed, n=120, length=60_000):
    """Events, some at the same time, with a long pause."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, length, n) // 500 * 500)
    t = np.where(t > length // 2, t + 900_000, t)
    return Events(t, rng.integers(0, 9, n), rng.integers(0, 7, n), rng.integers(0, 2, n), SIZE)


@given(seed=st.integers(0, 99), cuts=st.lists(st.integers(1, 120), min_size=1, max_size=8))
@settings(max_examples=25, deadline=None)
@pytest.mark.parametrize("seen", [Counts(), Leaky(tau=8.0), Surface(tau=8.0)])
def test_by_hand(seen, seed, cuts):
    """Segments may be empty or end amid events of one time, which their places then tell apart."""
    events, bounds, expected = some(seed), np.array([0, *sorted(cuts)]), np.zeros((len(cuts), 7, 9))
    for k, (begin, end) in enumerate(pairwise(bounds)):
        for i in range(begin if seen == Counts() else 0, end):
            share = 1.0 if seen == Counts() else np.exp((events.t[i] - events.t[end - 1]) / 8000.0)
            place = (k, events.y[i], events.x[i])
            expected[place] = share if isinstance(seen, Surface) else expected[place] + share
    found = seen.pixels(events, bounds)
    np.testing.assert_allclose(found.pictures(SIZE), expected, rtol=1e-12, atol=1e-30)
    assert (found.value > 0).all()


@pytest.mark.parametrize("name", ["counts", "leaky", "surface"])
def test_of_nothing(name):
    method = Remus().changed({"representation": name, "size": [34, 34]})
    assert [len(part) for part in method.representation.pixels(some(0)[:0], np.array([0]))] == [0, 0, 0, 1]
    assert len(method.observe(Events([], [], [], [], (34, 34)))["ends"]) == 0


def moving(label, seed, n=1500):
    """A bar that stands or lies, and moves across a small field in 90 ms."""
    rng = np.random.default_rng([seed, label])
    t = np.sort(rng.integers(0, 90_000, n))
    along, across = rng.integers(4, 14, n), 4 + t * 8 // 90_000 + rng.integers(0, 2, n)
    x, y = (across, along) if label else (along, across)
    return Events(t, x, y, rng.integers(0, 2, n), (18, 18))


NET = {"epochs": 2, "field": 5, "theta": 12.0, "per_class": 2, "size": [18, 18]}


@pytest.fixture(scope="module")
def early():
    method = method_of("remus", "early", NET)
    shown = observed(method, [moving(k % 2, k) for k in range(16)], ("lying", "standing"))
    return learn(method, replace(shown, labels=np.arange(16) % 2), "")


def test_the_preset_by_words(early):
    words = {"representation": "leaky", "segmenter": "hes", "segmenter.window": 5}
    assert Remus().changed({**words, **NET}) == early.method


@pytest.mark.parametrize("name", ["leaky", "surface"])
def test_early_decisions_look_at_nothing_later(early, name):
    """Also of a net that learnt from other frames: what precedes it may be changed."""
    recogniser = early.changed({"representation": name})
    for label in (0, 1):
        events, times = moving(label, 50), [3.0, 5.5, 20.0, 60.0, 1000.0]
        scores = recogniser.scores_at(events, times)
        for time, row in zip(times, scores, strict=True):
            np.testing.assert_array_equal(recogniser.scores(events[events.t <= events.t[0] + 1000 * time])[0], row)
        assert np.isnan(scores[0]).all()  # no segment is complete
        assert scores[1:].argmax(axis=1).tolist() == [label] * 4
        session = recogniser.session(every_ms=10.0, window_ms=100.0)
        decided = session.feed(events) + session.end()
        np.testing.assert_array_equal(
            [one.scores for one in decided], recogniser.scores_at(events, [one.after_ms for one in decided])
        )


def test_what_can_be_changed_after_training(early):
    """How recordings are cut and seen, not what the network was made for."""
    assert early.changed({}) is early
    frames = early.changed({"representation": "counts", "segmenter": "msd", "threshold": 40.0})
    assert frames.learnt is early.learnt
    assert [frames.predict(moving(label, 60))[0] for label in (0, 1)] == [0, 1]
    assert "'layer' cannot be changed after training" in refused(early.changed, {"theta": 3.0})
