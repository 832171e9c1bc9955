"""Tables, columns deeper in a file and sensors of HDF5 as v2e, MVSEC, M3ED and e2vid write them."""

import io

import h5py
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from event_tests import damage_is_told, refusal
from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.info import info

N = 3000
K = np.arange(N)
T, X, Y, P = 317 * K, 7 * K % 346, 11 * K % 260, K % 3 % 2
RECORDS = list(zip(T.tolist(), X.tolist(), Y.tolist(), P.tolist(), strict=True))
SECONDS = 1504645177


def hdf5(attributes=(), **datasets):
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        file.attrs.update(dict(attributes))
        for name, value in datasets.items():
            chunks = (512, 4) if np.ndim(value) == 2 and len(value) > 512 else None
            file.create_dataset(name.replace("__", "/"), data=value, chunks=chunks)
    return data.getvalue()


def v2e(t=T, x=X, y=Y, p=P):
    """As `EventEmulator` does it: resized while it grows, packed, uint32."""
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        table = file.create_dataset("events", (0, 4), maxshape=(None, 4), dtype="uint32", compression="gzip")
        table.resize(len(t), axis=0)
        if len(t):
            table[-len(t) :] = np.stack([t, x, y, p], axis=1)
    return data.getvalue()


def mvsec(t=T, x=X, y=Y, p=P):
    return np.stack([x, y, SECONDS + t / 1e6, 2 * p - 1], axis=1).astype(float)


def m3ed(side="left"):
    columns = {"t": T.astype("i8"), "x": X.astype("u2"), "y": Y.astype("u2"), "p": P.astype("u1")}
    told = {"calib__resolution": np.array([1280, 720]), "calib__intrinsics": np.ones(4), "ms_map_idx": np.zeros(9)}
    return {f"prophesee__{side}__{name}": value for name, value in (columns | told).items()}


def test_v2e():
    events = load(v2e())
    assert (events.records().tolist(), events.sensor_size) == (RECORDS, (346, 260))
    assert events.metadata == {"format": "hdf5", "t0": 0, "columns": "t x y p"}
    assert len(load(v2e(T[:0], X[:0], Y[:0], P[:0]))) == 0
    frames = {"frame": np.zeros((2, 9, 9)), "frame_ts": np.zeros(2), "frame_idx": np.zeros((2, 2))}
    assert load(hdf5(events=np.stack([T, X, Y, P], 1).astype("u4"), **frames)).records().tolist() == RECORDS


def test_v2e_where_other_orders_fit_too():
    """Its first frame in rows: one time, and rows that grow. The place and the type tell the order."""
    assert load(v2e(T[:9] * 0, X[:9], K[:9] // 3, P[:9])).x.tolist() == X[:9].tolist()


def test_v2e_that_is_not_in_its_order():
    table = np.stack([X, Y, T, P], axis=1).astype("u4")
    assert load(hdf5(events=table)).records().tolist() == RECORDS
    assert load(hdf5(events=table)).metadata["columns"] == "x y t p"


def test_mvsec():
    data = hdf5(davis__left__events=mvsec(), davis__left__imu=np.zeros((5, 6)), davis__left__image_raw_ts=np.zeros(3))
    events = load(data)
    assert (events.t - SECONDS * 10**6).tolist() == T.tolist()
    assert events.records()[["x", "y", "p"]].tolist() == [record[1:] for record in RECORDS]
    assert events.metadata["columns"] == "x y t p"


def test_mvsec_whose_first_times_are_whole_seconds():
    table = mvsec(10**6 * np.arange(3), X[:3], Y[:3], P[:3])
    assert load(hdf5(davis__right__events=table)).t.tolist() == [(SECONDS + k) * 10**6 for k in range(3)]


def test_one_of_two_cameras():
    data = hdf5(davis__left__events=mvsec(), davis__right__events=mvsec(x=X + 1))
    assert (load(data, format="hdf5:/davis/left/events").x[1], load(data, format="hdf5:/davis/right").x[1]) == (7, 8)
    assert load(data, format="h5:davis/right").x[1] == 8
    data = hdf5(**m3ed(), **m3ed("right"))
    assert load(data, format="hdf5:/prophesee/right").records().tolist() == RECORDS
    assert next(stream(data, format="hdf5:/prophesee/left", start_us=500_000)).t[0] == T[T >= 500_000][0]


def test_m3ed():
    events = load(hdf5(**m3ed()))
    assert (events.records().tolist(), events.sensor_size) == (RECORDS, (1280, 720))


@pytest.mark.parametrize("order", ["txyp", "xytp", "xypt"])
@pytest.mark.parametrize("kind", ["i8", "f8", "f4"])
def test_order_from_the_values(order, kind):
    columns = {"t": T, "x": X, "y": Y, "p": 2 * P - 1}
    events = load(hdf5(a__b__events_data=np.stack([columns[name] for name in order], axis=1).astype(kind)))
    assert events.records().tolist() == RECORDS


def test_order_that_is_given():
    one = np.array([[5, 3, 2, 1]])
    assert load(hdf5(a__events=one), format="hdf5:/a/events:txyp").records().tolist() == [(5, 3, 2, 1)]
    assert load(hdf5(a__events=one), format="hdf5:/a/events:xytp").records().tolist() == [(2, 5, 3, 1)]
    assert load(hdf5(a__else=one), format="hdf5:/a/else:yxtp").records().tolist() == [(2, 3, 5, 1)]


def test_parts_of_a_table_as_the_whole():
    data = v2e()
    parts = list(stream(data, count=700))
    assert [len(part) for part in parts] == [700] * 4 + [200]
    assert [r for part in parts for r in part.records().tolist()] == RECORDS
    begun = [r for part in stream(data, start_us=400_001) for r in part.records().tolist()]
    assert begun == [record for record in RECORDS if record[0] > 400_000]


E2VID = {"events__ts": SECONDS + T / 1e6, "events__xs": X, "events__ys": Y, "events__ps": P > 0}


@pytest.mark.parametrize("told", [[260, 346], np.array([260, 346, 3], "i4"), [260.0, 346.0]])
def test_e2vid(told):
    events = load(hdf5({"sensor_resolution": told}, **E2VID))
    assert (events.sensor_size, (events.t - SECONDS * 10**6).tolist()) == ((346, 260), T.tolist())
    assert events.p.tolist() == P.tolist()


def test_a_sensor_that_may_be_two():
    data = hdf5({"sensor_resolution": [346, 260]}, **E2VID)
    for use in (load, info, lambda given, name: next(stream(given, name=name))):
        assert refusal(use, data, name="f") == (
            "f: sensor_resolution is [346, 260], in an unclear order of height and width: "
            "specify sensor_size=(346, 260) or (260, 346), or --sensor WxH"
        )
    assert load(data, sensor_size=(346, 260)).sensor_size == (346, 260)
    found = info(data, sensor_size=(346, 260))
    assert (found.sensor_told, found.events) == (False, N)


def test_info_says_what_was_never_tried(tmp_path):
    text = "no recording in another layout than this library's was available"
    for data in (v2e(), hdf5(davis__left__events=mvsec()), hdf5(**m3ed())):
        assert info(data).untested == text
    save(Events(T, X, Y, P, (346, 260)), tmp_path / "a.h5")
    assert info(tmp_path / "a.h5").untested == ""


FEW = np.array([[5, 3, 2, 1]])
BOTH = {"davis__left__events": mvsec(), "davis__right__events": mvsec()}


def test_messages(messages):
    messages.calls(globals())


def test_damage_is_told():
    damage_is_told(
        [v2e(), hdf5(davis__left__events=mvsec()[:40]), hdf5({"sensor_resolution": [260, 346]}, **m3ed())], "hdf5"
    )


def test_a_place_in_a_format_without_places():
    with pytest.raises(EventFileError, match=r"^f: unknown format 'nmnist:/a', expected one of "):
        load(b"", name="f", format="nmnist:/a")


def test_a_damaged_chunk_of_a_table():
    """Chunks before it are read; a table whose chunks are parted by columns, too."""
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        table = np.stack([T, X, Y, P], axis=1)
        file.create_dataset("events", data=table, chunks=(1000, 2), compression="gzip", fletcher32=True)
        place = file["events"].id.get_chunk_info_by_coord((2000, 2)).byte_offset
        first = file["events"].id.get_chunk_info_by_coord((2000, 0)).byte_offset
    damaged = bytearray(data.getvalue())
    assert load(bytes(damaged)).records().tolist() == RECORDS
    damaged[place + 20 : place + 40] = bytes(20)
    assert f"byte {first}: the events from 2000 on cannot be read" in refusal(load, bytes(damaged))
    with pytest.warns(EventFileWarning, match="the events before it were read"):
        assert load(bytes(damaged), strict=False).records().tolist() == RECORDS[:2000]


@st.composite
def recordings(draw):
    n = draw(st.integers(1, 30))
    t = np.array(sorted(draw(st.lists(st.integers(0, 2**32 - 1), min_size=n, max_size=n))))
    places = st.lists(st.integers(0, 65535), min_size=n, max_size=n)
    p = np.array(draw(st.lists(st.integers(0, 1), min_size=n, max_size=n)))
    return t, np.array(draw(places)), np.array(draw(places)), p


@given(recordings())
@settings(max_examples=25)
def test_any_recording(columns):
    """Tables in known places give the events that went in; elsewhere, those or a refusal."""
    wanted = list(zip(*(c.tolist() for c in columns), strict=True))
    assert load(v2e(*columns)).records().tolist() == wanted
    t, x, y, p = columns
    assert load(hdf5(davis__left__events=mvsec(*columns))).records().tolist() == [
        (SECONDS * 10**6 + a, b, c, d) for a, b, c, d in wanted
    ]
    try:
        found = load(hdf5(a__events=np.stack([x, y, t, p], 1)))
    except EventFileError as refused:
        told = str(refused)
    else:
        assert found.records().tolist() == wanted
        return
    assert "name the order" in told
