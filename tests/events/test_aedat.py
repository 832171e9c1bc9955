"""AEDAT 2.0 and 3.1."""

import io
import struct
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from event_tests import read_pieces, refusal, rows
from neuro.events import EventFileWarning, Events, load, save, stream
from neuro.events.files import size_of
from neuro.events.formats.aedat import AEDAT3, Aedat2, Aedat3
from neuro.events.info import info
from neuro.events.source import Source

HEADER = b"#!AER-DAT2.0\r\n# made for a test\r\n"
DAVIS = HEADER + b"# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End of Preferences for this AEChip\r\n"
LINES = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 0: DVS128\r\n#Start-Time: 2016-09-21 14:40:38 (TZ+0000)\r\n"
HEADER3 = LINES + b"#!END-HEADER\r\n"
POLARITY, SPECIAL = 1, 0


def words(*pairs):
    return b"".join(struct.pack(">II", address, time) for address, time in pairs)


def packet(events, kind=POLARITY, camera=0, overflow=0, size=8, **other):
    """A packet of the specification: the header and events, each the bytes of one."""
    n = other.get("number", len(events))
    counts = (other.get("capacity", n), n, other.get("valid", n))
    return struct.pack("<hhiiiiii", kind, camera, size, 4, overflow, *counts) + b"".join(events)


def event(t, x, y, p=1, valid=1):
    return struct.pack("<Ii", x << 17 | y << 2 | p << 1 | valid, t)


def test_poker_dvs_is_as_published(shared):
    folder = shared / "data" / "poker_dvs"
    arrays = np.load(folder / "poker_dvs_shared.npz")
    with zipfile.ZipFile(folder / "poker_dvs_shared_aedat2.zip") as files:
        known = {name: k for k, name in enumerate(arrays["names"]) if f"{name}.aedat" in files.namelist()}
        assert len(known) >= 60
        columns = {key: arrays[key] for key in "xyp"}
        for name, k in list(known.items())[::4]:
            events = load(files.read(f"{name}.aedat"), name=f"{name}.aedat")
            part = slice(arrays["offsets"][k], arrays["offsets"][k + 1])
            assert all(np.array_equal(columns[key][part], getattr(events, key)) for key in "xyp"), name


def test_fields():
    external = (1 << 15, 8), (1 << 31, 8), (1 << 31 | 1 << 15, 8)  # as jAER marks them: bit 15 or 31
    events = load(HEADER + words((5 << 8 | 9 << 1, 7), *external, (5 << 8 | 9 << 1 | 1, 9)))
    assert rows(events) == [(7, 9, 5, 1), (9, 9, 5, 0)]
    assert events.metadata == {"format": "aedat2", "t0": 7, "chip": "DVS128", "other_words": 0, "external_events": 3}
    davis = load(DAVIS + words((5 << 22 | 9 << 12 | 1 << 11, 7), (1 << 31, 8), (1 << 10, 8), (140 << 22, 9)))
    assert rows(davis) == [(7, 239 - 9, 179 - 5, 1), (9, 239, 179 - 140, 0)]
    assert davis.metadata == {"format": "aedat2", "t0": 7, "chip": "DAVIS240", "other_words": 1, "external_events": 1}


CHIPS = {
    (128, 128): ["ch.unizh.ini.jaer.chip.retina.DVS128", "ch.unizh.ini.jaer.chip.retina.Tmpdiff128"],
    (240, 180): ["davis.DAVIS240A", "DAViS.SBret10", "davis.DVS240"],
    (346, 260): ["davis.Davis346blue", "davis.DAVIS346cBSI", "DAVI346"],
    (640, 480): ["davis.Davis640", "davis.DavisRGBW640"], (208, 192): ["davis.Davis208PixelParade"],
}  # fmt: skip
"""Names of cameras as they stand in headers, those of a Davis without what all begin with."""
SOURCES = {"DVS128": (128, 128), "DAVIS240C": (240, 180), "DAVIS346B": (346, 260), "Davis640": (640, 480)}


def test_cameras():
    for size, names in CHIPS.items():
        for name in names:
            full = f"eu.seebetter.ini.chips.{name}" if name.lower().startswith("davis.") else name
            assert load(chip(full)).sensor_size == size, name
    for name, size in SOURCES.items():
        assert load(HEADER3.replace(b"DVS128", name.encode())).sensor_size == size, name


def test_where_the_header_ends():
    first = 140 << 22  # its first byte is that of '#'
    assert words((first, 1))[:1] == b"#"
    assert load(DAVIS + words((first, 1), (0, 13 << 8 | 10))).t.tolist() == [1, 13 << 8 | 10]
    text = b"#ab !cd\r\n#efghi\n"  # two words that are lines of text as well
    assert Aedat2(Source(DAVIS + b"#End Of ASCII Header\r\n" + text)).start == len(DAVIS) + 22
    long = HEADER + b"".join(b"#<entry key=%d/>\r\n" % k for k in range(20_000)) + words((2, 5))
    for given_as in (long, io.BytesIO(long)):
        assert rows(load(given_as, name="a.aedat")) == [(5, 1, 0, 1)]
    assert [part.t.tolist() for part in stream(io.BytesIO(long))] == [[5]]


def test_clock_wraps():
    assert load(HEADER + words((2, 2**32 - 5), (2, 3))).t.tolist() == [2**32 - 5, 2**32 + 3]
    late = HEADER + words((0, 2**32 - 5), (2, 3), (4, 2**32 - 1), (6, 4))
    assert load(late, sort=True).t.tolist() == [2**32 - 5, 2**32 - 1, 2**32 + 3, 2**32 + 4]
    assert load(late, sort=True).x.tolist() == [0, 2, 1, 3]


def chip(name):
    return HEADER + f"# AEChip: {name}\r\n".encode()


def jaer(t, x, y, p, size):
    """The word that jAER and v2e write for an event of a DAVIS with y downwards."""
    return (size[1] - 1 - y) << 22 | (size[0] - 1 - x) << 12 | p << 11, t


DAVIS_SIZES = [(240, 180), (346, 260), (640, 480)]


def test_davis_stands_upright(shared):
    """The tip of an arrow that points upwards is its first event and its highest."""
    events = load(shared / "cases" / "davis346_arrow.aedat")
    assert (rows(events)[0], events.sensor_size, int(events.y.min())) == ((1000, 100, 50, 1), (346, 260), 50)
    unnamed = load(shared / "cases" / "davis346_without_chip_name.aedat", sensor_size=(346, 260))
    assert rows(unnamed)[0] == (1000, 100, 50, 0)
    boxes = load(shared / "data" / "formats" / "davis240_translBoxes.aedat")
    # Of two boxes on each other the lower one lies further to the right; a tall one stands to the left of both.
    seen = boxes[20_000:45_000]
    right = seen[(seen.x >= 198) & (seen.x < 218)]
    assert (right.y >= 115).sum() > 5 * (right.y < 115).sum()


@pytest.mark.parametrize("size", DAVIS_SIZES)
@given(data=st.data())
def test_davis_is_read_and_written_as_by_jaer(data, size):
    event = st.tuples(
        st.integers(0, 10**6), st.integers(0, size[0] - 1), st.integers(0, size[1] - 1), st.integers(0, 1)
    )
    wanted = sorted(data.draw(st.lists(event, min_size=1, max_size=20)), key=lambda row: row[0])
    encoded = words(*(jaer(*row, size) for row in wanted))
    name = {240: "DAVIS240C", 346: "Davis346blue", 640: "Davis640"}[size[0]]
    named = load(chip(f"eu.seebetter.ini.chips.davis.{name}") + encoded)
    unnamed = load(HEADER + encoded, sensor_size=size)
    assert rows(named) == rows(unnamed) == wanted
    assert named.sensor_size == unnamed.sensor_size == size
    with tempfile.TemporaryDirectory() as folder:
        save(named, Path(folder) / "a.aedat")
        assert (Path(folder) / "a.aedat").read_bytes().endswith(b"#End Of ASCII Header\r\n" + encoded)
        assert load(Path(folder) / "a.aedat") == named


def one(*event, size=(346, 260), header=HEADER):
    return header + words(jaer(*event, size))


OPTION = "sensor_size=(346, 260), or --sensor 346x260, chooses the camera by its sensor (128x128, "
READS = (load, lambda *given, **words: list(stream(*given, **words)), size_of, info)


@pytest.mark.parametrize("read", READS)
def test_the_sensor_of_a_file_without_a_chip(read):
    what = "no line '# AEChip:' names the camera, and address 0x344f5800 is impossible for a DVS128"
    assert f"a.aedat: byte {len(HEADER)}: {what}: {OPTION}" in refusal(read, one(5, 100, 50, 1), name="a.aedat")
    corner = one(5, 345, 259, 1)  # its address is also one of a DVS128
    told = refusal(read, corner, name="a.aedat")
    assert f"byte {len(HEADER)}: no line '# AEChip:' names the camera, and the addresses may be from a DVS128" in told
    assert OPTION in told


def test_the_size_chooses_the_camera():
    told = refusal(load, one(5, 100, 50, 1), name="a.aedat", sensor_size=(300, 200))
    assert "names the camera, and no camera has a sensor of 300x200: " + OPTION in told
    corner = one(5, 345, 259, 1)
    for read in (load, lambda *given, **words: next(stream(*given, **words))):
        assert rows(read(corner, sensor_size=(346, 260))) == [(5, 345, 259, 1)]
        assert rows(read(corner, sensor_size=(128, 128))) == [(5, 0, 8, 1)]
        assert rows(read(one(5, 7, 9, 1, size=(208, 192)), sensor_size=(208, 192))) == [(5, 7, 9, 1)]
    assert info(corner, sensor_size=(346, 260)).metadata["chip"] == "DAVIS346"
    small = HEADER + words((5 << 8 | 9 << 1, 7))
    assert rows(load(small, sensor_size=(30, 30))) == rows(load(small)) == [(7, 9, 5, 1)]


@pytest.mark.parametrize("place", [1, 11, 2047, 2048, 5000])
@pytest.mark.parametrize("read", READS[:2])
def test_one_address_proves_that_it_is_no_dvs128(read, place):
    data = HEADER + words(*[(0x802, k) for k in range(place)], (0x10800, place), (0x802, place + 1))
    where = f"a.aedat: byte {len(HEADER) + 8 * place}: "
    for size in (None, (128, 128), (100, 100)):
        told = refusal(read, data, name="a.aedat", sensor_size=size)
        assert told.startswith(where)
        assert "address 0x00010800 is impossible for a DVS128: " + OPTION in told
        assert "--from aedat2:davis128" in told


def test_events_off_the_sensor_name_the_option():
    for data, size in ((one(5, 0, 0, 1), (240, 180)), (HEADER + words((5 << 8 | 120 << 1, 7)), (100, 100))):
        assert OPTION in refusal(load, data, name="a.aedat", sensor_size=size)
    assert OPTION in refusal(load, one(5, 0, 0, 1, header=DAVIS), name="a.aedat")


@pytest.mark.parametrize(
    ("name", "size"), [("davis128", (128, 128)), ("davis208", (208, 192)), ("davis346", (346, 260))]
)
@pytest.mark.parametrize(
    "header", [HEADER, DAVIS, HEADER + b"# AEChip: x.DVS128\r\n", HEADER + b"# AEChip: SBret21\r\n"]
)
def test_the_name_of_the_camera_may_be_given(name, size, header):
    events = load(one(5, 30, 20, 1, size=size, header=header), format=f"aedat2:{name}")
    assert (rows(events), events.sensor_size) == ([(5, 30, 20, 1)], size)
    assert load(one(5, 30, 20, 1, size=size), format=f"aedat2:{name}", sensor_size=(400, 400)).x.tolist() == [30]


@pytest.mark.parametrize("title", ["SBret20", "SBret21", "DVXplorer", "dvs346", "DAVIS192", "DAVIS240C", "DVS128"])
def test_the_size_overrides_a_chip_that_is_unknown_or_wrong(title):
    data = one(5, 100, 50, 1, header=chip(title))
    assert OPTION in refusal(load, data, name="a.aedat")
    events = load(data, sensor_size=(346, 260))
    assert (rows(events), events.metadata["chip"]) == ([(5, 100, 50, 1)], "DAVIS346")


def test_a_larger_sensor_does_not_move_the_events_of_a_right_name(tmp_path):
    small = chip("DVS128") + words((5 << 8 | 9 << 1, 7))
    for size in DAVIS_SIZES:
        assert rows(load(small, sensor_size=size)) == [(7, 9, 5, 1)]
    one = np.array([1])
    for sensor in ((128, 128), (200, 150), (346, 260)):
        save(Events(one, one, one, one, sensor), tmp_path / "a.aedat", replace=True)
        assert rows(load(tmp_path / "a.aedat", sensor_size=(640, 480))) == [(1, 1, 1, 1)]


def test_v2e_writes_other_addresses_of_640x480():
    data = HEADER + words(((479 - 50) << 11 | (639 - 100) << 1 | 1, 1000), ((479 - 51) << 11 | (639 - 400) << 1, 1001))
    events = load(data, sensor_size=(640, 480))
    assert rows(events) == [(1000, 100, 50, 1), (1001, 400, 51, 0)]
    assert rows(load(chip("ch.unizh.ini.jaer.chip.retina.DVS640") + data[len(HEADER) :])) == rows(events)


ADDRESSES = st.sampled_from([0, 1 << 31, 1 << 10, 1 << 11, 7 << 22 | 5 << 12])


@given(st.lists(st.tuples(ADDRESSES, st.integers(0, 2**32 - 1)), min_size=1, max_size=30), st.integers(1, 100))
def test_any_block_gives_the_same(pairs, block):
    whole, parts = (Aedat2(Source(DAVIS + words(*pairs))) for _ in range(2))
    found = read_pieces(whole)
    assert (read_pieces(parts, block), parts.metadata) == (found, whole.metadata)
    events = [k for k, (address, _) in enumerate(pairs) if not address & (1 << 31 | 1 << 10)]
    assert found[1] == [len(DAVIS) + 8 * k for k in events]


def test_smallest_camera_is_written(tmp_path):
    one = np.array([1])
    for size, chip in [
        ((128, 128), "DVS128"), ((129, 2), "DAVIS240"), ((346, 260), "DAVIS346"), ((2, 900), "DAVIS640"),
    ]:  # fmt: skip
        save(Events(one, one, one, one, size), tmp_path / "a.aedat", replace=True)
        events = load(tmp_path / "a.aedat")
        assert (events.metadata["chip"], events.sensor_size) == (chip, size)


def test_fields_of_aedat3():
    data = HEADER3 + packet([event(5, 127, 2), event(6, 3, 127, p=0), event(7, 9, 9, valid=0)])
    data += packet([bytes(8)] * 2, kind=SPECIAL) + packet([bytes(36)], kind=3, size=36) + packet([])
    data += packet([event(2, 1, 2)], overflow=1)
    events = load(data)
    assert rows(events) == [(5, 127, 2, 1), (6, 3, 127, 0), (2**31 + 2, 1, 2, 1)]
    assert events.metadata == {
        "format": "aedat3", "t0": 5, "camera": "DVS128", "start": "2016-09-21 14:40:38 (TZ+0000)",
        "other_events": 3, "invalid_events": 1,
    }  # fmt: skip
    assert AEDAT3.untested
    header = HEADER3.replace(b"DVS128", b"something else")
    events = load(header + packet([event(2**31 - 1, 32767, 32766)], overflow=2**31 - 1))
    assert (rows(events), events.sensor_size) == ([(2**62 - 1, 32767, 32766, 1)], (32768, 32767))


def test_signed_times_of_aedat3():
    back = HEADER3 + packet([event(4, 1, 2), event(-9, 3, 4)])
    what = "event 1: time runs back from 4 to -9 us; load(..., sort=True) sorts the events"
    assert refusal(load, back, name="a.aedat") == f"a.aedat: byte {len(HEADER3) + 36}: {what}"
    assert load(back, sort=True).t.tolist() == [-9, 4]
    assert load(HEADER3 + packet([event(-9, 1, 2), event(4, 3, 4)])).t.tolist() == [-9, 4]


def test_first_of_several_cameras():
    two = LINES.replace(b"#Source 0: DVS128\r\n", b"#Source 3: DVS128\r\n#Source 4: DAVIS240C\r\n#-Source 0: eDVS\r\n")
    data = two + b"#!END-HEADER\r\n" + packet([event(1, 2, 3)], camera=4) + packet([event(4, 5, 6)], camera=3)
    events = load(data)
    assert (rows(events), events.sensor_size, events.metadata["other_events"]) == ([(4, 5, 6, 1)], (128, 128), 1)
    one = HEADER3 + packet([event(1, 2, 3)], camera=7)  # the only camera, whatever its number
    assert rows(load(one)) == [(1, 2, 3, 1)]


EVENTS = st.builds(event, st.integers(0, 2**31 - 1), st.integers(0, 200), st.integers(0, 200), valid=st.integers(0, 1))
PACKETS = st.one_of(
    st.builds(packet, st.lists(EVENTS, max_size=5), overflow=st.integers(0, 3)),
    st.builds(packet, st.lists(st.just(bytes(8)), max_size=3), kind=st.just(SPECIAL)),
    st.builds(packet, st.lists(st.just(bytes(36)), max_size=2), kind=st.just(3), size=st.just(36)),
)


@given(st.lists(PACKETS, max_size=8), st.integers(1, 120), st.integers(0, 7))
def test_any_block_of_aedat3_gives_the_same(packets, block, cut):
    data = HEADER3 + b"".join(packets)
    data = data[: len(data) - min(cut, len(data) - len(HEADER3))]
    whole, parts = (Aedat3(Source(data)) for _ in range(2))
    found, places, damage = read_pieces(whole)
    assert (read_pieces(parts, block), parts.metadata) == ((found, places, damage), whole.metadata)
    for (t, x, y, _), place in zip(found, places, strict=True):
        word, time = struct.unpack("<II", data[place : place + 8])
        assert (word >> 17, word >> 2 & 0x7FFF, time) == (x, y, t & 0x7FFFFFFF)


ONE = HEADER3 + packet([event(1, 2, 3)])
END = len(ONE)


def test_messages(messages):
    messages.calls(globals())


@pytest.mark.parametrize(
    "wrong", [{"size": -8}, {"size": 4}, {"size": 16}, {"overflow": -1}, {"number": -1}, {"capacity": 1}, {"valid": 3}]
)
def test_wrong_packets(wrong):
    data = ONE + packet([event(1, 2, 3)] * 2, **wrong)
    assert refusal(load, data, name="a.aedat") == f"a.aedat: byte {END}: expected the header of a packet"
    with pytest.warns(EventFileWarning, match="the events before it were read"):
        assert len(load(data, name="a.aedat", strict=False)) == 1


def test_what_is_whole_is_kept():
    for rest, what in (
        (b"ab", "2 bytes left over after 1 words of 8 bytes"),
        (words((1 << 16, 1), (0, 2)), f"address 0x00010000 is impossible for a DVS128: {Aedat2.way_out}"),
    ):
        data = chip("DVS128") + words((0, 1)) + rest
        with pytest.warns(EventFileWarning) as told:
            assert load(data, name="a.aedat", strict=False).t.tolist() == [1]
        assert [str(warning.message) for warning in told] == [
            f"a.aedat: byte 59: {what}; the events before it were read"
        ]
