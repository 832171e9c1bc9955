"""Formats of five bytes an event: the ``.bin`` of N-MNIST, and Event Stream."""

import json

import numpy as np
import pytest
from hypothesis import given, strategies as st

from event_tests import read_pieces, refusal, rows
from neuro.events import EventFileError, EventFileWarning, Events, load, save
from neuro.events.formats.event_stream import LONGEST_GAP, Bin, EventStream, generic
from neuro.events.source import Source

GENERIC = b"Event Stream\x02\x00\x00\x00"
DVS = b"Event Stream\x02\x00\x00\x01" + bytes([30, 0, 44, 1])
OVERFLOW, RESET = b"\xff", b"\xfe"


def word(x, y, t, p=1):
    """An event of N-MNIST."""
    return bytes([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255])


def event(gap, x, y, p=1):
    """An event of Event Stream."""
    return bytes([gap << 1 | p, x & 255, x >> 8, y & 255, y >> 8])


def test_an_overflow_of_nmnist():
    events = load(word(1, 2, 10) + word(0, 240, 0) + word(3, 4, 20), format="nmnist")
    assert rows(events) == [(10, 1, 2, 1), (20 + 8192, 3, 4, 1)]


def test_a_sensor_that_is_given(shared):
    path = shared / "data" / "formats" / "ncaltech101_faces_easy_0001.bin"
    assert load(path, sensor_size=(240, 180)).sensor_size == (240, 180)


@given(st.lists(st.sampled_from([word(1, 2, 3), word(9, 8, 7, 0), word(5, 240, 0)]), max_size=30), st.integers(1, 60))
def test_any_block_of_nmnist(words, block):
    data = b"".join(words)
    found = read_pieces(Bin(Source(data)), block)
    assert found == read_pieces(Bin(Source(data)))
    assert found[1] == [5 * k for k, each in enumerate(words) if each[1] != 240]


BYTES = st.sampled_from([OVERFLOW, RESET, event(0, 1, 2), event(126, 254, 255, 0), event(9, 255, 254)])


@given(st.lists(BYTES, max_size=30), st.integers(1, 60))
def test_any_block_of_event_stream(parts, block):
    data = DVS + b"".join(parts)
    found = read_pieces(EventStream(Source(data)), block)
    assert found == read_pieces(EventStream(Source(data)))
    begins = np.cumsum([len(DVS), *(len(part) for part in parts)])[:-1]
    assert found[1] == [begin for begin, part in zip(begins, parts, strict=True) if len(part) == 5]


def test_fields_of_event_stream():
    data = DVS + OVERFLOW + RESET + event(3, 29, 299, 0) + event(0, 1, 254) + OVERFLOW * 2 + event(126, 254, 2)
    assert rows(load(data, sensor_size=(300, 300))) == [(130, 29, 299, 0), (130, 1, 254, 1), (510, 254, 2, 1)]
    assert load(data[:32]).sensor_size == (30, 300)
    assert load(data[:32]).metadata == {"format": "event_stream", "t0": 130, "version": "2.0.0"}


def test_rows_are_those_of_the_same_recording_in_other_files(shared):
    club = load(shared / "data" / "formats" / "es_poker_club_trcl0.es")
    arrays = np.load(shared / "data" / "poker_dvs" / "poker_dvs_shared.npz")
    k = arrays["names"].tolist().index("xclub04")
    part = slice(arrays["offsets"][k], arrays["offsets"][k + 1])
    assert part.stop - part.start == len(club)
    for name in "xyp":
        assert np.unique(arrays[name][part].astype(int) - getattr(club, name)).size == 1, name


def test_generic_events(shared):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())["es_generic.es"]
    events = generic(folder / "es_generic.es")
    assert (len(events), [events[0][0], events[0][1].decode()]) == (truth["n_events"], truth["first"])
    assert (events[-1][0], len(events[-1][1])) == (truth["last_t"], truth["last_len"])
    long = bytes(range(200))
    data = b"\x05\x06abc" + OVERFLOW + RESET + b"\x00\x01\x00\xfd" + bytes([(200 & 127) << 1 | 1, 2]) + long
    assert (generic(GENERIC + data), generic(GENERIC)) == ([(5, b"abc"), (259, b""), (512, long)], [])


def test_saving_a_file_gives_the_file(shared, tmp_path):
    path = shared / "data" / "formats" / "es_poker_club_trcl0.es"
    save(load(path), tmp_path / "a.es")
    assert (tmp_path / "a.es").read_bytes() == path.read_bytes()


def test_what_event_stream_cannot_hold(messages, tmp_path, monkeypatch):
    def of(*t, size=(10, 10)):
        return Events(np.array(t), *[np.zeros(len(t), int)] * 3, size)

    monkeypatch.chdir(tmp_path)
    wrong = {"gap": [of(1), of(1, LONGEST_GAP + 2)], "early": [of(-3, 5)], "wide": [of(1, size=(65536, 2))]}
    messages({case: refusal(save, iter(parts), "a.es") for case, parts in wrong.items()})
    assert not list(tmp_path.iterdir())


def test_messages(messages):
    messages.calls(globals())


@pytest.mark.parametrize(("read", "data", "name", "message", "count"), [
    (load, DVS + event(1, 2, 3) + b"ab", "a.es", "byte 25: the last event is cut after 2 of 5 bytes", 1),
    (generic, GENERIC + b"\x05\x06abc\x01", "a.es", "byte 21: the last event is cut after 1 bytes", 1),
    (load, word(1, 2, 3) + word(0, 240, 0) + b"ab", "a.bin", "byte 10: 2 bytes left over after 2 events of 5 bytes", 1)
])  # fmt: skip
def test_what_is_whole_is_kept(read, data, name, message, count):
    with pytest.raises(EventFileError, match=message):
        read(data, name=name)
    with pytest.warns(EventFileWarning) as told:
        assert len(read(data, name=name, strict=False)) == count
    assert [str(warning.message) for warning in told] == [f"{name}: {message}; the events before it were read"]
