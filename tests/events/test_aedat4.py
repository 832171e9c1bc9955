import hashlib
import io
import json
import re
import struct
import sys
import warnings
from functools import partial

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings, strategies as st

from event_tests import damage_is_told, read_pieces, refusal
from neuro.core.extras import install
from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats import aedat4
from neuro.events.formats.aedat4 import RECORD, Aedat4
from neuro.events.source import Source

FILES = ["dvxplorer_lite_320x240.aedat4", "davis346_aestream.aedat4", "davis346_small.aedat4"]
INFO = (
    "<dv><node name='outInfo'>"
    "<node name='0'><attr key='typeIdentifier'>EVTS</attr>{size}</node>"
    "<node name='1'><attr key='typeIdentifier'>FRME</attr></node></node></dv>"
)
SIZE = "<node name='info'><attr key='sizeX'>40</attr><attr key='sizeY'>30</attr><attr key='source'>cam</attr></node>"


def table(kind, *fields):
    """A FlatBuffer: a root table whose fields are numbers or (items, count, bytes)."""
    vtable = struct.pack("<HH", 4 + 2 * len(fields), 4 + 8 * len(fields))
    vtable += b"".join(struct.pack("<H", 4 + 8 * k) for k in range(len(fields)))
    begin = 8 + len(vtable)
    body, tail = struct.pack("<i", len(vtable)), b""
    for k, field in enumerate(fields):
        if isinstance(field, int):
            body += struct.pack("<q", field)
        else:
            count, data = field
            place = begin + 4 + 8 * k
            body += struct.pack("<Q", begin + 4 + 8 * len(fields) + len(tail) - place)
            tail += struct.pack("<I", count) + data
    return struct.pack("<I", begin) + kind + vtable + body + tail


def sized(data):
    return struct.pack("<I", len(data)) + data


def events_table(rows):
    records = np.zeros(len(rows), RECORD)
    for name, values in zip("txyp", np.array(rows).reshape(-1, 4).T, strict=True):
        records[name] = values
    return sized(table(b"EVTS", (len(rows), records.tobytes())))


def packet(data, stream=0):
    return struct.pack("<ii", stream, len(data)) + data


def header(compression=0, end=-1, info=None):
    text = (INFO.format(size=SIZE) if info is None else info).encode()
    return b"#!AER-DAT4.0\r\n" + sized(table(b"IOHE", compression, end, (len(text), text)))


ROWS = [(5, 1, 2, 1), (6, 3, 4, 0)]


@pytest.mark.parametrize("name", FILES)
def test_streams_are_the_known_ones(shared, name):
    path = shared / "data" / "formats" / name
    truth = json.loads((path.parent / "truth.json").read_text())[name]
    metadata, singular = load(path).metadata, {"frames": "frame"}
    types = {k: singular.get(stream["type"], stream["type"]) for k, stream in metadata["streams"].items()}
    assert types == {k: stream["type"] for k, stream in truth["streams"].items()}
    others = {singular.get(kind, kind): count for kind, count in metadata["other_packets"].items()}
    assert (others, metadata["compression"]) == (truth["other_packets"], "LZ4")


def test_cut_in_a_packet_gives_the_packets_before(shared):
    """Cut at places all over the file: strict names the packet, else the whole ones are there."""
    name = "davis346_small.aedat4"
    data = (shared / "data" / "formats" / name).read_bytes()
    whole, starts, counts = load(data), [14 + 4 + struct.unpack_from("<I", data, 14)[0]], [0]
    for _ in range(50):
        number, size = struct.unpack_from("<ii", data, starts[-1])
        counts.append(counts[-1] + (number == 0))
        starts.append(starts[-1] + 8 + size)
    seen = set()
    for k in (0, 1, 7, 20, 49):
        for cut in (starts[k] + 1, starts[k] + 8, starts[k] + 9, starts[k + 1] - 1):
            with pytest.raises(EventFileError, match="the file ends") as error:
                load(data[:cut])
            assert error.value.offset == starts[k]
            with pytest.warns(
                EventFileWarning, match=f"byte {starts[k]}: the file ends.*the events before it were read"
            ):
                part = load(data[:cut], strict=False)
            assert np.array_equal(part.records(), whole.records()[: len(part)])
            seen.add((counts[k], len(part)))
    assert len(seen) == len({count for count, _ in seen})
    assert max(length for _, length in seen) > 6000
    assert "the file ends before its table of packets" in refusal(load, data[: starts[10]])


@pytest.mark.parametrize("compression", [0, 1, 2, 3, 4])
def test_compressions(compression):
    pack = {0: bytes, 1: lz4.frame.compress, 3: zstandard.compress}[(compression + 1) // 2 * 2 - (compression > 0)]
    frames = packet(pack(b"a picture"), 1)
    data = header(compression) + packet(pack(events_table(ROWS))) + frames + packet(pack(events_table([])))
    events = load(data)
    assert (events.records().tolist(), events.sensor_size) == (ROWS, (40, 30))
    told = {"0": {"type": "events", "width": 40, "height": 30, "source": "cam"}, "1": {"type": "frames"}}
    assert events.metadata == {
        "format": "aedat4", "t0": 5, "compression": ["none", "LZ4", "LZ4", "Zstandard", "Zstandard"][compression],
        "streams": told, "other_packets": {"frames": 1},
    }  # fmt: skip


def test_sensor_that_is_not_told():
    plain = header(info=INFO.format(size=""))
    assert (load(plain + packet(events_table(ROWS))).sensor_size, len(load(plain))) == ((4, 5), 0)
    assert "a packet has an event at a negative position" in refusal(
        load, plain + packet(events_table([(1, -1, 0, 1)]))
    )


def test_the_second_stream_of_events_is_counted():
    info = INFO.format(size=SIZE).replace("FRME", "EVTS")
    events = load(header(info=info) + packet(events_table([(1, 2, 3, 1)]), 1) + packet(events_table(ROWS)))
    assert (events.records().tolist(), events.metadata["other_packets"]) == (ROWS, {"events": 1})


HEAD = len(header())


def test_messages(messages):
    messages.calls(globals())


def test_damage_is_told():
    packs = (bytes, lz4.frame.compress)
    damage_is_told([header(k) + packet(pack(events_table(ROWS))) * 3 for k, pack in enumerate(packs)], "aedat4")


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(EventFileError, match=re.escape(f"needs the package zstandard: {install('events')}")):
        load(header(3) + packet(b""))


usual_lz4 = partial(lz4.frame.compress, store_size=False)
checked_lz4 = partial(lz4.frame.compress, content_checksum=True)
apart_lz4 = partial(lz4.frame.compress, store_size=False, block_linked=False)


def other_layout(rows):
    """Further fields before the events, as a later schema might have."""
    return sized(table(b"EVTS", (len(rows), events_table(rows)[-16 * len(rows) :] if rows else b""), 7))


@given(st.data())
@settings(max_examples=80)
def test_packets_that_are_not_alike(data):
    """Other layouts, packings and streams between each other; the file in blocks and cut gives the same events."""
    compression = data.draw(st.sampled_from([0, 1]))
    pack = st.sampled_from([bytes] if not compression else [usual_lz4, usual_lz4, checked_lz4, apart_lz4])
    found, packets, ends = [], [], [(len(header()), 0)]
    for k in range(data.draw(st.integers(0, 8))):
        made = [(10 * k + i, (k * i) % 40, i % 30, i % 2) for i in range(data.draw(st.sampled_from([0, 1, 3, 200])))]
        layout = data.draw(st.sampled_from([events_table, events_table, other_layout]))
        other = data.draw(st.sampled_from([b"", b"", packet(b"a picture", 1)]))
        packets.append(other + packet(data.draw(pack)(layout(made))))
        found += made
        ends.append((ends[-1][0] + len(packets[-1]), len(found)))
    whole = header(compression) + b"".join(packets)
    assert load(whole, sort=True) == load(io.BytesIO(whole), name="a.aedat4", sort=True)
    for block in (64, 1 << 20):
        assert read_pieces(Aedat4(Source(whole)), block)[0] == found
    cut = data.draw(st.integers(len(header()), len(whole)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EventFileWarning)
        part = load(whole[:cut], strict=False, sort=True)
    assert len(part) == max(count for end, count in ends if end <= cut)


def test_offsets_after_the_events():
    """Two packets that begin alike, whose last number says which of two vectors holds the events."""

    def made(field):
        vectors = [struct.pack("<I", 1) + np.array([(*row, (0, 0, 0))], RECORD).tobytes() for row in ROWS]
        table = struct.pack("<iII", 8 - 60, 20 - 12, 40 - 16)
        return sized(struct.pack("<I", 8) + b"EVTS" + table + b"".join(vectors) + struct.pack("<HHH", 6, 12, field))

    assert load(header() + packet(made(4)) + packet(made(8))).records().tolist() == ROWS


def test_what_is_like_the_packet_before_is_decoded_at_once(monkeypatch):
    """Few packets are looked at one by one: the first, the last for want of bytes after it, and those without room."""
    one, seen = Aedat4._add, []
    monkeypatch.setattr(
        Aedat4, "_add", lambda self, held, place, *rest: (seen.append(place), one(self, held, place, *rest))
    )
    for compression, pack in ((0, bytes), (1, usual_lz4)):
        packets = [packet(pack(events_table([(k, 1, 2, 1)] * 50))) for k in range(100)]
        whole = header(compression) + b"".join(packets)
        seen.clear()
        assert (len(load(whole)), seen[0]) == (5000, len(header()))
        assert len(seen) < 8


def steps(n):
    t = 3 * np.arange(n)
    return Events(1_600_000_000_000_000 + t, t % 346, t % 260, t % 2, (346, 260))


def test_what_is_written_is_what_others_read(tmp_path, monkeypatch):
    """A file of these bytes was read by dv-processing 2.0.4, aedat 2.3.0 and faery 0.7.1, event for event."""
    monkeypatch.setattr(aedat4, "_packer", lambda: (0, bytes))
    events = steps(20_000)
    save([events[:5], events[5:5], events[5:]], tmp_path / "a.aedat4")
    data = (tmp_path / "a.aedat4").read_bytes()
    assert hashlib.sha256(data).hexdigest() == "4598f667f5e5a6335df53e32653d6067923435297fcbdefc6c69d7fce6cba44e"
    assert load(data) == events


@pytest.mark.parametrize("packed", [True, False])
def test_writing_and_reading(tmp_path, monkeypatch, packed):
    if not packed:
        monkeypatch.setattr(aedat4, "_packer", lambda: (0, bytes))
    for events in (steps(0), steps(20_000)):
        save(events, tmp_path / "a.aedat4", replace=True)
        again = load(tmp_path / "a.aedat4")
        assert (again, again.metadata["compression"]) == (events, "LZ4" if packed else "none")
    assert [len(part) for part in stream(tmp_path / "a.aedat4", count=7000)] == [7000, 7000, 6000]
