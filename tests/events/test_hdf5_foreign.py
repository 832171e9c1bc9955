"""A third-party recording brings nothing of another file into the events; odd ones are refused with a message."""

import h5py
import numpy as np
import pytest

from event_tests import refusal
from neuro.events import Dataset, EventFileError, load, recordings, stream


def linked(group):
    with h5py.File("secret.h5", "w") as secret:
        secret["x"] = np.arange(3, dtype=np.uint16)
    group["x"] = h5py.ExternalLink("secret.h5", "x")


def behind_a_soft_link(group):
    linked(group)
    group.move("x", "foreign")
    group["x"] = h5py.SoftLink("/events/foreign")


def stored(group):
    np.arange(3, dtype=np.uint16).tofile("secret")
    group.create_dataset("x", (3,), np.uint16, external=[("secret", 0, 6)])


def virtual(group):
    linked(group)
    del group["x"]
    layout = h5py.VirtualLayout((3,), np.uint16)
    layout[:] = h5py.VirtualSource("secret.h5", "x", (3,))
    group.create_virtual_dataset("x", layout)


@pytest.mark.parametrize("foreign", [linked, behind_a_soft_link, stored, virtual])
@pytest.mark.parametrize("where", ["", "/events"])
def test_a_column_in_another_file_is_refused(tmp_path, monkeypatch, foreign, where):
    monkeypatch.chdir(tmp_path)
    with h5py.File("a.h5", "w") as file:
        group = file.create_group("events")
        for name in "typ":
            group[name] = np.zeros(3, np.uint16)
        foreign(group)
    with pytest.raises(
        EventFileError, match=r"^a\.h5: .*x is stored in another file, expected a recording in one file$"
    ):
        load("a.h5", format=f"hdf5:{where}" if where else None, sensor_size=(9, 9))


def test_a_whole_recording_in_another_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with h5py.File("secret.h5", "w") as secret:
        for name in "txyp":
            secret["events/" + name] = np.zeros(3, np.uint16)
    with h5py.File("a.h5", "w") as file:
        file["events"] = h5py.ExternalLink("secret.h5", "events")
    assert "is stored in another file" in refusal(load, "a.h5", sensor_size=(9, 9))


def in_a_ring(file):
    file["events/t"] = h5py.SoftLink("/ring")
    file["ring"] = h5py.SoftLink("/events/t")


def cyclic_groups(file):
    file["events/t"] = file["/"]
    file["events/again"] = file["events"]


def references(file):
    file.create_dataset("events/t", data=[file["events/x"].ref] * 3, dtype=h5py.ref_dtype)


def regions(file):
    file.create_dataset("events/t", data=[file["events/x"].regionref[:2]] * 3, dtype=h5py.regionref_dtype)


def offset_to_itself(file):
    file["events/t"] = np.arange(3)
    file["t_offset"] = h5py.SoftLink("/t_offset")


def no_width(file):
    file["events/t"] = np.arange(3)
    file.attrs["width"] = file.attrs["height"] = np.zeros(0)


def empty_rows(file):
    del file["events"]
    file["cars/1"] = h5py.Empty(np.dtype([("ts", "i8"), ("x", "u2"), ("y", "u2"), ("p", "u1")]))


ODD = [in_a_ring, cyclic_groups, references, regions, offset_to_itself, no_width, empty_rows]
TIMES = {
    "to itself": h5py.SoftLink("/events/t"), "to itself by name": h5py.ExternalLink("a.h5", "/events/t"),
    "to nothing": h5py.SoftLink("/nothing"), "to no file": h5py.ExternalLink("nothing.h5", "/t"),
    "fields": np.zeros(3, [("a", "i4"), ("b", "f8")]), "texts": np.array(["a"] * 3, h5py.string_dtype()),
    "a type": np.dtype("i4"), "nothing": h5py.Empty("i8")
}  # fmt: skip


READS = [
    load, lambda path: load(path, format="hdf5:/events/t"), lambda path: list(stream(path)),
    lambda path: recordings(path)[0].load(), lambda path: Dataset(path)[0],
]  # fmt: skip


@pytest.mark.parametrize("odd", [*ODD, *TIMES])
def test_what_is_no_recording_is_told(tmp_path, monkeypatch, odd):
    monkeypatch.chdir(tmp_path)
    with h5py.File("a.h5", "w") as file:
        for name in "xyp":
            file["events/" + name] = np.zeros(3, np.uint16)
        if odd in ODD:
            odd(file)
        else:
            file["events/t"] = TIMES[odd]
    for read in READS:
        with pytest.raises(EventFileError) as error:
            read("a.h5")
        if odd == "to itself":
            assert error.value.what == "/events/t cannot be opened: Special link traversal failed (too many links)"
