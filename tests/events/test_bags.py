import re
import struct
import sys

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bags import ARRAY, PACKET, array, bag, connection, message, mono, packet, record, sized
from event_tests import damage_is_told, refusal
from neuro.core.extras import install
from neuro.events import EventFileError, EventFileWarning, load, stream
from neuro.events.formats import Damage, rosbag
from neuro.events.source import Source

NAME = "ros1_event_camera_msgs_evt3.bag"
ROWS = [(1_000_000_000_000_005, 1, 2, 1), (1_000_000_000_000_007, 3, 4, 0), (1_000_000_000_999_999, 639, 479, 1)]


@pytest.fixture(scope="module")
def real(shared):
    return shared / "data" / "formats" / NAME


def test_a_cut_bag_gives_what_is_whole(real):
    """Without the index at the end, which other readers need."""
    data, whole = real.read_bytes(), load(real)
    assert whole.metadata == {
        "format": "rosbag1", "t0": 7139845, "topic": "/event_camera/events", "message": PACKET, "encoding": "evt3",
        "topics": [],
    }  # fmt: skip
    pieces = list(rosbag.Ros1Bag(Source(real)).pieces(100_000))
    assert len(pieces) > 10
    assert sum(piece.t.size for piece in pieces) == len(whole)
    for share in (0.5, 0.9):
        cut = data[: int(len(data) * share)]
        with pytest.raises(EventFileError, match="the file ends in a record") as error:
            load(cut)
        with pytest.warns(EventFileWarning, match=f"byte {error.value.offset}: the file ends in a record"):
            part = load(cut, strict=False)
        assert error.value.offset < len(cut)
        assert share - 0.3 < len(part) / len(whole) < share + 0.1
        assert np.array_equal(part.records(), whole.records()[: len(part)])


@pytest.mark.parametrize("packed", ["none", "bz2", "lz4"])
def test_event_arrays(packed):
    """dvs_msgs from its definition: no recording was at hand."""
    data = bag(connection(ARRAY), message(array(ROWS[:2])), message(array([])), message(array(ROWS[2:])), packed=packed)
    events = load(data)
    assert (events.records().tolist(), events.sensor_size) == (ROWS, (640, 480))
    assert events.metadata["encoding"] == "EventArray"


def test_mono_packets():
    base = 10**18
    first, second = mono(ROWS[:2], base), mono(ROWS[2:], base)
    packets = [message(packet(part, base=base)) for part in (first, second)]
    assert load(bag(connection(PACKET), *packets)).records().tolist() == ROWS
    swapped = np.frombuffer(first, "<u8").astype(">u8").tobytes()
    events = load(bag(connection(PACKET), message(packet(swapped, base=base, big=True))))
    assert events.records().tolist() == ROWS[:2]


def test_evt3_goes_on_from_packet_to_packet():
    words = [0x8001, 0x6002, 0x0005, 0x2807, 0x6003, 0x2009]
    data = [np.array(part, "<u2").tobytes() for part in (words[:2], words[2:5], words[5:])]
    expected = [(4098, 7, 5, 1), (4099, 9, 5, 0)]
    for big in (False, True):
        order = ">u2" if big else "<u2"
        parts = [np.frombuffer(part, "<u2").astype(order).tobytes() for part in data]
        packets = [message(packet(part, "evt3", size=(0, 0), big=big)) for part in parts]
        events = load(bag(connection(PACKET), *packets))
        assert (events.records().tolist(), events.sensor_size) == (expected, (10, 6))


def test_other_topics_are_left_out():
    others = connection("sensor_msgs/Imu", 1, b"/imu"), message(b"abc", 1), connection(ARRAY, 2, b"/right")
    events = load(bag(connection(ARRAY), *others, message(array(ROWS)), message(array(ROWS[:1]), 2)))
    assert (events.records().tolist(), events.metadata["topics"]) == (ROWS, ["/right"])


BEGIN = 13 + len(record(3, b" " * 99))


def test_messages(messages):
    messages.calls(globals())


def test_damage_is_told():
    packets = message(packet(mono(ROWS, 10**18), base=10**18)), message(array(ROWS))
    damage_is_told(
        [bag(connection(ARRAY), message(array(ROWS)), packed="bz2"), bag(connection(PACKET), *packets)], "rosbag1"
    )


def cdr_packet(payload, encoding="mono", base=0):
    data = struct.pack("<iI", 0, 0) + sized(b"cam\0")
    data += struct.pack("<II", 480, 640) + bytes(-(len(data) + 8) % 8) + struct.pack("<QQ", 7, base)
    data += sized(encoding.encode() + b"\0") + b"\0"
    return b"\0\1\0\0" + data + bytes(-len(data) % 4) + sized(payload)


def cdr_array(rows):
    data = struct.pack("<iI", 0, 0) + sized(b"frame\0\0\0") + struct.pack("<III", 480, 640, len(rows))
    for t, x, y, p in rows:
        data += bytes(len(data) % 2) + struct.pack("<HH", x, y)
        data += bytes(-len(data) % 4) + struct.pack("<II", *divmod(t * 1000, 10**9)) + bytes([p])
    return b"\0\1\0\0" + data


HEAD = "std_msgs/Header header\nuint32 height\nuint32 width\n"
MESSAGE_TYPES = {
    PACKET: HEAD + "uint64 seq\nuint64 time_base\nstring encoding\nbool is_bigendian\nuint8[] events\n",
    ARRAY: HEAD + "dvs_msgs/Event[] events\n",
}


def ros2(folder, kind, contents, plugin):
    store = get_typestore(Stores.ROS2_HUMBLE)
    event = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
    store.register(get_types_from_msg(event, "dvs_msgs/msg/Event"))
    full = kind.replace("/", "/msg/")
    store.register(get_types_from_msg(MESSAGE_TYPES[kind], full))
    with Writer(folder, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        topic = writer.add_connection("/events", full, typestore=store)
        for k, data in enumerate(contents):
            writer.write(topic, 100 + k, data)
            assert store.deserialize_cdr(data, full).header.stamp.sec == 0
    return next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_ros2(tmp_path, plugin):
    base = 10**18
    packets = [cdr_packet(mono(part, base), base=base) for part in (ROWS[:2], ROWS[2:])]
    path = ros2(tmp_path / "packets", PACKET, packets, plugin)
    events = load(path)
    assert (events.records().tolist(), events.sensor_size, load(path.read_bytes())) == (ROWS, (640, 480), events)
    arrays = ros2(tmp_path / "arrays", ARRAY, [cdr_array(ROWS[:1]), cdr_array([]), cdr_array(ROWS[1:])], plugin)
    assert (load(arrays).records().tolist(), [len(part) for part in stream(arrays, count=2)]) == (ROWS, [2, 1])
    assert "not an intact ROS 2 bag: " in refusal(load, path.read_bytes()[:200], format="rosbag2")


def test_ros2_with_big_endian_messages():
    data = b"\0\0" + cdr_array(ROWS)[2:]
    with pytest.raises(Damage, match="expected little-endian CDR"):
        rosbag.packet(np.frombuffer(data, np.uint8), "EventArray", True)


def test_a_missing_package_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(EventFileError, match=re.escape(f"needs the package rosbags: {install('events')}")):
        load(b"SQLite format 3\0", format="rosbag2")
