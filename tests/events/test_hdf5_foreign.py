"""A recording from a stranger brings nothing of another file into the events."""

import h5py
import numpy as np
import pytest

from neuro.events import EventFileError, load


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
        EventFileError, match=r"^a\.h5: .*x is kept in another file, expected all of a recording in one$"
    ):
        load("a.h5", format=f"hdf5:{where}" if where else None, sensor_size=(9, 9))


def test_a_whole_recording_in_another_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with h5py.File("secret.h5", "w") as secret:
        for name in "txyp":
            secret["events/" + name] = np.zeros(3, np.uint16)
    with h5py.File("a.h5", "w") as file:
        file["events"] = h5py.ExternalLink("secret.h5", "events")
    with pytest.raises(EventFileError, match="is kept in another file"):
        load("a.h5", sensor_size=(9, 9))
