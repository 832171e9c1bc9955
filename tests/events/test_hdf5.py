import io
import sys

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from event_tests import damage_is_told, refusal
from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats import hdf5 as hdf5_format
from neuro.events.formats.hdf5 import Hdf5, read_sample, write_sample
from neuro.events.source import Source

ROWS = [(70, 3, 2, 1), (1000, 3, 400, 0), (1070, 5, 0, 1), (1070, 600, 9, 0), (9000, 0, 0, 1)]
T, X, Y, P = (np.array(values) for values in zip(*ROWS, strict=True))
EVENTS = Events(T, X, Y, P, (640, 480), {"chip": "a", "parts": [1, 2]})


def hdf5(**datasets):
    """A file with these datasets and, as attributes of the file, numbers and strings."""
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        for name, value in datasets.items():
            if isinstance(value, int | str):
                file.attrs[name] = value
            else:
                file[name.replace("__", "/")] = value
    return data.getvalue()


def columns(group, t=T, x=X, y=Y, p=P):
    return {f"{group}__{name}": np.asarray(values) for name, values in zip("txyp", (t, x, y, p), strict=True)}


def test_layout_is_that_of_dsec(tmp_path):
    path = tmp_path / "a.h5"
    save(EVENTS, path)
    with h5py.File(path) as file:
        assert (set(file), file["t_offset"][()]) == ({"events", "ms_to_idx", "t_offset"}, 70)
        assert file["events/t"][:].tolist() == (T - 70).tolist()
        assert {name: d.dtype.str for name, d in file["events"].items()} == {
            "t": "<i8", "x": "<u2", "y": "<u2", "p": "|u1",
        }  # fmt: skip
        for dataset in (*file["events"].values(), file["ms_to_idx"]):
            assert (dataset.compression, dataset.shuffle, dataset.maxshape) == ("gzip", True, (None,))
        assert dict(file["events"].attrs)["sensor_size"].tolist() == [640, 480]
        index = file["ms_to_idx"][:]
    assert (index.tolist(), load(path)) == ([0, 2, 4, 4, 4, 4, 4, 4, 4], EVENTS)
    assert load(path).metadata == {"format": "hdf5", "t0": 70, "chip": "a", "parts": [1, 2]}


@given(st.lists(st.integers(0, 20000), min_size=1, max_size=60).map(sorted), st.integers(1, 9))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=15)
def test_index_of_ms(tmp_path, monkeypatch, times, count):
    monkeypatch.setattr(hdf5_format, "INDEX_BLOCK", 2)
    t = np.array(times)
    zeros = np.zeros(t.size, int)
    events = Events(t, zeros, zeros, zeros, (1, 1))
    save((events[k : k + count] for k in range(0, t.size, count)), tmp_path / "a.h5", replace=True)
    with h5py.File(tmp_path / "a.h5") as file:
        index, own = file["ms_to_idx"][:], file["events/t"][:]
    assert len(index) == own[-1] // 1000 + 1
    assert index.tolist() == [int(np.argmax(own >= 1000 * ms)) for ms in range(len(index))]


def test_long_recordings_get_no_index(tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5_format, "INDEX_LIMIT", 5)
    path = tmp_path / "a.h5"
    save([EVENTS[:3], EVENTS[3:]], path)
    with h5py.File(path) as file:
        assert "ms_to_idx" not in file
    assert load(path) == EVENTS


def test_dsec():
    """t in uint32 from t_offset on, no sensor."""
    data = hdf5(**columns("events", T.astype("u4")), t_offset=np.int64(49599300523), ms_to_idx=np.zeros(3, "u8"))
    events = load(data)
    assert (events.t.tolist(), events.sensor_size) == ((T + 49599300523).tolist(), (601, 401))


PROPHESEE = np.array([(x, y, p, t) for t, x, y, p in ROWS], [("x", "u2"), ("y", "u2"), ("p", "i2"), ("t", "i8")])


def test_prophesee():
    events = load(
        hdf5(CD__events=PROPHESEE, CD__indexes=np.zeros(2, [("id", "u8"), ("ts", "i8")]), geometry="1280x720")
    )
    assert (events.records().tolist(), events.sensor_size) == (ROWS, (1280, 720))


def filtered(number, kind, *names):
    """A file whose datasets are packed with this filter of HDF5."""
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((4,))
        plist.set_filter(number, h5py.h5z.FLAG_OPTIONAL, ())
        rows = h5py.h5t.py_create(np.dtype(kind)), h5py.h5s.create_simple((4,)), plist
        for name in names:
            group, _, last = name.rpartition("/")
            h5py.h5d.create(file.require_group(group).id, last.encode(), *rows)
    return data.getvalue()


def test_packed_with_an_unknown_filter(monkeypatch):
    assert refusal(load, filtered(36559, PROPHESEE.dtype, "CD/events"), name="f") == (
        "f: /CD/events is compressed with Prophesee's ECF filter, which HDF5 alone cannot decode: "
        "use the RAW file, or export it with Metavision's tools"
    )
    data = filtered(300, "i4", *(f"events/{name}" for name in "txyp"))
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    assert "/events/t, compressed with HDF5 filter 300, needs the package hdf5plugin" in refusal(load, data)
    monkeypatch.setitem(sys.modules, "hdf5plugin", h5py)
    assert "/events/t is compressed with the unknown HDF5 filter 300" in refusal(load, data)


def test_aertb():
    """Rows x, y, ts, p with times as float32 and polarities -1 and 1."""
    kind = [("x", "u2"), ("y", "u2"), ("ts", "f4"), ("p", "i1")]
    rows = np.array([(x, y, t, 2 * p - 1) for t, x, y, p in ROWS], kind)
    assert load(hdf5(cars__1=rows)).records().tolist() == ROWS
    what = r"data set with 2 recordings or more \(/cars/1, /cars/2\), expected one; neuro.events.Dataset reads it"
    with pytest.raises(EventFileError, match=what):
        load(hdf5(cars__1=rows, cars__2=rows))


def test_samples(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("cars")
        write_sample(group, "1", EVENTS)
        write_sample(group, "none", EVENTS[:0])
        assert group["1"].dtype.names == ("ts", "x", "y", "p")
        assert (group["1"].compression, group["1"].shuffle, read_sample(group["1"])) == ("gzip", True, EVENTS)
        assert (read_sample(group["1"]).metadata, len(read_sample(group["none"]))) == (EVENTS.metadata, 0)
        with pytest.raises(ValueError, match="name already exists"):
            write_sample(group, "1", EVENTS)
        group["other"] = np.zeros(3)
        assert "/cars/other: has rows of float64, expected fields ts, x, y, p" in refusal(read_sample, group["other"])
        group["bad"] = np.array([(1, 2, 3, 7)], [("ts", "i8"), ("x", "u2"), ("y", "u2"), ("p", "u1")])
        assert "event 0: p is 7" in refusal(read_sample, group["bad"])
        del group["none"], group["other"], group["bad"]
    assert load(tmp_path / "a.h5") == EVENTS


def test_seconds_and_the_root():
    events = load(hdf5(**{"ts": T / 1e6, "x": X, "y": Y, "pol": P > 0, "width": 700, "height": 500}))
    assert (events.records().tolist(), events.sensor_size, events.metadata["width"]) == (ROWS, (700, 500), 700)


def test_messages(messages):
    messages.calls(globals())


def test_damage_is_told():
    files = [hdf5(**columns("events"), t_offset=np.int64(3)), hdf5(CD__events=PROPHESEE, geometry="640x480")]
    damage_is_told(files, "hdf5")


def test_a_length_that_cannot_be():
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        for name in "txyp":
            file.create_dataset(f"events/{name}", (10**15,), "i4", chunks=(1000,))
    assert "/events/t has 1000000000000000 items, too many for its 0 bytes" in refusal(load, data.getvalue())


def test_a_cut_file():
    with pytest.raises(EventFileError, match=r"f: not an intact HDF5 file: .*truncated file"):
        load(hdf5(**columns("events"))[:-10], name="f", strict=False)


def long(n=100_000):
    t = np.arange(n) * 3
    return Events(t, t % 640, t % 480, t % 2, (640, 480))


def test_chunks_before_a_damaged_one_are_read(tmp_path):
    path = tmp_path / "a.h5"
    save(long(), path)
    with h5py.File(path) as file:
        place = file["events/t"].id.get_chunk_info_by_coord((70_000,)).byte_offset
    data = bytearray(path.read_bytes())
    data[place + 20 : place + 60] = bytes(40)
    with pytest.raises(EventFileError, match=f"byte {place}: the events from 65536 on cannot be read") as error:
        load(bytes(data))
    assert error.value.offset == place
    with pytest.warns(EventFileWarning, match="the events before it were read"):
        part = load(bytes(data), strict=False)
    assert part == long()[:65536]


def test_streamed_in_chunks(tmp_path):
    path = tmp_path / "a.h5"
    save(long(), path)
    assert [piece.t.size for piece in Hdf5(Source(path)).pieces(1)] == [32768, 32768, 32768, 100_000 - 3 * 32768]
    assert [len(part) for part in stream(path, count=25_000)] == [25_000] * 4
    save(stream(path, count=999), tmp_path / "b.h5")
    assert load(tmp_path / "b.h5") == long()


def test_a_damaged_heap_is_told():
    """HDF5 itself goes round without end in it."""
    data = bytearray(hdf5(**columns("events"), note="hello"))
    free = data.index(b"hello", data.index(b"GCOL")) + 8
    assert data[free : free + 2] == b"\0\0"
    data[free + 8] ^= 0x80
    assert "a heap of strings is damaged; attributes with strings were skipped" in refusal(load, bytes(data))
    with pytest.warns(EventFileWarning, match="a heap of strings is damaged"):
        assert load(bytes(data), strict=False).records().tolist() == ROWS


def test_long_metadata(tmp_path):
    save(Events(T, X, Y, P, (640, 480), {"header": "ä" * 100_000}), tmp_path / "a.h5")
    assert load(tmp_path / "a.h5").metadata["header"] == "ä" * 100_000


def test_a_span_that_no_column_holds(tmp_path):
    events = Events([-5, 2**63 - 1], [0, 0], [0, 0], [0, 0], (1, 1))
    with pytest.raises(EventFileError, match=r"cannot store event 1: t 9223372036854775807 lies 2\^63 us"):
        save(events, tmp_path / "a.h5")
