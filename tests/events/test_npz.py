import io
import json
import re

import numpy as np
import pytest

from event_tests import damage_is_told, refusal
from neuro.events import EVENT, EventFileWarning, Events, load, save, stream
from neuro.events.formats.npz import Npz
from neuro.events.source import Source

ROWS = [(-7, 3, 2, 1), (0, 3, 40000, 0), (10, 5, 0, 1), (10, 65535, 9, 0), (1 << 62, 0, 0, 1)]
T, X, Y, P = (np.array(values) for values in zip(*ROWS, strict=True))


def npz(packed=False, **arrays):
    file = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(file, **arrays)
    return file.getvalue()


def test_columns():
    events = load(npz(t=T, x=X, y=Y, p=P))
    assert (events.records().tolist(), events.sensor_size) == (ROWS, (65536, 40001))
    assert events.metadata == {"format": "npz", "t0": -7}


def test_other_names_and_types():
    arrays = {"ev_x": X.astype(">f4"), "yDim": Y, "Y": Y.astype("u4"), "polarity": P * 2 - 1, "timestamps": T}
    assert load(npz(packed=True, **arrays)).records().tolist() == ROWS
    assert load(npz(**arrays, width=np.array([65536]), height=np.int64(50000))).sensor_size == (65536, 50000)
    assert load(npz(t=T, x=X, y=Y, p=P > 0, sensor_size=[65536, 45000])).sensor_size == (65536, 45000)


def test_seconds():
    events = load(npz(t=np.array([0.25, 1468939993.067416, 1468939993.0674165]), x=X[:3], y=Y[:3], p=P[:3]))
    assert events.t.tolist() == [250000, 1468939993067416, 1468939993067416]
    assert load(npz(t_ns=np.array([1499, 1500]), x=X[:2], y=Y[:2], p=P[:2])).t.tolist() == [1, 2]
    assert load(npz(t_s=np.array([3]), x=X[:1], y=Y[:1], p=P[:1])).t.tolist() == [3_000_000]


def test_records():
    records = np.array(ROWS, np.dtype([("ts", "<f8"), ("x", "i4"), ("y", "i8"), ("pol", "?")]))
    assert load(npz(frames=np.zeros((3, 4)), events=records)).records().tolist() == ROWS
    assert load(npz(events=np.array(ROWS, EVENT))).records().tolist() == ROWS


def test_arrays_of_objects_are_not_read():
    assert len(load(npz(t=T, x=X, y=Y, p=P, metadata=np.array([{}], object)))) == 5
    told = refusal(load, npz(t=T, x=X.astype(object), y=Y, p=P))
    assert "the events from 0 on cannot be read: array x holds Python objects, expected numbers" in told


def test_messages(messages):
    messages.of(lambda case: re.sub(r"byte [1-9]\d*", "byte N", refusal(eval, case, globals())))


@pytest.mark.filterwarnings("ignore")
def test_damage_is_told():
    damage_is_told([npz(t=T, x=X, y=Y, p=P), npz(packed=True, e=np.array(ROWS, EVENT))], "npz")


def test_what_is_whole():
    with pytest.warns(EventFileWarning, match="event 4: x is -1"):
        part = load(npz(t=T, x=[0, 1, 2, 3, -1], y=Y, p=P), strict=False)
    assert part.t.tolist() == T[:4].tolist()


def test_a_flipped_bit_is_found():
    data = bytearray(npz(t=T, x=X, y=Y, p=P))
    data[data.index(T.tobytes()) + 3] ^= 1
    assert "the events from 0 on cannot be read: Bad CRC-32 for file 't.npy'" in refusal(
        load, bytes(data), name="a.npz"
    )


def test_streamed_in_little_memory(tmp_path):
    n = 300_000
    t, path = np.arange(n) * 7, tmp_path / "a.npz"
    np.savez_compressed(path, t=t, x=(t % 640).astype(np.uint16), y=np.zeros(n, np.uint8), p=np.ones(n, bool))
    pieces = list(Npz(Source(path)).pieces(100_000))
    assert max(piece.t.size for piece in pieces) < 10_000
    assert np.array_equal(np.concatenate([piece.t for piece in pieces]), t)
    with path.open("rb") as file:
        assert sum(len(part) for part in stream(file, window_us=10_000, sensor_size=(640, 1))) == n


def test_read_by_numpy(tmp_path):
    path = tmp_path / "a.npz"
    metadata = {"chip": "x", "t0": 3, "format": "bin", "n": np.int64(3), 4: np.arange(2)}
    save(Events(T, X, Y, P, (65536, 50000), metadata), path)
    with np.load(path) as arrays:
        assert {name: (a.dtype.str, a.shape) for name, a in arrays.items()} == {
            "t": ("<i8", (5,)), "x": ("<u2", (5,)), "y": ("<u2", (5,)), "p": ("|u1", (5,)),
            "sensor_size": ("<i8", (2,)), "metadata": (arrays["metadata"].dtype.str, ()),
        }  # fmt: skip
        assert json.loads(str(arrays["metadata"])) == {"chip": "x", "n": 3, "4": [0, 1]}
    assert load(path).metadata == {"format": "npz", "t0": -7, "chip": "x", "n": 3, "4": [0, 1]}
