import hashlib
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load, save
from neuro.events.formats.nmnist import Bin
from neuro.events.source import Source


def event(x, y, t, p=1):
    return bytes([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255])


def joined(pieces):
    return [np.concatenate([getattr(piece, name) for piece in pieces]).tolist() for name in "txyp"]


@pytest.mark.parametrize("name", ["nmnist_sample.bin", "ncaltech101_faces_easy_0001.bin"])
def test_decoding_is_the_known_one(shared, name):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())[name]
    events = load(folder / name)
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]


def test_sensor_sizes(shared):
    folder = shared / "data" / "formats"
    assert load(folder / "nmnist_sample.bin").sensor_size == (34, 34)
    assert load(folder / "ncaltech101_faces_easy_0001.bin").sensor_size == (151, 173)
    assert load(folder / "ncaltech101_faces_easy_0001.bin", sensor_size=(240, 180)).sensor_size == (240, 180)


def test_overflow_marker():
    events = load(event(1, 2, 10) + event(0, 240, 0) + event(3, 4, 20), format="nmnist")
    assert events.t.tolist() == [10, 20 + 8192]
    assert events.x.tolist() == [1, 3]


@st.composite
def recordings(draw):
    n = draw(st.integers(0, 50))
    t = np.sort(draw(st.lists(st.integers(0, 2**23 - 1), min_size=n, max_size=n)))
    rows = st.integers(0, 255).filter(lambda y: y != 240)
    x, y, p = (
        draw(st.lists(values, min_size=n, max_size=n)) for values in (st.integers(0, 255), rows, st.integers(0, 1))
    )
    return Events(*(np.array(values, np.int64) for values in (t, x, y, p)), (256, 256))


@given(recordings(), st.integers(1, 50))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events, cut):
    path = tmp_path / "a.bin"
    save(iter([events[:cut], events[cut:]]), path, replace=True)
    assert load(path, sensor_size=(256, 256)) == events
    assert [file.name for file in tmp_path.iterdir()] == ["a.bin"]


@given(
    st.lists(st.sampled_from([event(1, 2, 3), event(9, 8, 7, 0), event(5, 240, 0)]), max_size=30), st.integers(1, 60)
)
@settings(deadline=None)
def test_any_block_gives_the_same(words, block):
    data = b"".join(words)
    whole, parts = (list(Bin(Source(data)).pieces(size)) for size in (1 << 20, block))
    if not words:
        assert not whole
        assert not parts
        return
    assert joined(parts) == joined(whole)
    assert tuple(np.max([piece.highest for piece in parts], axis=0)) == whole[0].highest
    events = [k for k, word in enumerate(words) if word[1] != 240]
    assert [piece.place(k) for piece in parts for k in range(piece.t.size)] == [5 * k for k in events]


@pytest.mark.parametrize(("t", "x", "y"), [(1 << 23, 1, 1), (0, 256, 1), (0, 1, 256), (0, 1, 240)])
def test_cannot_hold(tmp_path, t, x, y):
    events = Events(np.array([0, t]), np.array([0, x]), np.array([0, y]), np.array([0, 0]), (300, 300))
    with pytest.raises(EventFileError) as error:
        save(iter([events[:1], events[1:]]), tmp_path / "a.bin")
    assert str(error.value).partition("\n")[0] == (
        f"{tmp_path / 'a.bin'}: cannot hold event 1: t {t}, x {x}, y {y}; "
        "expected t 0 to 8388607 us, x and y 0 to 255, y not 240"
    )
    assert not list(tmp_path.iterdir())


def test_cut(tmp_path):
    data = event(1, 2, 3) + event(0, 240, 0) + b"ab"
    message = "a.bin: byte 10: 2 bytes left over after 2 events of 5 bytes"
    with pytest.raises(EventFileError) as error:
        load(data, name="a.bin")
    assert str(error.value) == message
    with pytest.warns(EventFileWarning) as told:
        events = load(data, name="a.bin", strict=False)
    assert events.records().tolist() == [(3, 1, 2, 1)]
    assert [str(warning.message) for warning in told] == [f"{message}; what is before it was read"]
