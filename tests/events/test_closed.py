"""No file stays open after an error, or where not all of it was read: a good one in its place is then read right."""

import os

import h5py
import numpy as np
import pytest

from neuro.events import EventFileError, Events, load, save, stream
from neuro.events.dataset import Dataset
from neuro.events.formats import FORMATS
from neuro.events.formats.event_stream import generic
from neuro.events.formats.mat import samples
from neuro.events.info import info

GOOD = Events([5, 6, 7], [0, 1, 2], [2, 1, 0], [0, 1, 0], (34, 34))
OPEN = h5py.h5f.OBJ_FILE | h5py.h5f.OBJ_GROUP | h5py.h5f.OBJ_DATASET | h5py.h5f.OBJ_ATTR


def open_handles(path):
    """Descriptors of a path, and what HDF5 holds open beyond that of other tests."""
    held = []
    for number in os.listdir("/proc/self/fd"):
        try:
            held.append(os.readlink(f"/proc/self/fd/{number}"))
        except FileNotFoundError:
            continue
    count = in_hdf5() - BEFORE["count"]
    return [name for name in held if name.removesuffix(" (deleted)") == str(path)] + [f"{count} in HDF5"] * bool(count)


def in_hdf5():
    """How many files and parts of files HDF5 holds open in this process."""
    return h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, OPEN)


BEFORE = {"count": 0}


@pytest.fixture(autouse=True)
def held_before(frozen_heap):
    BEFORE["count"] = in_hdf5()


def _damaged(whole):
    """Files that are cut, or of which bytes near the beginning, in the middle and at the end are other ones."""
    for share in (0.3, 0.9):
        yield whole[: int(share * len(whole))]
    for at in (9, len(whole) // 2, len(whole) - 9):
        yield whole[:at] + bytes(byte ^ 0xFF for byte in whole[at : at + 8]) + whole[at + 8 :]
    yield whole + b"\x07"


READS = {
    "load": load,
    "stream": lambda path, **options: list(stream(path, **options)),
    "from a time on": lambda path, **options: list(stream(path, start_us=20_000, **options)),
    "small sensor": lambda path, **options: load(path, sensor_size=(2, 2), **options),
    "the first": lambda path, **options: next(stream(path, count=1, **options), None),
    "lenient": lambda path, **options: load(path, strict=False, **options),
    "info": info,
}


@pytest.mark.filterwarnings("ignore::neuro.events.EventFileWarning")
@pytest.mark.parametrize("format", FORMATS)
def test_an_error_leaves_nothing_open(format, sample, tmp_path):
    """Errors are kept, as a debugger does, while the good file is written into the same place."""
    path, other, errors = tmp_path / f"a{FORMATS[format].suffixes[0]}", tmp_path / "good", {}
    save(GOOD, other, format="hdf5")
    for data in (sample(format), *_damaged(sample(format))):
        path.write_bytes(data)
        for name, read in READS.items():
            try:
                read(path, format=format)
            except EventFileError as error:
                errors.setdefault(name, []).append(error)
                assert data != sample(format) or name == "small sensor"
            assert open_handles(path) == [], name
        path.write_bytes(other.read_bytes())
        assert load(path, format="hdf5") == GOOD
    assert errors.keys() >= {*list(READS)[:4]}


def test_generic_events_and_cells(sample, tmp_path):
    path = tmp_path / "a"
    for read, data in ((generic, sample("event_stream")), (samples, sample("mat")[:300])):
        path.write_bytes(data)
        with pytest.raises(EventFileError) as error:
            read(path)
        assert open_handles(path) == []
        del error


@pytest.mark.parametrize("damage", ["class", "chunk", "text", "rows"])
def test_a_data_set(damage, tmp_path):
    """A damaged data set is read right when it was mended in its place."""
    path, good = tmp_path / "a.h5", tmp_path / "good.h5"
    for k in range(2):
        (tmp_path / "data" / str(k)).mkdir(parents=True)
        save(GOOD, tmp_path / "data" / str(k) / "a.bin")
    Dataset(tmp_path / "data").to_hdf5(good, jobs=1)
    data = bytearray(good.read_bytes())
    if damage == "text":
        data = data[:700]
    elif damage == "chunk":
        with h5py.File(good) as file:
            at = file["0/a"].id.get_chunk_info(0).byte_offset
        data[at : at + 8] = bytes(8)
    path.write_bytes(data)
    if damage == "rows":
        with h5py.File(path, "w") as file:
            file["0/a"] = np.arange(3)
    with pytest.raises(EventFileError) as error:
        Dataset(path, classes=["b"] if damage == "class" else None)[0]
    assert open_handles(path) == []
    path.write_bytes(good.read_bytes())
    found = Dataset(path)
    assert found[0][0].records().tolist() == GOOD.records().tolist()
    del error, found
