import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import convolve2d

from neuro.coding import log_intensity_to_latency
from neuro.events import EventFileError, Events, recordings, save
from neuro_remus.features import c1_spikes
from neuro_remus.frontend import FrontEnd
from neuro_remus.gabor import gabor_bank


def random_events(n=2000, seed=0, size=(34, 34), low=0):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 100_000, n))
    x, y = (np.clip(rng.normal(side / 2, side / 6, n), low, side - 1).astype(int) for side in size)
    return Events(t, x, y, rng.integers(0, 2, n), size)


def bar(angle, n=400):
    """Events on a line through the middle; 0 is vertical, 45 falls to the left (y points down)."""
    r = np.random.default_rng(1).uniform(-10, 10, n)
    x, y = 17 - np.sin(np.deg2rad(angle)) * r, 17 + np.cos(np.deg2rad(angle)) * r
    return Events(np.arange(n), np.rint(x).astype(int), np.rint(y).astype(int), np.ones(n, int), (34, 34))


def test_bank_is_normal():
    bank = FrontEnd().bank
    assert bank.shape == (4, 4, 9, 9)
    np.testing.assert_allclose(bank.sum((2, 3)), 0, atol=1e-12)
    np.testing.assert_allclose((bank**2).sum((2, 3)), 1)
    np.testing.assert_allclose(bank, bank[:, :, ::-1, ::-1])  # even, so turning it changes nothing
    np.testing.assert_allclose(bank[:, 0], bank[:, 2].transpose(0, 2, 1), atol=1e-12)
    assert (bank[0, :, :3] == 0).all()


def test_literal_gabor_is_the_equation():
    bank = gabor_bank([5], [2.0], [2.5], 0.3, [45.0], literal=True)
    x, y, c = 1, -2, np.sqrt(0.5)
    across, along = c * x + c * y, -c * x + c * y
    g = np.exp(-(across**2 + 0.09 * along**2) / 8) * np.cos(2 * np.pi * across / 2.5)
    assert bank[0, 0, 2 + y, 2 + x] == pytest.approx(g)


def test_responses_are_convolve_rectify_pool():
    front = FrontEnd()
    events = random_events()
    bounds = front.frames(events)[1]
    got = front.responses(events)
    assert got.shape == (len(bounds) - 1, 4, 4, 17, 17)
    for f in range(len(got)):
        image = np.zeros((34, 34))
        np.add.at(image, (events.y[bounds[f] : bounds[f + 1]], events.x[bounds[f] : bounds[f + 1]]), 1)
        for s in range(4):
            for o in range(4):
                response = np.maximum(convolve2d(image, front.bank[s, o], mode="same"), 0)
                pooled = response.reshape(17, 2, 17, 2).max((1, 3))
                np.testing.assert_allclose(got[f, s, o], pooled, atol=1e-10)


def test_spikes_are_the_code_of_the_strongest_scale():
    front = FrontEnd()
    events = random_events(seed=2)
    times, ids, offsets = front.spikes(events)
    responses = front.responses(events)
    assert (times.dtype, ids.dtype, offsets.dtype) == ("f8", "i8", "i8")
    for f, response in enumerate(responses):
        fused = response.max(0).ravel() / response.max()
        expected = {
            int(i): min(np.floor(log_intensity_to_latency(fused[i], 0.1, 1.0, 64.0)), 63.0)
            for i in np.flatnonzero(fused >= 0.1)
        }
        part = slice(offsets[f], offsets[f + 1])
        assert dict(zip(ids[part].tolist(), times[part].tolist(), strict=True)) == expected
        order = list(zip(times[part], ids[part], strict=True))
        assert order == sorted(order)
        assert times[part][0] == 0.0


@given(st.integers(0, 2**32), st.integers(0, 1500), st.sampled_from([0.5, 1.0, 3.0]))
@settings(max_examples=25, deadline=None)
def test_any_recording(seed, n, resolution):
    front = FrontEnd(resolution=resolution)
    times, ids, offsets = front.spikes(random_events(n, seed))
    assert offsets[0] == 0
    assert offsets[-1] == len(times) == len(ids)
    assert (np.diff(offsets) > 0).all()
    assert ((times >= 0) & (times < 64)).all()
    np.testing.assert_array_equal(times / resolution, np.rint(times / resolution))
    assert ((ids >= 0) & (ids < 4 * 17 * 17)).all()


@pytest.mark.parametrize(("orientation", "angle"), [(0, 0.0), (1, 45.0), (2, 90.0), (3, 135.0)])
def test_orientations(orientation, angle):
    front = FrontEnd(theta_msd=100.0)
    responses = front.responses(bar(angle))[0]
    assert responses.max((0, 2, 3)).argmax() == orientation


def test_polarity_does_not_matter():
    events = random_events()
    other = Events(events.t, events.x, events.y, 1 - events.p, events.sensor_size)
    for a, b in zip(FrontEnd().spikes(events), FrontEnd().spikes(other), strict=True):
        assert np.array_equal(a, b)


def test_a_few_events_outside_are_left_out():
    events = random_events(size=(35, 35))
    assert (events.x < 35).all()
    inside = events[(events.x < 34) & (events.y < 34)]
    for a, b in zip(FrontEnd().spikes(events), FrontEnd().spikes(inside), strict=True):
        assert np.array_equal(a, b)
    with pytest.raises(ValueError) as error:  # noqa: PT011 (the text is compared below)
        FrontEnd().spikes(random_events(10, size=(128, 128), low=40))
    assert str(error.value) == (
        "10 of 10 events lie outside of the 34x34 field that is looked at, expected at most 5%; "
        "crop the recording round the object first"
    )


@pytest.fixture
def folder(tmp_path):
    for k in range(4):
        path = tmp_path / "set" / str(k % 2) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(random_events(500 * k, seed=k), path)
    return tmp_path / "set"


def same(a, b):
    arrays = all(np.array_equal(getattr(a, k), getattr(b, k)) for k in ("times", "ids", "offsets", "sample", "labels"))
    return arrays and (a.names, a.classes, a.shape) == (b.names, b.classes, b.shape)


def test_features_are_kept(folder, tmp_path, monkeypatch):
    data, cache = recordings(folder), tmp_path / "cache"
    spikes = c1_spikes(data, cache=cache, progress=False)
    assert len(spikes) == 4
    assert spikes.labels.tolist() == [0, 0, 1, 1]
    assert spikes.names == ("0/0.bin", "0/2.bin", "1/1.bin", "1/3.bin")
    assert len(spikes.offsets) == len(spikes.sample) + 1
    assert set(spikes.sample.tolist()) == {1, 3}  # the others are too short for a frame
    assert [file.suffix for file in cache.iterdir()] == [".h5"]
    with monkeypatch.context() as m:
        m.setattr(FrontEnd, "spikes", lambda *_: pytest.fail("computed again"))
        assert same(c1_spikes(data, cache=cache, progress=False), spikes)
    next(cache.iterdir()).write_bytes(b"half a file")
    assert same(c1_spikes(data, cache=cache, progress=False), spikes)
    c1_spikes(data, FrontEnd(min_response=0.2), cache=cache, progress=False)
    assert len(list(cache.iterdir())) == 2


def test_take(folder, tmp_path):
    data = recordings(folder)
    spikes = c1_spikes(data, cache=tmp_path / "cache", progress=False)
    part = spikes.take([3, 1])
    assert part.names == ("1/3.bin", "0/2.bin")
    assert part.labels.tolist() == [1, 0]
    first = part.offsets[np.searchsorted(part.sample, [0, 1])]
    times, ids, offsets = FrontEnd().spikes(data[3].load())
    assert np.array_equal(part.times[first[0] : first[1]], times)
    assert np.array_equal(part.ids[first[0] : first[1]], ids)
    assert part.sample.tolist() == [0] * (len(offsets) - 1) + [1] * (len(part.sample) - len(offsets) + 1)
    assert same(spikes.take(range(4)), spikes)
    assert len(spikes.take([]).times) == 0


def test_features_name_the_recording(tmp_path):
    (tmp_path / "set" / "a").mkdir(parents=True)
    save(random_events(10, size=(128, 128), low=40), tmp_path / "set" / "a" / "1.bin")
    with pytest.raises(EventFileError) as error:
        c1_spikes(recordings(tmp_path / "set"), cache=tmp_path / "cache", progress=False)
    assert str(error.value).startswith(f"{tmp_path}/set/a/1.bin: 10 of 10 events lie outside of the 34x34 field")


def test_real_recordings(shared):
    data = recordings(shared / "data" / "nmnist" / "nmnist_train1000_bin.zip")
    front = FrontEnd()
    frames, spikes = [], []
    for item in data[::20]:
        times, _, offsets = front.spikes(item.load())
        frames.append(len(offsets) - 1)
        spikes.append(len(times) / frames[-1])
    assert 17 < np.mean(frames) < 22
    assert 350 < np.mean(spikes) < 480
