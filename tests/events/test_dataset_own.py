"""Own recordings as people have them: one file, one part, HDF5, any format; and what a recogniser asks of them."""

import pickle
import re
import tracemalloc
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro import ModelError
from neuro.core.hdf5 import FRONT
from neuro.events import Dataset, EventFileError, EventFileWarning, Events, Recordings, load, recordings, save
from neuro.events.dataset import UNKNOWN
from neuro.events.formats import FORMATS

SIZE = (34, 34)


def events(k=0, n=5, size=SIZE):
    return Events(np.arange(n) + k, [1] * n, [2] * n, [1] * n, size)


def folder(root, *names, size=SIZE):
    for k, name in enumerate(names):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        save(events(k, size=size), root / name)
    return root


def names(found):
    return [r.name for r in found]


@pytest.fixture
def train(tmp_path):
    """Two classes of four, in a folder Train alone."""
    return folder(tmp_path / "set", *(f"Train/{c}/{k}.bin" for c in "37" for k in range(4)))


@pytest.fixture
def stored(train):
    return Dataset(train).to_hdf5(train.with_name("set.h5"), jobs=1).path


@pytest.mark.parametrize("part", ["Test", "test", "Val"])
def test_data_with_one_part_stands_for_the_other(train, part):
    with pytest.warns(EventFileWarning, match=rf"^{train}: has only the part 'train', taken for '{part}'$"):
        found = recordings(train, part=part)
    assert (
        [r.name for r in found]
        == [r.name for r in recordings(train)]
        == [r.name for r in recordings(train, part="TRAIN")]
    )
    with pytest.raises(EventFileError) as error:
        recordings(train, part=part, whole=False)
    assert str(error.value) == f"{train}: no recordings in a folder {part!r}"
    folder(train, "Other/9/1.bin")
    with pytest.raises(EventFileError, match="no recordings in a folder"):
        recordings(train, part=part)


def test_a_single_recording(train):
    path = train / "Train" / "3" / "2.bin"
    (one,) = found = recordings(path)
    assert (found.classes, found.layout, found.labels.tolist()) == ((), "recording", [UNKNOWN])
    assert (one.name, one.path, one.label, one.load()) == ("2.bin", str(path), UNKNOWN, load(path))
    assert recordings(path, classes=("3", "7")).labels.tolist() == [UNKNOWN]
    assert recordings(path, classes=("3", "7"), label="7").labels.tolist() == [1]
    assert recordings(path, label="7").classes == ("7",)
    assert len(recordings(path, part="Test")) == 1
    assert pickle.loads(pickle.dumps(found))[0].load() == one.load()
    assert found.fingerprint() == recordings(str(path)).fingerprint() != recordings(path, label="7").fingerprint()


def test_a_single_recording_has_one_class(train):
    path = train / "Train" / "3" / "2.bin"
    with pytest.raises(EventFileError) as error:
        recordings(path, classes=("3", "7"), label="8")
    assert str(error.value) == f"{path}: class '8' is new, expected one of 3, 7"
    with pytest.raises(ModelError) as wrong:
        recordings(train, label="3")
    assert str(wrong.value) == f"label='3': expected None, since {train} is no single recording"
    with pytest.raises(ModelError) as wrong:
        recordings(path, ending="bin")
    assert str(wrong.value) == f"ending='bin': expected None, since {path} is a single recording"
    with pytest.raises(ModelError) as wrong:
        recordings(path, part="Train", whole=False)
    assert str(wrong.value) == f"part='Train': expected None, since {path} is a single recording"
    (path.parent / "cut.bin").write_bytes(b"abc")
    with pytest.raises(EventFileError) as error:
        recordings(path.parent / "cut.bin")[0].load()
    assert str(error.value) == f"{path.parent}/cut.bin: byte 0: 3 bytes left over after 0 events of 5 bytes"


@pytest.mark.parametrize("name", [f.name for f in FORMATS.values()])
def test_any_format_in_class_folders_and_alone(name, sample, tmp_path):
    ending = FORMATS[name].suffixes[0]
    for k, c in enumerate(("left", "right", "right")):
        (tmp_path / "set" / c).mkdir(parents=True, exist_ok=True)
        (tmp_path / "set" / c / f"{k}{ending}").write_bytes(sample(name))
    found = recordings(tmp_path / "set")
    first = tmp_path / "set" / "left" / f"0{ending}"
    assert (found.classes, found.labels.tolist()) == (("left", "right"), [0, 1, 1])
    assert found[0].load() == found[2].load() == recordings(first)[0].load() == load(first)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EventFileWarning)
        assert found.sensor_size() == recordings(first).sensor_size() == load(first).sensor_size


def test_several_formats_side_by_side(tmp_path):
    found = recordings(folder(tmp_path, "a/1.bin", "a/2.npz", "b/3.h5", "b/4.aedat", "b/5.raw"))
    assert [r.load().t.tolist() for r in found] == [events(k).t.tolist() for k in range(5)]


def test_an_hdf5_file_of_recordings(train, stored):
    found, plain = recordings(stored), recordings(train)
    assert (found.layout, found.classes) == ("hdf5", plain.classes)
    assert names(found) == [f"{c}/{k}" for c in "37" for k in range(4)]
    assert np.array_equal(found.labels, plain.labels)
    assert [r.load() for r in found] == [r.load() for r in plain]
    assert len(recordings(stored, part="Test")) == 8
    assert recordings(stored, classes=("7", "0", "3")).labels.tolist() == [2] * 4 + [0] * 4
    assert found.sensor_size() == SIZE
    assert pickle.loads(pickle.dumps(found)).fingerprint() == found.fingerprint() != found.take([1, 0]).fingerprint()


def test_what_an_hdf5_file_cannot_have(stored):
    assert len(recordings(stored, layout="hdf5")) == 8
    with pytest.raises(EventFileError) as error:
        recordings(stored, classes=("3",))
    assert str(error.value) == f"{stored}: class '7' is new, expected one of 3"
    for name, value in (("layout", "nmnist"), ("ending", "bin"), ("label", "3")):
        with pytest.raises(ModelError) as wrong:
            recordings(stored, **{name: value})
        assert str(wrong.value) == f"{name}='{value}': expected None, since {stored} is an HDF5 file"


def test_hdf5_files_with_one_recording_are_taken_alone(tmp_path):
    save(events(), tmp_path / "own.h5")
    rows = np.array([(1, 2, 1, 3), (4, 5, 0, 6)], [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    with h5py.File(tmp_path / "prophesee.h5", "w") as file:
        file["CD/events"], file["CD/indexes"] = rows, np.zeros(3, [("id", "<u8"), ("ts", "<i8")])
    with h5py.File(tmp_path / "none.h5", "w") as file:
        file["a/b"] = np.arange(3)
    for name, times in (("own", [0, 1, 2, 3, 4]), ("prophesee", [3, 6])):
        (one,) = found = recordings(tmp_path / f"{name}.h5", label="cup")
        assert (found.layout, found.classes, one.load().t.tolist()) == ("recording", ("cup",), times)
    with pytest.raises(EventFileError, match=r"none\.h5: has a; expected /events/t, x, y, p, rows at "):
        recordings(tmp_path / "none.h5")[0].load()


def test_damaged_and_empty_recordings_are_told_apart(train, tmp_path):
    (train / "Train/3/1.bin").write_bytes(b"abc")
    (train / "Train/7/3.bin").write_bytes(b"")
    found, bad = recordings(train), []
    for k, one in enumerate(found):
        try:
            assert len(one.load()) == (0 if one.name == "Train/7/3.bin" else 5)
        except EventFileError as error:
            bad.append((k, str(error)))
    assert bad == [(1, f"{train}/Train/3/1.bin: byte 0: 3 bytes left over after 0 events of 5 bytes")]
    done = Dataset(train).to_hdf5(tmp_path / "o.h5", jobs=1)
    assert [len(r.load()) for r in recordings(done.path)] == [5] * 6 + [0]


def test_a_damaged_recording_of_an_hdf5_file_is_named(stored):
    """In a file of another library; one of ours has a digest, and is refused as a whole."""
    whole = Path(stored).read_bytes()
    Path(stored).write_bytes(whole[:-9] + b"\xff" + whole[-8:])
    with pytest.raises(EventFileError) as error:
        recordings(stored)
    told = f"{stored}: damaged neuro event data set 1: it is not what was written\n  hint: make it again"
    assert str(error.value).startswith(told)
    Path(stored).write_bytes(whole[FRONT:])
    with h5py.File(stored) as file:
        at = file["7/2"].id.get_chunk_info(0).byte_offset
    with open(stored, "r+b") as file:
        file.seek(at)
        file.write(b"\xff" * 8)
    found = recordings(stored)
    assert len(found[5].load()) == 5
    for ask in (found[6].load, found[6].read, found.fingerprint):
        with pytest.raises(EventFileError, match=rf"^{re.escape(stored)}/7/2: byte {at}: event 0 on cannot be read: "):
            ask()
    assert len(found[7].load()) == 5


def test_parts_of_recordings(train):
    found = recordings(train)
    taken = found.take([7, 0, -1])
    assert type(taken) is Recordings
    assert names(taken) == ["Train/7/3.bin", "Train/3/0.bin", "Train/7/3.bin"]
    assert (taken.labels.tolist(), taken.classes, taken.layout) == ([1, 0, 1], found.classes, "nmnist")
    assert taken.labels.dtype == np.int64
    assert len(found.take([])) == len(found.take(np.flatnonzero(found.labels == 9))) == 0
    with pytest.raises(ModelError) as error:
        found.take([0, 8])
    assert str(error.value) == f"take: index 8, expected -8 to 7: <Recordings 8 of 2 classes in {train}>"
    with pytest.raises(ModelError) as error:
        found.take(found.labels[:2] == 0)
    expected = "take(array([ True,  True])): expected indices, whole numbers in one axis"
    assert str(error.value) == f"{expected}\n  hint: numpy.flatnonzero(mask) gives the indices of a mask"
    with pytest.raises(ModelError, match=r"^take\(3\): expected indices, whole numbers in one axis$"):
        found.take(3)


class Labelled:
    def __init__(self, label):
        self.label = label
        self.path = "a.bin"


def some(labels):
    return Recordings("set", [Labelled(label) for label in labels], "abcdef")


@given(st.lists(st.integers(0, 5), max_size=80), st.integers(2, 6), st.integers(0, 9))
def test_folds_share_each_class(labels, n, seed):
    labels = [label for label in labels if labels.count(label) >= n]
    folds = some(labels).folds(n, seed=seed)
    assert len(folds) == n
    assert sorted(np.concatenate([test for _, test in folds]).tolist()) == list(range(len(labels)))
    for learn, test in folds:
        assert sorted([*learn, *test]) == list(range(len(labels)))
        assert learn.tolist() == sorted(learn)
        assert test.tolist() == sorted(test)
        for label in set(labels):
            mine = sum(labels[k] == label for k in test)
            assert abs(mine - labels.count(label) / n) < 1
    assert max(len(test) for _, test in folds) - min(len(test) for _, test in folds) <= 1
    again = some(labels).folds(n, seed=seed)
    assert all(
        np.array_equal(a, b) for one, two in zip(folds, again, strict=True) for a, b in zip(one, two, strict=True)
    )


def test_the_seed_decides_the_folds():
    found = some([0, 1] * 20)
    assert len({tuple(found.folds(2, seed=seed)[0][1].tolist()) for seed in range(20)}) == 20


def test_folds_need_enough_of_each_class():
    with pytest.raises(ModelError) as error:
        some([0, 0, 1]).folds(2, seed=0)
    expected = "folds(2): class 'b' has 1 recording, expected at least 2"
    assert str(error.value) == f"{expected}\n  hint: one of each class lies in every fold"
    with pytest.raises(ModelError) as error:
        some([0, 0, UNKNOWN]).folds(2, seed=0)
    assert str(error.value) == "folds(2): the class of a.bin is unknown, expected one for each"
    with pytest.raises(ModelError, match=r"^n = 1: expected a whole number >= 2$"):
        some([0, 0]).folds(1, seed=0)


def test_the_sensor_that_holds_all(tmp_path):
    root = folder(tmp_path, "a/1.npz", "b/2.npz", size=(40, 30))
    assert recordings(root).sensor_size() == (40, 30)
    folder(root, "b/3.npz", size=(20, 50))
    text = "sensors differ, such as 20x50 of b/3.npz and 40x30 of a/1.npz: 40x50 is taken, which holds all"
    with pytest.warns(EventFileWarning) as warned:
        assert recordings(root).sensor_size() == (40, 50)
    told = [str(one.message) for one in warned]
    assert told == [f"{root}: {text}; sensor_size=(width, height), or --sensor WxH gives another"]


def test_a_sensor_that_no_file_tells(tmp_path):
    for k, (x, y) in enumerate([(70, 3), (5, 80)]):
        (tmp_path / "ab"[k]).mkdir()
        save(Events([1], [x], [y], [1], (100, 100)), tmp_path / "ab"[k] / "1.bin")
    expected = "2 of 2 recordings do not tell their sensor, such as a/1.bin: 71x81 is taken, which holds all"
    with pytest.warns(EventFileWarning) as warned:
        assert recordings(tmp_path).sensor_size(setting="size") == (71, 81)
    assert [str(one.message) for one in warned] == [f"{tmp_path}: {expected}; size gives another"]
    with pytest.raises(ModelError) as error:
        recordings(tmp_path)[:0].sensor_size()
    expected = "has no recording, expected at least one to find the sensor"
    assert str(error.value) == f"<Recordings 0 of 2 classes in {tmp_path}>: {expected}"


def test_a_sensor_that_the_format_or_the_data_set_is_known_for(train, shared):
    assert recordings(train).sensor_size() == SIZE
    poker = recordings(shared / "data" / "poker_dvs" / "poker_dvs_shared_aedat2.zip")
    assert poker[::20].sensor_size() == poker[0].load().sensor_size


@pytest.mark.parametrize("kind", ["folder", "hdf5"])
def test_recordings_are_read_one_at_a_time(kind, tmp_path):
    rng = np.random.default_rng(0)
    many = 50
    for k in range(many):
        path = tmp_path / "set" / str(k % 4) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        x, y = rng.integers(0, 34, (2, 4000))
        save(Events(np.sort(rng.integers(0, 300_000, 4000)), x, y, x & 1, SIZE), path)
    path = tmp_path / "set" if kind == "folder" else Dataset(tmp_path / "set").to_hdf5(tmp_path / "o.h5", jobs=1).path
    found = recordings(path)
    one = found[0].load()
    whole = many * sum(a.nbytes for a in (one.t, one.x, one.y, one.p))
    tracemalloc.start()
    try:
        assert sum(len(r.load()) for r in found) == many * 4000
        found.fingerprint()
        assert found.sensor_size() == SIZE
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < whole / 5
