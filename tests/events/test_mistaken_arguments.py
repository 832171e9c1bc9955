"""What no one should give to functions of events: one error in words."""

import os
import pickle

import numpy as np
import pytest

import neuro
from neuro import events
from neuro.events import EventFileError, Events, filters
from neuro.events.pictures import gif
from neuro.events.view import view

ONE = Events([1], [0], [0], [1], (4, 4))


def told(call, *args, **words):
    """The message of the error of a call."""
    with pytest.raises(neuro.ModelError) as error:
        call(*args, **words)
    return str(error.value)


def test_single_events():
    assert told(Events, 1, 0, 0, 0, (4, 4)) == "t has shape (), expected (n,)"
    assert told(Events, [1], 0, [0], [0], (4, 4)) == "x has shape (), expected (1,) like t"


@pytest.mark.parametrize("read", [events.load, events.stream])
def test_names_that_no_file_has(read):
    message = "source = 'a\\x00.csv': expected the name of a file, without a zero byte"
    assert told(read, "a\0.csv") == message


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
    assert told(events.save, given, tmp_path / "q.csv") == message
    assert list(tmp_path.iterdir()) == []


def test_formats(tmp_path):
    events.save(ONE, path := tmp_path / "a.csv")
    assert told(events.load, path, format=1).startswith(f"{path}: unknown format 1, expected one of rosbag1, ")
    assert told(events.save, ONE, path, format=1).startswith(f"{path}: cannot save as format 1, expected one of ")


def test_flags(tmp_path):
    events.save(ONE, path := tmp_path / "a.csv")
    assert told(events.save, ONE, path, replace="no") == "replace = 'no': expected true or false\n  hint: write false"
    for word in ("strict", "sort"):
        assert told(events.load, path, **{word: "x"}) == f"{word} = 'x': expected true or false"
    assert told(events.stream, path, strict=None) == "strict has no value: expected true or false"
    assert told(gif, ONE, "a.gif", replace="no") == "replace = 'no': expected true or false\n  hint: write false"
    assert (
        told(view, ONE, "a.html", title="a", replace="no")
        == "replace = 'no': expected true or false\n  hint: write false"
    )


@pytest.mark.parametrize("find", [events.Dataset, events.recordings])
@pytest.mark.parametrize("given", [None, 1])
def test_no_folder(find, given):
    assert told(find, given) == f"path = {given}: expected the name of a file"


@pytest.mark.parametrize("find", [events.Dataset, events.recordings])
def test_a_pipe_is_no_folder(find, tmp_path):
    os.mkfifo(pipe := tmp_path / "p")
    assert told(find, pipe) == f"{pipe}: is neither file nor folder, expected a folder, zip or HDF5 file"


@pytest.mark.parametrize("size", [None, 1, "ab", {1, 2}], ids=str)
def test_filters(size):
    expected = f"TAR: sensor_size = {size!r}: expected width and height of 1 to 65536 px"
    assert told(filters.TAR, size) == expected


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


def test_what_is_no_number():
    """These were Python's own errors about '>' and '<='."""
    times = np.arange(9)
    assert told(events.msd_segments, times, tau="0.1") == (
        "tau = '0.1': expected a number > 0 s\n  hint: write 0.1 without quotes"
    )
    assert told(events.DVSParameters, leak_rate_hz="1 ms") == ("leak_rate_hz = 1 ms: expected a rate in Hz")
    assert told(events.DVSParameters, pos_thres=[0.1]) == "pos_thres = [0.1]: expected a number >= 0.01"
