"""Damaged files of every format: events or an error, never a crash, a hang or a coordinate off the sensor.

A format is met with a file of its own writer or, if it has none, the smallest of `../shared`, or one made below.
"""

import faulthandler
import io
import struct
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import neuro.events.files as files
from neuro.events import EVENT, EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats import FORMATS, HEAD, Damage
from neuro.events.opening import find
from neuro.events.source import Source

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "formats"
NAMES = [f.name for f in FORMATS]
KNOWN = {f.name: f for f in FORMATS}
SECONDS = 5
"""Any file of the tests is read in much less."""


def _aedat3():
    lines = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 0: DVS128\r\n#!END-HEADER\r\n"
    header = struct.pack("<hhiiiiii", 1, 0, 8, 4, 0, 3, 3, 3)
    events = [struct.pack("<Ii", k << 17 | 5 << 2 | 3, 100 * k) for k in range(12)]
    return lines + b"".join(header + b"".join(events[k : k + 3]) for k in range(0, 12, 3))


def _aedat4():
    """LZ4 packets of events, and one of another stream between them."""
    import lz4.frame

    node = "<node name='{}'><attr key='typeIdentifier'>{}</attr></node>"
    text = f"<dv><node name='outInfo'>{node.format(0, 'EVTS')}{node.format(1, 'FRME')}</node></dv>".encode()
    header = struct.pack("<I4sHHHHH2xiiII", 20, b"IOHE", 10, 12, 4, 0, 8, 12, 1, 4, len(text)) + text
    data = b"#!AER-DAT4.0\r\n" + struct.pack("<I", len(header)) + header
    for j in range(6):
        rows = b"".join(struct.pack("<qhhBxxx", 20 * j + k, k, 7 * k % 34, k % 2) for k in range(20))
        table = struct.pack("<I4s2xHHHiII", 16, b"EVTS", 6, 8, 4, 6, 4, 20) + rows
        packed = lz4.frame.compress(struct.pack("<I", len(table)) + table, store_size=False)
        data += struct.pack("<ii", 0, len(packed)) + packed + (struct.pack("<ii", 1, 3) + b"abc" if j == 3 else b"")
    return data


def _evt21():
    words = [8 << 60 | k << 32 if k % 4 == 0 else 1 << 60 | k << 54 | 32 << 43 | k << 32 | 5 for k in range(40)]
    return b"% evt 2.1\n% end\n" + struct.pack("<40Q", *words)


def _raw():
    return sample("evt2").split(b"% end\n")[-1]


def _mat():
    from scipy.io import savemat

    k = np.arange(60)
    data = io.BytesIO()
    savemat(data, {"TD": {"x": k % 30 + 1.0, "y": (7 * k) % 34 + 1.0, "p": k % 2, "ts": 1000.0 * k}})
    return data.getvalue()


def _rosbag2():
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store, kind = get_typestore(Stores.ROS2_HUMBLE), "event_camera_msgs/msg/EventPacket"
    fields = ("std_msgs/Header header", "uint32 height", "uint32 width", "uint64 seq", "uint64 time_base")
    store.register(
        get_types_from_msg("\n".join((*fields, "string encoding", "bool is_bigendian", "uint8[] events")), kind)
    )
    packet = struct.pack("<III4sIIQQI5s3xI", 0, 0, 4, b"cam", 34, 34, 7, 0, 5, b"mono", 160)
    with tempfile.TemporaryDirectory() as folder:
        with Writer(Path(folder) / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topic = writer.add_connection("/events", kind, typestore=store)
            for j in range(3):
                words = [(k % 2) << 63 | (7 * k % 34) << 48 | (k % 30) << 32 | 10**6 * (20 * j + k) for k in range(20)]
                writer.write(topic, j, b"\0\1\0\0" + packet + struct.pack("<20Q", *words))
        return (Path(folder) / "bag" / "bag.mcap").read_bytes()


MADE = {"aedat3": _aedat3, "aedat4": _aedat4, "evt21": _evt21, "mat": _mat, "raw": _raw, "rosbag2": _rosbag2}
_samples = {}


@pytest.fixture(autouse=True)
def limited():
    """End the run, telling where it is, rather than wait for ever."""
    faulthandler.dump_traceback_later(120, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def sample(name):
    """The bytes of a file of a format."""
    if name not in _samples:
        format = KNOWN[name]
        _samples[name] = MADE[name]() if name in MADE else written(format) or recorded(format)
    if _samples[name] is None:
        pytest.skip(f"no file of {name} is here")
    return _samples[name]


def written(format):
    if format.write is None:
        return None
    k = np.arange(60)
    events = Events(1000 * k, k % 30, (7 * k) % 34, k % 2, (34, 34))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{format.suffixes[0]}"
        save(events, path, format=format.name)
        return path.read_bytes()


def recorded(format):
    paths = sorted(SHARED.iterdir(), key=lambda path: path.stat().st_size) if SHARED.is_dir() else []
    for path in paths:
        try:
            if find(Source(path)) is format:
                return path.read_bytes()
        except EventFileError:
            continue
    return None


def opens(data, name, format):
    """Whether the format is found and its header can be read."""
    source = Source(data, name)
    try:
        find(source, format).open(source)
    except (Damage, EventFileError):
        return False
    return True


def told(read, *args, **options):
    """What is read (None for an error), and the warnings."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result, offset = None, None
        try:
            result = read(*args, **options)
        except EventFileError as error:
            offset = error.offset
    assert offset is None or 0 <= offset <= len(args[0])
    assert all(warning.category is EventFileWarning for warning in found), [str(w.message) for w in found]
    return result, found


def parts(data, **options):
    return np.concatenate([np.zeros(0, EVENT), *(part.records() for part in stream(data, **options))])


def check(data, name, format=None):
    """Read a file in all ways that there are, and say whether all of it was right."""
    began = time.process_time()
    strict, quiet = told(load, data, name=name, format=format)
    lenient, loud = told(load, data, name=name, format=format, strict=False)
    streamed, _ = told(parts, data, name=name, format=format, strict=False)
    at_once, _ = told(parts, data, name=name, format=format)
    assert time.process_time() - began < SECONDS
    assert not quiet
    assert (lenient is not None) == opens(data, name, format)
    assert (streamed is None) == (lenient is None)
    assert (at_once is None) == (strict is None)
    if lenient is not None:
        Events(lenient.t, lenient.x, lenient.y, lenient.p, lenient.sensor_size)
        assert np.array_equal(streamed, lenient.records())
        assert bool(loud) == (strict is None)
    if strict is not None:
        assert strict == lenient
        assert np.array_equal(at_once, strict.records())
    return strict is not None


@pytest.fixture(params=[64, files.BLOCK], ids=["small blocks", "blocks"])
def block(request, monkeypatch):
    """How many bytes `stream` reads at once."""
    monkeypatch.setattr(files, "BLOCK", request.param)


@st.composite
def damaged(draw, data):
    """A file, cut or with bytes flipped or inserted, more often near its beginning."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.one_of(st.integers(0, min(len(data), 300)), st.integers(0, len(data))))
        how = draw(st.sampled_from(["cut", "flip", "insert"]))
        if how == "cut":
            data = data[:at]
        elif how == "insert":
            data = data[:at] + draw(st.binary(min_size=1, max_size=12)) + data[at:]
        elif at < len(data):
            data = data[:at] + bytes([data[at] ^ draw(st.integers(1, 255))]) + data[at + 1 :]
    return data


def given_examples(format, slow=5, fast=40):
    return slow if len(sample(format)) > 20_000 else fast


@pytest.mark.parametrize("format", NAMES)
def test_whole(format):
    assert check(sample(format), f"a{KNOWN[format].suffixes[0]}")


@pytest.mark.parametrize("format", NAMES)
@pytest.mark.usefixtures("block")
def test_damaged(format):
    whole = sample(format)

    @given(st.data())
    @settings(max_examples=given_examples(format), deadline=None, suppress_health_check=list(HealthCheck))
    def run(data):
        check(data.draw(damaged(whole)), f"a{KNOWN[format].suffixes[0]}")

    run()


@pytest.mark.parametrize("format", NAMES)
def test_any_bytes(format):
    head = sample(format)[:200]

    @given(st.integers(0, len(head)), st.binary(max_size=200))
    @settings(max_examples=40, deadline=None)
    def run(kept, rest):
        check(head[:kept] + rest, f"a{KNOWN[format].suffixes[0]}")
        check(head[:kept] + rest, "a", format)

    run()


@pytest.mark.parametrize("format", NAMES)
def test_empty(format):
    check(b"", f"a{KNOWN[format].suffixes[0]}")
    check(b"", "a", format)


@pytest.mark.parametrize("format", NAMES)
def test_mislabelled(format):
    """A file under another name or read as another format."""
    data = sample(format)
    signed = KNOWN[format].knows(data[:HEAD])
    for other in NAMES:
        right = check(data, f"a{KNOWN[other].suffixes[-1]}")
        assert right or not signed
        check(data[:20_000], "a", other)
