"""What holds for every format: known files, what is saved and what cannot be, and other libraries."""

import hashlib
import io
import json
import os
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from event_tests import parts_of, refusal
from neuro.events import Events, load, save, stream
from neuro.events.formats import FORMATS

ENDINGS = {
    "aedat2": ".aedat", "aedat4": ".aedat4", "csv": ".csv", "dat": ".dat", "event_stream": ".es", "evt2": ".raw",
    "evt3": ".raw", "hdf5": ".h5", "nmnist": ".bin", "npz": ".npz", "txt": ".txt",
}  # fmt: skip

FILES = {
    (34, 34): ["nmnist_sample.bin"], (151, 173): ["ncaltech101_faces_easy_0001.bin"], (128,
    128): ["mnistdvs_0_scale04_0001.aedat", *(f"mnistdvs_0_scale{scale}_0001_qt1.aedat" for scale in ("04", "08",
    "16"))], (240, 180): ["davis240_translBoxes.aedat"],
    (320, 240): ["dvxplorer_lite_320x240.aedat4", "es_dvs_320x240.es"],
    (346, 260): ["davis346_aestream.aedat4", "davis346_small.aedat4"], (304, 240): ["ncars_tonic_sample.dat",
    "ncars_obj_004397_td.dat", *(f"ncars_cars_obj_00441{k}_td.dat" for k in (4, 5, 6)),
    *(f"ncars_background_obj_00421{k}_td.dat" for k in (1, 2, 3))],
    (1280, 720): ["gen4_first100k.dat", "evt3_gen41.raw", "evt3_imx636_wrap.raw"],
    (640, 480): ["evt2_gen3.raw", "ros1_event_camera_msgs_evt3.bag"], (30, 32): ["es_poker_club_trcl0.es"]
}  # fmt: skip


@pytest.mark.parametrize(("name", "size"), [(name, size) for size, names in FILES.items() for name in names])
def test_decoding_is_the_known_one(shared, name, size):
    """At once and streamed, from the disk and from what is read once."""
    path = shared / "data" / "formats" / name
    truth, events = json.loads((path.parent / "truth.json").read_text())[name], load(path)
    records = events.records()
    if name.startswith("davis240"):  # there the columns and rows are as the addresses count them
        records["x"], records["y"] = size[0] - 1 - records["x"], size[1] - 1 - records["y"]
    assert hashlib.sha256(records.tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert (len(events), events.sensor_size) == (truth["n_events"], size)
    for source in (path, io.BytesIO(path.read_bytes())):
        parts = list(stream(source, name=name, sensor_size=size, count=50_000))
        assert [len(part) for part in parts[:-1]] == [50_000] * (len(parts) - 1)
        assert np.array_equal(np.concatenate([part.records() for part in parts]), events.records())


FULL = (-(2**63), 2**63 - 1)
HELD = {
    "aedat2": ((0, 2**32 - 1), [(128, 128), (34, 34), (240, 180), (346, 260), (500, 10), (640, 480)]),
    "aedat4": ((0, 2**62), [(1, 1), (346, 260), (32768, 32768)]), "csv": (FULL, [(65536, 65536)]),
    "dat": ((0, 2**32 - 1), [(2048, 2048), (16384, 16384)]),
    "event_stream": ((0, 10**6), [(1, 1), (34, 34), (1280, 720), (65535, 65535)]),
    "evt2": ((0, 2**34 - 1), [(2048, 2048)]), "evt3": ((0, 2**28), [(2048, 2048)]),
    "hdf5": ((-(2**61), 2**61), [(65536, 65536)]), "nmnist": ((0, 2**23 - 1), [(256, 256)]),
    "npz": (FULL, [(65536, 65536)]), "txt": (FULL, [(65536, 65536)])
}  # fmt: skip
"""The first and last time that a format can hold, and sensors that it can tell."""
PAUSES = st.sampled_from([0, 0, 1, 5, 126, 127, 128, 254, 4096, 2**24 - 1, 2**24, 5 * 2**24 + 7])


@st.composite
def recordings(draw, limits, sizes):
    """Runs of neighbours of one time after pauses, one of which may be very long."""
    (first, last), (width, height) = limits, draw(st.sampled_from(sizes))
    groups = st.tuples(
        PAUSES | st.integers(0, 400), st.integers(0, width - 1), st.integers(0, height - 1),
        st.integers(0, 1), st.lists(st.integers(0, 14), max_size=12),
    )  # fmt: skip
    t, found = draw(st.one_of(st.integers(first, last), st.sampled_from([max(first, 0), min(last, 2**24 + 3)]))), []
    for pause, x, y, p, gaps in draw(st.lists(groups, max_size=10)):
        t = min(t + pause, last)
        found += [(t, min(x + int(gap), width - 1), y, p) for gap in np.cumsum([0, *gaps])]
    return Events(*np.array(found, np.int64).reshape(-1, 4).T, (width, height))


@pytest.mark.parametrize("name", HELD)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(data=st.data())
def test_what_is_saved_is_loaded(tmp_path, name, data):
    events = data.draw(recordings(*HELD[name]))
    if name == "nmnist":
        events = events[events.y != 240]
    path, cuts = tmp_path / f"a{ENDINGS[name]}", data.draw(st.lists(st.integers(0, len(events)), max_size=4))
    save(iter(parts_of(events, cuts)), path, replace=True, format=name)
    size = {"sensor_size": events.sensor_size} if name == "nmnist" else {}
    assert load(path, **size) == events
    assert len(events) == 0 or load(path).metadata["format"] == ("csv" if name == "txt" else name)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", HELD)
def test_pauses_at_the_ends_of_clocks(tmp_path, name):
    pauses = [0, 1, 63, 64, 126, 127, 128, 254, 4095, 4096, 8191, 8192, 2**23, 2**24 - 1, 2**24, 5 * 2**24 + 7]
    t = np.cumsum(np.repeat(pauses, 2) * np.tile([1, 0], len(pauses)))
    t = t[t <= HELD[name][0][1]]
    events = Events(t, np.arange(t.size) % 34, np.arange(t.size) % 30, np.arange(t.size) % 2, (34, 34))
    save(events, tmp_path / "a", format=name)
    assert np.array_equal(load(tmp_path / "a", format=name).records(), events.records())


BEYOND = {
    "aedat2": [(1 << 32, 1, 1), (7, 640, 1), (7, 1, 480)], "evt2": [(1 << 34, 1, 1), (5, 2048, 1), (5, 1, 2048)],
    "dat": [(1 << 32, 1, 1), (-1, 1, 1), (5, 1 << 14, 1), (5, 1, 1 << 14)],
    "evt3": [(1 << 40, 1, 1), (5, 2048, 1), (5, 1, 2048)], "aedat4": [(-1, 1, 1), (5, 1 << 15, 1), (5, 1, 1 << 15)],
    "nmnist": [(1 << 23, 1, 1), (0, 256, 1), (0, 1, 256), (0, 1, 240)],
}  # fmt: skip


def test_what_cannot_be_held(messages, tmp_path, monkeypatch):
    """Single events, and parts of another sensor or an earlier time than that before them."""
    monkeypatch.chdir(tmp_path)
    told = {}
    for name, some in BEYOND.items():
        for t, x, y in some:
            events = Events(*np.array(sorted([(0, 0, 0, 0), (t, x, y, 0)])).T, (40_000, 40_000))
            told[f"{name} {t, x, y}"] = refusal(save, iter(parts_of(events, [1])), "a", format=name)
    one = np.array([1])
    first, other = (Events(one, one, one, one, size) for size in ((20, 20), (30, 30)))
    for name in ENDINGS:
        for part in (other, Events(one - 1, one, one, one, (20, 20))):
            told[f"{name} {part}"] = refusal(save, iter([first, part]), "a", format=name)
    messages(told)
    assert not list(tmp_path.iterdir())


def test_a_named_pipe_is_read_like_an_open_file(tmp_path):
    whole = Events(np.arange(500), np.arange(500) % 34, np.arange(500) % 30, np.arange(500) % 2, (34, 34))
    for ending in (".bin", ".csv", ".aedat", ".npz"):
        kept, pipe = tmp_path / f"kept{ending}", tmp_path / f"pipe{ending}"
        save(whole, kept)
        os.mkfifo(pipe)
        for read in (load, lambda path: next(stream(path, count=1000, sensor_size=(34, 34)))):
            threading.Thread(target=pipe.write_bytes, args=(kept.read_bytes(),), daemon=True).start()
            assert read(pipe) == whole


READ_BY = {
    "expelliarmus": (["dat", "evt2"], lambda module, path, name: module.Wizard(encoding=name).read(path)),
    "faery": (["dat", "evt2", "evt3"], lambda module, path, name: module.events_stream_from_file(path).to_array()),
    "event_stream": (["event_stream"], lambda module, path, name: np.concatenate(list(module.Decoder(str(path))))),
}


@pytest.mark.parametrize(("library", "name"), [(library, name) for library in READ_BY for name in READ_BY[library][0]])
def test_other_libraries_read_it(tmp_path, library, name):
    """In the order of rising low times faery is right of EVT 3.0; across a wrap in a pause it is not."""
    module = pytest.importorskip(library, reason=f"{library} is not installed")
    rng, n = np.random.default_rng(0), 2500
    columns = np.cumsum(rng.integers(0, 3, n)), *rng.integers(0, [[1200], [720], [2]], (3, n))
    t, x, y, p = (np.repeat(column, 4) for column in columns)
    events, path = Events(t, x + np.tile([0, 2, 5, 30], n), y, p, (1280, 720)), tmp_path / f"a{ENDINGS[name]}"
    save(events, path, format=name)
    found = READ_BY[library][1](module, path, name)
    for column, other in zip("txyp", found.dtype.names, strict=True):
        assert np.array_equal(found[other], getattr(events, column))


def test_every_format_that_is_written_is_tested():
    assert {f.name for f in FORMATS.values() if f.write} == set(ENDINGS) == set(HELD)
