"""What functions of events refuse, each with its whole message; arguments that YAML can say are in `golden`."""

import io
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from event_tests import refusal
from neuro import events
from neuro.events import DVS, EventFileError, Events, dvs_events, filters, frames_of, load, msd_segments, save
from neuro.events.filters import Flip, Scale, Shift, ShotNoise, Transpose, chain, hot_pixels
from neuro.events.pictures import gif, view
from neuro.events.representations import LeakySurface, TimeSurface

SIZE = (9, 6)
FOUR = Events([1, 2, 3, 4], [0] * 4, [0] * 4, [1] * 4, (7, 5))
ONE = Events([1], [0], [0], [1], (4, 4))
FIRST = {
    "filters": (SIZE,), "segmentation": (np.arange(3),), "representations": (FOUR,), "DVSParameters": (),
    "stream": ("there is no such file.bin",), "load": (bytes(5),),
}  # fmt: skip
GOLDEN = yaml.safe_load((Path(__file__).parent / "golden" / "messages.yaml").read_text())
CASES = [
    (getattr(events, room), room, *case) if name is None else (getattr(getattr(events, room), name), room, *case)
    for room, part in GOLDEN.items()
    for name, some in (part.items() if isinstance(part, dict) else [(None, part)])
    for case in some
]


@pytest.mark.parametrize(("call", "room", "given", "message"), CASES)
def test_arguments(call, room, given, message):
    listed, words = (given, {}) if isinstance(given, list) else ([], given)
    prefix = f"{call.__name__}: " if room == "filters" else ""
    assert refusal(call, *FIRST[room], *listed, **words) == prefix + message


def events_at(*t, size=SIZE):
    zeros = np.zeros(len(t), int)
    return Events(np.array(t, dtype=np.int64), zeros, zeros, zeros, size)


def added(kind):
    surface = kind(SIZE, tau_us=1)
    surface.add(events_at(7))
    return surface


HALF, THREE = np.full((2, 2), 0.5), np.arange(3)
OTHERS = {
    "Chain: filters = (): expected at least one": chain,
    "Chain: filter 0 is <built-in function len>, expected a filter such as TAR((346, 260))": lambda: chain(len),
    "Chain: filter 1, Flip, is for 9x6, expected 6x9": lambda: chain(Transpose(SIZE), Flip(SIZE)),
    "hot_pixels: times = 0: expected a number > 0": lambda: hot_pixels([], times=0),
    "hot_pixels: above_hz = -1: expected a number > 0": lambda: hot_pixels([], above_hz=-1),
    "hot_pixels: events of a 3x3 sensor, expected 9x6": lambda: hot_pixels([events_at(0), events_at(1, size=(3, 3))]),
    "hot_pixels: all events have one time, expected a recording that lasts, for above_hz": (
        lambda: hot_pixels(events_at(5, 5), above_hz=1.0)
    ),
    "Flip: events of a 6x9 sensor, expected 9x6": lambda: Flip(SIZE)(events_at(0, size=(6, 9))),
    "Flip: time runs back from 5 to 4 us, expected the next part of the same recording; reset() before another one": (
        lambda: list(Flip(SIZE).stream([events_at(5), events_at(4)]))
    ),
    "Shift: 9223372036854775803 us moved by 10 us, expected a time that 64 bits can hold": (
        lambda: Shift(SIZE, 10).apply(events_at(2**63 - 5))
    ),
    "Scale: 4503599627370496 us is too far from the origin at 0 us for a factor of 2.0, expected a product below 2^53 "
    "us, which is exact": lambda: Scale(SIZE, 2.0).apply(events_at(0, 2**52)),
    "ShotNoise: 1000000000000001 us would get 5.4e+10 noise events, expected at most 268435456 in one part; cut the "
    "recording, or look for a jump in its times": lambda: ShotNoise(SIZE, 1.0).apply(events_at(0, 10**15)),
    "t is float64 of shape (3,), expected whole numbers (n,) of us": lambda: msd_segments(THREE / 2),
    "event 1: time runs back from 2 to 1 us": lambda: msd_segments(THREE[::-1]),
    "window_us is 10: 200000000000 windows from 0 to 2000000000000 us, expected at most 100000000\n"
    "  hint: is the window in us, and are the times those of one recording?": (
        lambda: events.segmentation.time_segments(THREE * 10**12, 10)
    ),
    "at 6 us: events up to 7 us are already in the surface": lambda: added(TimeSurface).at(6),
    "at 5 us: events up to 7 us are already in the surface": lambda: added(LeakySurface).at(5),
    "t_us = 9.5: expected a whole number of us from -2^63 to 2^63 - 1": lambda: added(LeakySurface).at(9.5),
    "sensor_size = (0, 2): expected width and height of 1 to 65536 px": lambda: DVS((0, 2)),
    "seed = -1: expected a whole number >= 0": lambda: DVS((2, 2), seed=-1),
    "images have shape (2, 2, 2), expected (1, height, width)": lambda: dvs_events([0], np.ones((2, 2, 2))),
    "stop_us is 2, expected at least start_us, 3": lambda: frames_of(HALF.max, 3, 2),
    "step_us = 0: expected a whole number of us from 1 to 2^63 - 1": lambda: frames_of(HALF.max, 0, 2, step_us=0),
    "change = 0: expected a number > 0": lambda: frames_of(HALF.max, 0, 2, change=0.0),
    "t has shape (), expected (n,)": lambda: Events(1, 0, 0, 0, (4, 4)),
    "x has shape (), expected (1,) like t": lambda: Events([1], 0, [0], [0], (4, 4)),
    "replace = 'no': expected true or false\n  hint: write false": lambda: save(ONE, "a.csv", replace="no"),
}


@pytest.mark.parametrize("message", OTHERS)
def test_what_cannot_be(message):
    assert refusal(OTHERS[message]) == message


@pytest.mark.parametrize("write", [gif, lambda *given, **words: view(*given, title="a", **words)])
def test_a_flag_of_a_picture(write):
    message = "replace = 'no': expected true or false\n  hint: write false"
    assert refusal(write, ONE, "a.gif", replace="no") == message


NO_FILE = "expected a path, the bytes of a file, or an open binary file"


@pytest.mark.parametrize("read", [load, events.stream])
@pytest.mark.parametrize(("source", "message"), [
    ("a\0.csv", "source = 'a\\x00.csv': expected the name of a file, without a zero byte"),
    (5, f"source is 5, {NO_FILE}"), (None, f"source is None, {NO_FILE}"), (io.StringIO("1 2 3 4"),
    "source is an open text file, StringIO, expected a binary one\n  hint: open it as binary: open(path, 'rb')")
])  # fmt: skip
def test_what_is_no_file(read, source, message):
    assert refusal(read, source) == message


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (None, "events is None, expected Events, or the parts of a recording"),
        (Events, "events is <class 'neuro.events._events.Events'>, expected Events, or the parts of a recording"),
        ([1, 2], "events: part 0 is 1, expected Events"),
        ([ONE, None], "events: part 1 is None, expected Events"),
        ("abc", "events: part 0 is 'a', expected Events"),
    ],
    ids=str,
)
def test_no_events_to_save(given, message, tmp_path):
    assert refusal(save, given, tmp_path / "q.csv") == message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("find", [events.Dataset, events.recordings])
def test_no_folder(find, tmp_path):
    for given in (None, 1):
        assert refusal(find, given) == f"path = {given}: expected the name of a file"
    os.mkfifo(pipe := tmp_path / "p")
    assert refusal(find, pipe) == f"{pipe}: is neither file nor folder, expected a folder, zip or HDF5 file"


@pytest.mark.parametrize("size", [None, 1, "ab", {1, 2}, (0, 3)], ids=str)
def test_a_sensor_of_a_filter(size):
    expected = f"TAR: sensor_size = {size!r}: expected width and height of 1 to 65536 px"
    assert refusal(filters.TAR, size) == expected


def test_errors_of_files_and_filters_are_errors_of_models():
    error = EventFileError("a.dat", "is damaged", 7)
    assert isinstance(error, neuro.ModelError)
    assert issubclass(filters.FilterError, neuro.ModelError)
    assert (str(error), error.message, error.hint) == ("a.dat: byte 7: is damaged",) * 2 + ("",)
    assert error.at(None, "elsewhere") is error
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), again.path, again.what, again.offset) == (EventFileError, "a.dat", "is damaged", 7)
    refused = pickle.loads(pickle.dumps(filters.FilterError("TAR: none")))
    assert (type(refused), str(refused)) == (filters.FilterError, "TAR: none")
