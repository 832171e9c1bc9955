"""What functions of events refuse, each with its whole message; arguments that YAML can hold are in `golden`."""

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
from neuro.events import EventFileError, Events, filters, load, pictures, representations, save

SIZE = (9, 6)
FOUR = Events([1, 2, 3, 4], [0] * 4, [0] * 4, [1] * 4, (7, 5))
ONE = Events([1], [0], [0], [1], (4, 4))
FIRST = {
    "filters": (SIZE,), "segmentation": (np.arange(3),), "representations": (FOUR,), "DVSParameters": (),
    "stream": ("there is no such file.bin",), "load": (bytes(5),),
}  # fmt: skip
ARGUMENTS = yaml.safe_load((Path(__file__).parent / "golden" / "arguments.yaml").read_text())


def test_arguments(messages):
    told = {}
    for room, part in ARGUMENTS.items():
        for name, some in part.items() if isinstance(part, dict) else [("", part)]:
            call = getattr(getattr(events, room), name) if name else getattr(events, room)
            for k, given in enumerate(some):
                listed, words = (given, {}) if isinstance(given, list) else ([], given)
                told[f"{room} {name} {k:02}"] = refusal(call, *FIRST[room], *listed, **words)
    messages(told)


def events_at(*t, size=SIZE):
    zeros = np.zeros(len(t), int)
    return Events(np.array(t, dtype=np.int64), zeros, zeros, zeros, size)


def added(kind):
    surface = kind(SIZE, tau_us=1)
    surface.add(events_at(7))
    return surface


HALF, THREE = np.full((2, 2), 0.5), np.arange(3)


def test_calls(messages):
    rooms = pictures, representations, events, filters
    messages.calls({name: getattr(room, name) for room in rooms for name in dir(room)} | globals())


NO_EVENTS = (None, Events, [1, 2], [ONE, None], "abc")


def test_what_cannot_be(messages, tmp_path):
    told = {}
    for read in (load, events.stream):
        for source in ("a\0.csv", 5, None, io.StringIO("1 2 3 4")):
            told[f"{read.__name__} {source!r:.12}"] = refusal(read, source)
    for given in NO_EVENTS:
        told[f"save {given!r:.30}"] = refusal(save, given, tmp_path / "q.csv")
    for size in (None, 1, "ab", {1, 2}, (0, 3)):
        told[f"sensor {size}"] = refusal(filters.TAR, size)
    messages(told)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("find", [events.Dataset, events.recordings])
def test_no_folder(find, tmp_path):
    for given in (None, 1):
        assert refusal(find, given) == f"path = {given}: expected the name of a file"
    os.mkfifo(pipe := tmp_path / "p")
    assert refusal(find, pipe) == f"{pipe}: is neither file nor folder, expected a folder, zip or HDF5 file"


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
