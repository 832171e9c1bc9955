"""A file of each format: of its own writer, or made here."""

import io
import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest

import bags
from neuro.events import Events, save
from neuro.events.formats import FORMATS

KNOWN = {f.name: f for f in FORMATS.values()}


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
    return _sample("evt2").split(b"% end\n")[-1]


def _mat():
    from scipy.io import savemat

    k, data = np.arange(60), io.BytesIO()
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


def _rosbag1():
    rows = [[(20 * j + k, k % 30, 7 * k % 34, k % 2) for k in range(20)] for j in range(3)]
    messages = (bags.message(bags.packet(bags.mono(some, 0), size=(34, 34))) for some in rows)
    return bags.bag(bags.connection(bags.PACKET), *messages)


MADE = {
    "aedat3": _aedat3, "aedat4": _aedat4, "evt21": _evt21, "mat": _mat, "raw": _raw, "rosbag1": _rosbag1,
    "rosbag2": _rosbag2,
}  # fmt: skip
_samples = {}


def _sample(name):
    """The bytes of a file of a format."""
    if name not in _samples:
        _samples[name] = MADE[name]() if name in MADE else written(KNOWN[name])
    return _samples[name]


def written(format):
    k = np.arange(60)
    events = Events(1000 * k, k % 30, (7 * k) % 34, k % 2, (34, 34))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{format.suffixes[0]}"
        save(events, path, format=format.name)
        return path.read_bytes()


@pytest.fixture(scope="session")
def sample():
    """The bytes of a file of a format, by its name."""
    return _sample
