import struct

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, load
from neuro.events.formats.aedat import AEDAT3, Aedat3
from neuro.events.source import Source

LINES = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 0: DVS128\r\n#Start-Time: 2016-09-21 14:40:38 (TZ+0000)\r\n"
HEADER = LINES + b"#!END-HEADER\r\n"
POLARITY, SPECIAL = 1, 0


def packet(events, kind=POLARITY, camera=0, overflow=0, size=8, **other):
    """A packet of the specification: the header and events, each the bytes of one."""
    n = other.get("number", len(events))
    counts = (other.get("capacity", n), n, other.get("valid", n))
    return struct.pack("<hhiiiiii", kind, camera, size, 4, overflow, *counts) + b"".join(events)


def event(t, x, y, p=1, valid=1):
    return struct.pack("<Ii", x << 17 | y << 2 | p << 1 | valid, t)


def test_fields():
    data = HEADER + packet([event(5, 127, 2), event(6, 3, 127, p=0), event(7, 9, 9, valid=0)])
    data += packet([bytes(8)] * 2, kind=SPECIAL) + packet([bytes(36)], kind=3, size=36) + packet([])
    data += packet([event(2, 1, 2)], overflow=1)
    events = load(data)
    assert events.records().tolist() == [(5, 127, 2, 1), (6, 3, 127, 0), (2**31 + 2, 1, 2, 1)]
    assert events.sensor_size == (128, 128)
    assert events.metadata == {
        "format": "aedat3", "t0": 5, "camera": "DVS128", "start": "2016-09-21 14:40:38 (TZ+0000)",
        "other_events": 3, "invalid_events": 1,
    }  # fmt: skip
    assert AEDAT3.untested


def test_large_coordinates():
    header = HEADER.replace(b"DVS128", b"something else")
    events = load(header + packet([event(2**31 - 1, 32767, 32766)], overflow=2**31 - 1))
    assert events.records().tolist() == [(2**62 - 1, 32767, 32766, 1)]
    assert events.sensor_size == (32768, 32767)


@pytest.mark.parametrize(
    ("name", "size"),
    [("DVS128", (128, 128)), ("DAVIS240C", (240, 180)), ("DAVIS346B", (346, 260)), ("Davis640", (640, 480))],
)
def test_cameras(name, size):
    assert load(HEADER.replace(b"DVS128", name.encode())).sensor_size == size


def test_first_of_several_cameras():
    two = LINES.replace(b"#Source 0: DVS128\r\n", b"#Source 3: DVS128\r\n#Source 4: DAVIS240C\r\n#-Source 0: eDVS\r\n")
    data = two + b"#!END-HEADER\r\n" + packet([event(1, 2, 3)], camera=4) + packet([event(4, 5, 6)], camera=3)
    events = load(data)
    assert events.records().tolist() == [(4, 5, 6, 1)]
    assert events.sensor_size == (128, 128)
    assert events.metadata["other_events"] == 1
    one = HEADER + packet([event(1, 2, 3)], camera=7)  # the only camera, whatever its number
    assert load(one).records().tolist() == [(1, 2, 3, 1)]


EVENTS = st.builds(event, st.integers(0, 2**31 - 1), st.integers(0, 200), st.integers(0, 200), valid=st.integers(0, 1))
PACKETS = st.one_of(
    st.builds(packet, st.lists(EVENTS, max_size=5), overflow=st.integers(0, 3)),
    st.builds(packet, st.lists(st.just(bytes(8)), max_size=3), kind=st.just(SPECIAL)),
    st.builds(packet, st.lists(st.just(bytes(36)), max_size=2), kind=st.just(3), size=st.just(36)),
)


@given(st.lists(PACKETS, max_size=8), st.integers(1, 120), st.integers(0, 7))
@settings(deadline=None)
def test_any_block_gives_the_same(packets, block, cut):
    data = HEADER + b"".join(packets)
    data = data[: len(data) - min(cut, len(data) - len(HEADER))]
    results = []
    for size in (1 << 20, block):
        reader, pieces, what = Aedat3(Source(data)), [], None
        try:
            pieces.extend(reader.pieces(size))
        except ValueError as damage:
            what = damage.args
        columns = [[int(v) for piece in pieces for v in getattr(piece, name)] for name in "txyp"]
        assert all(piece.ordered == bool(np.all(np.diff(piece.t) >= 0)) for piece in pieces)
        highest = np.max([piece.highest for piece in pieces], axis=0, initial=-1).tolist()
        places = [piece.place(k) for piece in pieces for k in range(piece.t.size)]
        results.append((columns, highest, places, reader.metadata, what))
    assert results[0] == results[1]
    for k, place in enumerate(results[0][2]):
        word, t = struct.unpack("<II", data[place : place + 8])
        assert (word >> 17, word >> 2 & 0x7FFF) == (results[0][0][1][k], results[0][0][2][k])
        assert t == results[0][0][0][k] & 0x7FFFFFFF


ONE = HEADER + packet([event(1, 2, 3)])
END = len(ONE)
ERRORS = {
    f"a.aedat: byte {len(LINES)}: the header does not end, expected a line #!END-HEADER": LINES + bytes(28),
    "a.aedat: byte 12: the first line does not end": b"#!AER-DAT3.1\0",
    "a.aedat: byte 23: packets are stored as SerializedTS, expected RAW": HEADER.replace(b"RAW", b"SerializedTS"),
    f"a.aedat: byte {END}: 3 bytes left over after the last packet": ONE + b"abc",
    f"a.aedat: byte {END + 36}: the last packet is cut, 13 bytes are missing": ONE + packet([event(1, 2, 3)] * 3)[:39],
    f"a.aedat: byte {END + 33}: the last packet is cut, 7 bytes are missing": ONE + packet([b"abcde"], 3, size=12),
    f"a.aedat: byte {END}: expected the header of a packet": ONE + packet([bytes(8)] * 4, size=0),
    f"a.aedat: byte {END + 28}: event 1: x is 128, expected 0 to 127 (sensor 128x128)": (
        ONE + packet([event(1, 128, 3)])
    ),
    f"a.aedat: byte {END + 36}: event 1: time runs back from 1 to 0 us; load(..., sort=True) sorts the events": (
        ONE + packet([event(9, 2, 3, valid=0), event(0, 2, 3)])
    ),
}


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    with pytest.raises(EventFileError) as error:
        load(ERRORS[message], name="a.aedat")
    assert str(error.value) == message


@pytest.mark.parametrize(
    "wrong",
    [{"size": -8}, {"size": 4}, {"size": 16}, {"overflow": -1}, {"number": -1}, {"capacity": 1}, {"valid": 3}],
)
def test_wrong_packets(wrong):
    data = ONE + packet([event(1, 2, 3)] * 2, **wrong)
    with pytest.raises(EventFileError) as error:
        load(data, name="a.aedat")
    assert str(error.value) == f"a.aedat: byte {END}: expected the header of a packet"
    with pytest.warns(EventFileWarning, match="what is before it was read"):
        assert len(load(data, name="a.aedat", strict=False)) == 1
