"""`stream` from some time on gives what decoding all and leaving out gives."""

import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

import neuro.events.files as files
from neuro.events import EVENT, EventFileError, Events, load, save, stream
from neuro.events.formats._reading import SeekPoint, seek_point

SIZE = (128, 128)
ENDINGS = {"dat": ".dat", "aedat2": ".aedat", "evt2": ".raw", "evt3": ".raw", "hdf5": ".h5"}
PERIODS = {"dat": 1 << 32, "aedat2": 1 << 32, "evt2": 1 << 34, "evt3": 1 << 24}
NAMES = [*ENDINGS, "evt21", "rows", "ns"]


def events_of(seed, n, steps):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice(steps, n))
    x = np.cumsum(rng.integers(0, 3, n)) % 128  # neighbours, so that EVT 3.0 has vectors
    return Events(t, x, rng.integers(0, 128, n) if seed % 2 else np.full(n, 7), rng.integers(0, 2, n), SIZE)


def written(events, name):
    """The bytes of a file, times beyond its clock begun again at 0."""
    if name == "evt21":
        return evt21(events)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a"
        if name in ENDINGS:
            path = path.with_suffix(ENDINGS[name])
            save(events, path, format=name)
        else:
            table(events, name, path)
        return path.read_bytes()


def table(events, name, path):
    with h5py.File(path, "w") as file:
        if name == "rows":
            fields = [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")]
            rows = np.array(list(zip(events.x, events.y, events.p, events.t, strict=True)), fields)
            file.create_dataset("CD/events", data=rows, chunks=(16,), maxshape=(None,))
            file.attrs["geometry"] = "128x128"
        else:
            group = file.create_group("events")
            group.attrs["sensor_size"] = SIZE
            for key in "txyp":
                values = events.t * 1000 - 300 if key == "t" else getattr(events, key)
                group.create_dataset("t_ns" if key == "t" else key, data=values, chunks=(16,), maxshape=(None,))


def evt21(events):
    words, high = [], -1
    for t, x, y, p in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True):
        if t >> 6 != high:
            high = t >> 6
            words.append(8 << 60 | (high & (1 << 28) - 1) << 32)
        words.append(p << 60 | (t & 63) << 54 | (x & ~31) << 43 | y << 32 | 1 << (x & 31))
    return b"% evt 2.1\n% geometry 128x128\n% end\n" + np.array(words, "<u8").tobytes()


def streamed(data, format, whole, block=512, **options):
    """What is read from the parts, and the message of the error after them; `whole`: all is decoded."""
    format = {"rows": "hdf5", "ns": "hdf5"}.get(format, format)
    with pytest.MonkeyPatch.context() as patch:
        if whole:
            patch.setattr(files.Opened, "can_seek", lambda self: False)
        patch.setattr(files, "BLOCK", block)
        parts, error = [np.zeros(0, EVENT)], None
        try:
            parts += [part.records() for part in stream(data, format=format, **options)]
        except EventFileError as found:
            error = str(found)
    return np.concatenate(parts), error


STEPS = st.sampled_from([(0, 1, 30), (1,), (0, 0, 0, 5000), (100, 4096), (0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 9_000_000)])


@pytest.mark.parametrize("name", NAMES)
def test_the_same_as_to_leave_out(name):
    @given(st.integers(0, 99), st.integers(0, 1500), STEPS, st.floats(-0.1, 1.1), st.integers(-70, 70), st.booleans())
    @settings(max_examples=12, suppress_health_check=list(HealthCheck))
    @example(0, 1500, (0, 0, 0, 5000), 0.9, 1, False)
    def run(seed, n, steps, share, shift, exact):
        events = events_of(seed, n, steps)
        data, start = written(events, name), int(share * (events.t[-1] if n else 5)) + shift
        if exact and n:
            start = int(events.t[seed % n])
        for options in ({}, {"count": 100}, {"stop_us": start + 3000}):
            found = streamed(data, name, False, start_us=start, **options)
            expected = streamed(data, name, True, start_us=start, **options)
            assert np.array_equal(found[0], expected[0])
            assert found[1] is expected[1] is None

    run()


@pytest.mark.parametrize("name", NAMES)
def test_less_is_decoded(name):
    """The last events are had without most of those before."""
    events = events_of(1, 20_000, (1, 2, 3))
    data, format = written(events, name), {"rows": "hdf5", "ns": "hdf5"}.get(name, name)
    file = files.opened(data, format, "a")
    t = np.concatenate([piece.t for piece in file.pieces(4096, True, int(events.t[-10]))])
    assert name == "hdf5" or t.size < 4000  # of this library's chunks there is only one
    assert np.array_equal(t[-10:], events.t[-10:])


@pytest.mark.parametrize("name", PERIODS)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.95])
def test_a_clock_that_begins_again(name, share):
    """Files that cross the end of their clock's range, with and without much time in a block."""
    period = PERIODS[name]
    for step in (period // 50_000, period // 500):
        wanted = np.arange(max(period - 3000 * step, step), min(period + 2000 * step, 2 * period - 1), step)
        events = Events(wanted, wanted % 128, wanted % 100, wanted % 2, SIZE)
        data, start = wrapped(events, name, period), int(wanted[int(share * len(wanted))])
        found, error = streamed(data, name, False, start_us=start)
        assert error is None
        assert np.array_equal(found, events.records()[int(share * len(wanted)) :])


def wrapped(events, name, period):
    if name == "evt3":
        return written(events, name)
    cut = int(np.searchsorted(events.t, period))
    first, second = events[:cut], events[cut:]
    low = Events(second.t - period, second.x, second.y, second.p, SIZE)
    return written(first, name) + written(low, name)[len(written(low[:0], name)) :]


RECORDED = ("evt3_imx636_wrap.raw", "evt2_gen3.raw", "gen4_first100k.dat", "davis240_translBoxes.aedat")


@pytest.mark.parametrize("name", [*RECORDED, "mnistdvs_0_scale16_0001_qt1.aedat"])
def test_recordings(shared, name):
    path = shared / "data" / "formats" / name
    data = path.read_bytes()
    events = load(data, name=name)
    for share in (0.01, 0.3, 0.5, 0.77, 0.99):
        start = int(events.t[int(share * len(events))])
        found, error = streamed(data, None, False, 1 << 14, name=name, start_us=start)
        assert error is None
        assert np.array_equal(found, events.records()[np.searchsorted(events.t, start) :])


def test_where_to_begin():
    at = [(10, 100), (20, 200), (40, 240), (50, 3), (60, 9)]
    assert (seek_point(10, at, 100, 256), seek_point(10, at, 101, 256)) == (SeekPoint(10), SeekPoint(10, 100, 0))
    assert (seek_point(10, at, 250, 256), seek_point(10, at, 260, 256)) == (
        SeekPoint(40, 240, 0),
        SeekPoint(50, 3, 256),
    )
    assert seek_point(10, at, 10**9, 256) == SeekPoint(60, 9, 256)
    assert seek_point(10, [(10, 200), (20, 100), (30, 220)], 210, 256) == SeekPoint(10)


@pytest.mark.parametrize("name", NAMES)
def test_damage(name):
    """A fault is told as if all had been read, unless it stands before the start."""
    whole = written(events_of(3, 1000, (0, 1, 30)), name)

    @given(st.data(), st.integers(0, 11_000))
    @settings(max_examples=20, suppress_health_check=list(HealthCheck))
    def run(data, start):
        at = data.draw(st.integers(0, len(whole) - 1))
        how = data.draw(st.sampled_from(["cut", "flip", "insert"]))
        changed = {"cut": b"", "flip": bytes([whole[at] ^ data.draw(st.integers(1, 255))]), "insert": b"abc"}[how]
        damaged = whole[:at] + changed + (whole[at + (how == "flip") :] if how != "cut" else b"")
        found, error = streamed(damaged, name, False, start_us=start, sensor_size=SIZE)
        expected, told = streamed(damaged, name, True, start_us=start, sensor_size=SIZE)
        if len(expected) and expected["t"].max() >= 1 << 24:
            return  # a damaged time that looks as if the clock had begun again: one more fault before the start
        if told is None:
            assert error is None
            assert np.array_equal(found, expected)
        else:
            assert error in (None, told)
            assert np.array_equal(found[: len(expected)], expected) or error is None

    run()


def test_an_error_after_the_start_is_numbered_from_the_beginning():
    data = bytearray(written(events_of(3, 1000, (1,)), "dat"))
    data[-8 * 10 : -8 * 10 + 4] = bytes(4)
    found, error = streamed(bytes(data), "dat", False, start_us=900)
    assert error == f"<bytes>: byte {len(data) - 80}: event 990: " + (
        "time runs back from 990 to 0 us; load(..., sort=True) sorts the events"
    )
    assert len(found) < 100
