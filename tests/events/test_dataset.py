"""Data sets: layouts of folders, zips and HDF5 files, single recordings, drawing, splitting, caching."""

import multiprocessing
import pickle
import random
import re
import tracemalloc
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, strategies as st

from event_tests import random_events, refusal
from neuro.core.hdf5 import FRONT
from neuro.events import Dataset, EventFileError, EventFileWarning, Events, Recordings, load, recordings, save
from neuro.events.dataset import LAYOUTS, UNKNOWN
from neuro.events.formats import FORMATS

SIZE = (34, 34)


def word(t, x=1, y=2):
    return bytes([x, y, 128 | t >> 16, t >> 8 & 255, t & 255])


def write(root, *names, data=None):
    """Files with one event each, that of file k at k us, or with other bytes."""
    for k, name in enumerate(names):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(word(k) if data is None else data)
    return root


def saved(root, *names, size=SIZE):
    """Recordings of five events in formats that their names tell."""
    for k, name in enumerate(names):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        save(events(k, size), root / name)
    return root


def events(k=0, size=SIZE):
    return Events(np.arange(5) + k, [1] * 5, [2] * 5, [1] * 5, size)


def zipped(root):
    path = root.with_suffix(".zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(root.rglob("*")):
            archive.write(file, file.relative_to(root).as_posix())
    return path


def names(found):
    return [sample.name for sample in (found.samples if isinstance(found, Dataset) else found)]


def refused(path, **options):
    """Why recordings of a path are refused, without its name."""
    told = refusal(recordings, path, **options)
    assert told.startswith(f"{path}: ")
    return told.removeprefix(f"{path}: ")


@pytest.fixture
def folder(tmp_path):
    inside = ("Train/10/2.bin", "Train/10/10.bin", "Train/9/1.bin", "Test/9/1.bin", "Test/2/1.bin")
    return write(tmp_path / "set", *inside, "readme.txt", ".hidden/9/1.bin", "__MACOSX/9/1.bin", data=word(9))


@pytest.fixture
def small(tmp_path):
    """Three classes of 7, 4 and 1 recordings; the only event of recording k is at k us."""
    inside = [f"{c}/{k}.bin" for c, n in (("a", 7), ("b", 4), ("c", 1)) for k in range(n)]
    return Dataset(write(tmp_path / "set", *inside))


@pytest.fixture
def train(tmp_path):
    """Two classes of four, in a folder Train alone."""
    return saved(tmp_path / "set", *(f"Train/{c}/{k}.bin" for c in "37" for k in range(4)))


@pytest.fixture
def stored(train):
    return Dataset(train).to_hdf5(train.with_name("set.h5"), jobs=1).path


# folders and zips


@pytest.mark.parametrize("place", [lambda root: root, zipped], ids=["folder", "zip"])
def test_found_and_sorted(folder, place):
    found = recordings(place(folder))
    assert found.classes == ("2", "9", "10")
    assert names(found) == ["Test/2/1.bin", "Test/9/1.bin", "Train/9/1.bin", "Train/10/2.bin", "Train/10/10.bin"]
    assert ([r.label for r in found], found[0].load().t.tolist(), len(found[1:3])) == ([0, 1, 1, 2, 2], [9], 2)
    assert pickle.loads(pickle.dumps(found))[4].read() == word(9)
    assert found.fingerprint() == recordings(folder).fingerprint()
    assert found.fingerprint() != found[1:].fingerprint()


def test_part_and_classes(folder):
    train = recordings(folder, part="train")
    assert (train.classes, len(train)) == (("9", "10"), 3)
    assert refused(folder, part="Test", classes=train.classes) == "class '2' is new, expected one of 9, 10"
    assert [r.label for r in recordings(folder, part="Test", classes=("9", "2"))] == [1, 0]
    assert refused(folder, part="Val") == "no recordings in a folder 'Val'"
    assert len(recordings(folder / "Train", part="Test")) == len(recordings(folder / "Train", part="Train")) == 3
    for path in (folder, folder / "Train"):
        assert len(recordings(path, part="train", whole=False)) == 3


@pytest.mark.parametrize("part", ["Test", "test", "Val"])
def test_data_with_one_part_stands_for_the_other(train, part):
    with pytest.warns(EventFileWarning, match=rf"^{train}: has only the part 'train', used as '{part}'$"):
        found = recordings(train, part=part)
    assert names(found) == names(recordings(train)) == names(recordings(train, part="TRAIN"))
    assert refused(train, part=part, whole=False) == f"no recordings in a folder {part!r}"
    saved(train, "Other/9/1.bin")
    assert refused(train, part=part).startswith("no recordings in a folder")


def test_manifest(tmp_path):
    root = write(tmp_path / "set", "a.bin", "b.bin", "c.bin")
    (root / "MANIFEST.csv").write_text("file,label,class,extra\nb.bin,1,lion,\na.bin,0,zebra,\n")
    found = recordings(root, classes=None)
    assert found.classes == ("zebra", "lion")
    assert [(r.name, found.classes[r.label]) for r in found] == [("a.bin", "zebra"), ("b.bin", "lion")]
    (root / "MANIFEST.csv").write_text("file,label,class\na.bin,1,zebra\nd.bin,0,lion\n")
    assert refused(root) == "MANIFEST.csv line 3: no file 'd.bin'"


def test_messages(messages, tmp_path, folder, monkeypatch):
    monkeypatch.chdir(tmp_path)
    root = write(tmp_path / "root", "npy/cl/1.npy", "npy/he/notes", "npy/README.md", "empty/x/y")
    write(tmp_path / "odd", "a.bin", "b.tar.gz", "c.what")
    zipped(folder).rename(write(tmp_path / "outer", "README.md") / "Train.zip")  # as of N-MNIST, N-CARS, N-Caltech101
    zipped(tmp_path / "outer")
    (root / "empty/x/y").unlink()
    paths = ("root/empty", "root/npy", "root/none", "odd", "odd/b.tar.gz", "odd/c.what", "outer", "outer.zip")
    told = {path: refusal(recordings, path) for path in paths}
    told["data set"] = refusal(Dataset, "odd/a.bin")
    told["no parts"] = refusal(recordings, "set/Train", part="Test", whole=False)
    messages(told)


def test_forked_processes_read_a_zip_side_by_side(tmp_path):
    """They must not share the place in the open file."""
    write(tmp_path / "set", *(f"a/{k}.bin" for k in range(3)), data=random.Random(0).randbytes(200_000))
    INHERITED[:] = recordings(zipped(tmp_path / "set"))
    assert size_of(0) == 200_000
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(size_of, [0, 1, 2] * 50, chunksize=5) == [200_000] * 150


INHERITED = []


def size_of(k):
    return len(INHERITED[k].read())


def test_damaged_recordings_name_themselves(folder):
    write(folder, "Train/9/1.bin", data=b"abc")
    told = f"{folder / 'Train'}/9/1.bin: byte 0: 3 bytes left over after 0 events of 5 bytes"
    assert refusal(recordings(folder / "Train")[0].load) == told
    path = zipped(write(folder, "Test/2/1.bin", data=bytes(1000)))
    data = bytearray(path.read_bytes())
    at = data.index(b"Test/2/1.bin") + len("Test/2/1.bin")
    data[at : at + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    assert "Test/2/1.bin: damaged in the zip: " in refusal(recordings(path, part="Test")[0].load)


def test_the_official_files(shared, tmp_path):
    train = recordings(shared / "data" / "nmnist" / "nmnist_train1000_bin.zip")
    assert train.classes == tuple("0123456789")
    assert np.bincount(train.labels).tolist() == [97, 116, 99, 93, 105, 92, 94, 117, 87, 100]
    data = Dataset(shared / "data" / "nmnist" / "nmnist_test50_bin.zip")
    decoded = np.load(shared / "data" / "nmnist" / "nmnist_test50.npz")
    assert (data.layout, sorted(data.labels.tolist())) == ("nmnist", sorted(decoded["labels"].tolist()))
    assert {len(events) for events, _ in data} == set(np.diff(decoded["offsets"]).tolist())
    assert {events.sensor_size for events, _ in data[:5]} == {SIZE}
    poker = shared / "data" / "poker_dvs" / "poker_dvs_shared_aedat2.zip"
    assert recordings(poker).classes == ("club", "diamond", "heart", "spade")
    assert np.bincount(recordings(poker).labels).tolist() == [20, 29, 15, 23]
    with zipfile.ZipFile(poker) as archive:
        archive.extractall(tmp_path)
    listed = Dataset(tmp_path)
    (tmp_path / "MANIFEST.csv").unlink()
    told = Dataset(tmp_path)
    assert (listed.layout, told.layout) == ("manifest", "poker_dvs")
    assert (told.classes, told.labels.tolist()) == (listed.classes, listed.labels.tolist())
    assert told[0][0].sensor_size == (35, 35)
    assert np.array_equal(told[0][0].records(), listed[0][0].records())


LIES = {
    "nmnist": ["Train/3/1.bin", "Train/7/2.bin", "Test/3/3.bin"],
    "ncars": ["n-cars_train/cars/obj_1_td.dat", "n-cars_train/background/o_2_td.dat", "n-cars_test/cars/o_3_td.dat"],
    "ncaltech101": ["Caltech101/ant/image_0001.bin", "Caltech101/bee/image_0001.bin",
    "Caltech101_annotations/ant/annotation_1.bin"], "poker_dvs": ["xclub01.aedat", "xheart02i.aedat", "readme.txt"],
    "poker_dvs_es": ["trcl0.es", "trsp16.es", "tssp1.es"], "dvs_gesture": ["user01_led.aedat", "user01_led_labels.csv"],
    "folders": ["x/one/1.bin", "x/two/2.aedat", "notes.txt"]
}  # fmt: skip
CLASSES = {"nmnist": ("3", "7"), "ncars": ("background", "cars"), "ncaltech101": ("ant", "bee"),
           "poker_dvs": ("club", "heart"), "poker_dvs_es": ("club", "spade"), "folders": ("one", "two"),
           "dvs_gesture": ("hand_clapping", "arm_roll")}  # fmt: skip
LABELS = b"class,startTime_usec,endTime_usec\n8,10,20\n1,20,45\n"


@pytest.mark.parametrize("layout", LIES)
def test_layouts_are_found_and_known_by_name(layout, tmp_path):
    write(tmp_path, *LIES[layout], data=LABELS)
    for data in (Dataset(tmp_path), Dataset(tmp_path, layout=layout)):
        assert (data.layout, data.classes) == (layout, CLASSES[layout])
    assert layout in {known.name for known in LAYOUTS}


def test_parts_of_known_layouts(tmp_path):
    cars, poker = write(tmp_path / "cars", *LIES["ncars"]), write(tmp_path / "poker", *LIES["poker_dvs_es"])
    assert names(Dataset(cars, part="Train")) == sorted(LIES["ncars"][:2])
    assert names(Dataset(cars, part="test")) == LIES["ncars"][2:]
    assert refusal(Dataset, cars, part="val") == f"{cars}: no recordings in a folder 'val'"
    assert names(Dataset(poker, part="Train")) == ["trcl0.es", "trsp16.es"]
    assert names(Dataset(poker, part="test")) == ["tssp1.es"]
    assert refusal(Dataset, cars, layout="nmnist") == f"{cars}: does not have the layout of N-MNIST"
    assert refusal(Dataset, cars, layout="n-mnist") == "unknown layout 'n-mnist'\n  hint: did you mean 'nmnist'?"


def test_only_files_with_an_ending(tmp_path):
    write(tmp_path, "a/1.bin", "a/2.aedat", "b/3.BIN")
    assert names(Dataset(tmp_path, ending="bin")) == ["a/1.bin", "b/3.BIN"]
    assert names(Dataset(tmp_path, ending=".aedat")) == ["a/2.aedat"]
    assert refusal(Dataset, tmp_path, ending="es").startswith(f"{tmp_path}: no recordings")


def aedat3(times):
    """A small AEDAT 3.1 file with an event at each time, at (k, 5)."""
    head = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n"
    n = len(times)
    packet = np.array([1, 1], "<i2").tobytes() + np.array([8, 4, 0, n, n, n], "<i4").tobytes()
    data = np.array([1 | 2 | 5 << 2 | k << 17 for k in range(n)], "<u4")
    return head + packet + np.stack([data, np.array(times, "<u4")], axis=1).tobytes()


def test_gestures_are_cut_out_of_their_recordings(tmp_path):
    root = write(tmp_path / "DvsGesture", "user01_led.aedat", "user02_lab.aedat", data=aedat3([5, 10, 19, 20, 44, 45]))
    write(root, "user01_led_labels.csv", data=LABELS)
    write(root, "user02_lab_labels.csv", data=b"class,startTime_usec,endTime_usec\n11,0,6\n")
    write(root, "trials_to_train.txt", data=b"user01_led.aedat\n")
    write(root, "trials_to_test.txt", data=b"user02_lab.aedat\n")
    data = Dataset(root)
    assert data.classes == ("hand_clapping", "arm_roll", "other_gestures")
    found = {sample.name: (sample.load().t.tolist(), sample.label) for sample in data.samples}
    assert found == {
        "user01_led.aedat#0": ([10, 19], 1), "user01_led.aedat#1": ([20, 44], 0), "user02_lab.aedat#0": ([5], 2),
    }  # fmt: skip
    assert len(Dataset(root, part="Train")) == 2
    assert names(Dataset(root, part="Test")) == ["user02_lab.aedat#0"]
    stored = Dataset(data.to_hdf5(tmp_path / "g.h5", jobs=1).path)
    assert names(stored) == ["arm_roll/user01_led_0", "hand_clapping/user01_led_1", "other_gestures/user02_lab_0"]
    assert stored.classes == data.classes


TABLES = [b"class,start\n1,2\n", LABELS + b"1,2\n", LABELS + b"12,2,3\n", LABELS + b"2,3,3\n"]


def test_wrong_tables_of_gestures(messages, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = {}
    for k, table in enumerate(TABLES):
        write(tmp_path, "u.aedat", "u_labels.csv", data=table)
        told[f"{k}"] = refusal(Dataset, tmp_path).replace(f"{tmp_path}/", "")
    write(tmp_path, "u_labels.csv", "v_labels.csv", data=LABELS)
    messages(told | {"alone": refusal(Dataset, tmp_path).replace(f"{tmp_path}", "")})


@pytest.mark.parametrize("name", [f.name for f in FORMATS.values()])
def test_any_format_in_class_folders_and_alone(name, sample, tmp_path):
    ending = FORMATS[name].suffixes[0]
    write(tmp_path / "set", *(f"{c}/{k}{ending}" for k, c in enumerate(("left", "right", "right"))), data=sample(name))
    found, first = recordings(tmp_path / "set"), tmp_path / "set" / "left" / f"0{ending}"
    assert (found.classes, found.labels.tolist()) == (("left", "right"), [0, 1, 1])
    assert found[0].load() == found[2].load() == recordings(first)[0].load() == load(first)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EventFileWarning)
        assert found.sensor_size() == recordings(first).sensor_size() == load(first).sensor_size


def test_several_formats_side_by_side(tmp_path):
    found = recordings(saved(tmp_path, "a/1.bin", "a/2.npz", "b/3.h5", "b/4.aedat", "b/5.raw"))
    assert [r.load().t.tolist() for r in found] == [events(k).t.tolist() for k in range(5)]


# single recordings


def test_a_single_recording(messages, train):
    path = train / "Train" / "3" / "2.bin"
    (one,) = found = recordings(path)
    assert (found.classes, found.layout, found.labels.tolist()) == ((), "recording", [UNKNOWN])
    assert (one.name, one.path, one.label, one.load()) == ("2.bin", str(path), UNKNOWN, load(path))
    assert recordings(path, classes=("3", "7")).labels.tolist() == [UNKNOWN]
    assert recordings(path, classes=("3", "7"), label="7").labels.tolist() == [1]
    assert (recordings(path, label="7").classes, len(recordings(path, part="Test"))) == (("7",), 1)
    assert pickle.loads(pickle.dumps(found))[0].load() == one.load()
    assert found.fingerprint() == recordings(str(path)).fingerprint() != recordings(path, label="7").fingerprint()
    (path.parent / "cut.bin").write_bytes(b"abc")
    told = {
        "class": refusal(recordings, path, classes=("3", "7"), label="8"), "set": refusal(recordings, train, label="3"),
        "ending": refusal(recordings, path, ending="bin"), "part": refusal(recordings, path, part="Train", whole=False),
        "cut": refusal(recordings(path.parent / "cut.bin")[0].load),
    }  # fmt: skip
    messages({case: text.replace(f"{train}", "set") for case, text in told.items()})


# pictures


def test_pictures_are_recordings_with_as_many_events_as_grey_levels(messages, tmp_path, shared):
    images = np.random.default_rng(1).integers(0, 256, (3, 4, 5), np.uint8)
    images[0, 0, :2] = 0, 255
    np.savez(tmp_path / "set.npz", images=images, labels=[10, 9, 10])
    found = recordings(tmp_path / "set.npz")
    assert (found.layout, found.classes, found.labels.tolist()) == ("pictures", ("9", "10"), [1, 0, 1])
    assert (found[2].name, found.sensor_size(), found[2].path) == ("#2", (5, 4), f"{tmp_path}/set.npz#2")
    for image, one in zip(images, pickle.loads(pickle.dumps(found)), strict=True):
        events, drawn = one.load(), np.zeros((4, 5), int)
        np.add.at(drawn, (events.y, events.x), 1)
        assert np.array_equal(drawn, image)
        assert not events.t.any()
    assert recordings(tmp_path / "set.npz", classes=("10", "8", "9")).labels.tolist() == [0, 2, 0]
    assert found.fingerprint() != found.take([0, 1]).fingerprint()
    assert found[0].stamp() != found[1].stamp()
    assert len(recordings(shared / "data" / "mnist5k" / "mnist5k.npz")) == 5000
    wrong = {
        "no_labels": {"images": images}, "shape": {"images": images[0], "labels": [1]},
        "type": {"images": images / 255, "labels": [1, 2, 3]}, "few": {"images": images, "labels": [1]},
        "words": {"images": images, "labels": ["a", "b", "c"]}, "objects": {"images": images, "labels": [None] * 3},
    }  # fmt: skip
    told = {"class": refused(tmp_path / "set.npz", classes=("9",)), "part": refusal(recordings, found.path, ending="b")}
    for case, arrays in wrong.items():
        np.savez(tmp_path / f"{case}.npz", **arrays)
        told[case] = refused(tmp_path / f"{case}.npz")
    messages({case: text.replace(f"{tmp_path}/", "") for case, text in told.items()})


# HDF5


def test_an_hdf5_file_of_recordings(messages, train, stored):
    found, plain = recordings(stored), recordings(train)
    assert (found.layout, found.classes) == ("hdf5", plain.classes)
    assert names(found) == [f"{c}/{k}" for c in "37" for k in range(4)]
    assert np.array_equal(found.labels, plain.labels)
    assert [r.load() for r in found] == [r.load() for r in plain]
    assert len(recordings(stored, part="Test")) == len(recordings(stored, layout="hdf5")) == 8
    assert recordings(stored, classes=("7", "0", "3")).labels.tolist() == [2] * 4 + [0] * 4
    assert found.sensor_size() == SIZE
    assert pickle.loads(pickle.dumps(found)).fingerprint() == found.fingerprint() != found.take([1, 0]).fingerprint()
    told = {"class": refusal(recordings, stored, classes=("3",))}
    for find, last in ((recordings, "label"), (Dataset, "part")):
        for name in ("layout", "ending", last):
            told[f"{find.__name__} {name}"] = refusal(find, stored, **{name: "nmnist"})
    messages({case: text.replace(stored, "set.h5") for case, text in told.items()})


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
    assert "none.h5: has a; expected /events/t, x, y, p, rows at " in refusal(recordings(tmp_path / "none.h5")[0].load)
    expected = "has no samples, expected /<class>/<sample> with rows ts, x, y, p"
    assert refusal(Dataset, tmp_path / "none.h5") == f"{tmp_path}/none.h5: {expected}"
    (tmp_path / "cut.h5").write_bytes((tmp_path / "none.h5").read_bytes()[:900])
    assert "cut.h5: not an intact HDF5 file: " in refusal(Dataset, tmp_path / "cut.h5")


def test_aertb_files_are_read(tmp_path):
    rows = np.array([(1, 2, 3.0, 1), (4, 5, 6.0, 0)], [("x", "<u2"), ("y", "<u2"), ("ts", "<f4"), ("p", "i1")])
    path = tmp_path / "old.h5"
    with h5py.File(path, "w") as file:
        file["10/b"], file["2/a"] = rows[:1], rows
    data = Dataset(path)
    assert (data.classes, names(data), data[0][0].t.tolist()) == (("2", "10"), ["2/a", "10/b"], [3, 6])
    assert Dataset(path, sensor_size=(50, 60))[0][0].sensor_size == (50, 60)
    told = refusal(lambda: Dataset(path, sensor_size=(4, 60))[0])
    assert told == f"{path}/2/a: event 1: x is 4, expected 0 to 3 (sensor 4x60)"
    assert refusal(Dataset, path, classes=["2"]) == f"{path}: class '10' is new, expected one of 2"


def test_a_damaged_recording_of_an_hdf5_file_is_named(stored):
    """In a file of another library; one of ours has a digest, and is refused as a whole."""
    whole = Path(stored).read_bytes()
    Path(stored).write_bytes(whole[:-9] + b"\xff" + whole[-8:])
    told = (
        "damaged neuro event data set 1: the content does not match the digest\n  hint: write it again, or use a backup"
    )
    assert refused(stored).startswith(told)
    Path(stored).write_bytes(whole[FRONT:])
    with h5py.File(stored) as file:
        at = file["7/2"].id.get_chunk_info(0).byte_offset
    with open(stored, "r+b") as file:
        file.seek(at)
        file.write(b"\xff" * 8)
    found = recordings(stored)
    assert len(found[5].load()) == 5
    for ask in (found[6].load, found[6].read, found.fingerprint):
        with pytest.raises(
            EventFileError, match=rf"^{re.escape(stored)}/7/2: byte {at}: the events from 0 on cannot be read: "
        ):
            ask()
    assert len(found[7].load()) == 5


# parts, folds and sensors


def test_parts_of_recordings(messages, train):
    found = recordings(train)
    taken = found.take([7, 0, -1])
    assert type(taken) is Recordings
    assert names(taken) == ["Train/7/3.bin", "Train/3/0.bin", "Train/7/3.bin"]
    assert (taken.labels.tolist(), taken.classes, taken.layout) == ([1, 0, 1], found.classes, "nmnist")
    assert taken.labels.dtype == np.int64
    assert len(found.take([])) == len(found.take(np.flatnonzero(found.labels == 9))) == 0
    wrong = {"index": [0, 8], "mask": found.labels[:2] == 0, "number": 3}
    messages({case: refusal(found.take, given).replace(f"{train}", "set") for case, given in wrong.items()})


class Labelled:
    def __init__(self, label):
        self.label, self.path = label, "a.bin"


def some(labels):
    return Recordings("set", [Labelled(label) for label in labels], "abcdef")


@given(st.lists(st.integers(0, 5), max_size=80), st.integers(2, 6), st.integers(0, 9))
def test_folds_share_each_class(labels, n, seed):
    labels = [label for label in labels if labels.count(label) >= n]
    folds = some(labels).folds(n, seed=seed)
    assert (len(folds), sorted(np.concatenate([test for _, test in folds]).tolist())) == (n, list(range(len(labels))))
    for learn, test in folds:
        assert (sorted([*learn, *test]), learn.tolist()) == (list(range(len(labels))), sorted(learn))
        assert test.tolist() == sorted(test)
        for label in set(labels):
            assert abs(sum(labels[k] == label for k in test) - labels.count(label) / n) < 1
    assert max(len(test) for _, test in folds) - min(len(test) for _, test in folds) <= 1
    for one, two in zip(folds, some(labels).folds(n, seed=seed), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_the_seed_decides_the_folds_which_need_enough_of_each_class(messages):
    found = some([0, 1] * 20)
    assert len({tuple(found.folds(2, seed=seed)[0][1].tolist()) for seed in range(20)}) == 20
    wrong = {"1 of b": ([0, 0, 1], 2), "unknown": ([0, 0, UNKNOWN], 2), "1 fold": ([0, 0], 1)}
    messages({case: refusal(some(labels).folds, n, seed=0) for case, (labels, n) in wrong.items()})


def told_sensor(found, size, **setting):
    """What is said of a sensor that is not sure."""
    with pytest.warns(EventFileWarning) as warned:
        assert found.sensor_size(**setting) == size
    return [str(one.message) for one in warned]


def test_the_sensor_that_holds_all(tmp_path, train, shared):
    root = saved(tmp_path / "a", "a/1.npz", "b/2.npz", size=(40, 30))
    assert recordings(root).sensor_size() == (40, 30)
    saved(root, "b/3.npz", size=(20, 50))
    text = "sensors differ, such as 20x50 of b/3.npz and 40x30 of a/1.npz: assuming 40x50, which contains every event"
    expected = f"{root}: {text}; sensor_size=(width, height), or --sensor WxH sets another"
    assert told_sensor(recordings(root), (40, 50)) == [expected]
    root = tmp_path / "b"
    for k, (x, y) in enumerate([(70, 3), (5, 80)]):
        (root / "ab"[k]).mkdir(parents=True)
        save(Events([1], [x], [y], [1], (100, 100)), root / "ab"[k] / "1.bin")
    what = "2 of 2 recordings do not state their sensor, such as a/1.bin"
    expected = f"{what}: assuming 71x81, which contains every event"
    assert told_sensor(recordings(root), (71, 81), setting="size") == [f"{root}: {expected}; size sets another"]
    expected = "has no recording, expected at least one to determine the sensor"
    assert refusal(recordings(root)[:0].sensor_size) == f"<Recordings 0 of 2 classes in {root}>: {expected}"
    assert recordings(train).sensor_size() == SIZE  # known for the format, or the data set
    poker = recordings(shared / "data" / "poker_dvs" / "poker_dvs_shared_aedat2.zip")
    assert poker[::20].sensor_size() == poker[0].load().sensor_size


@pytest.mark.parametrize("kind", ["folder", "hdf5"])
def test_recordings_are_read_one_at_a_time(kind, tmp_path):
    many, one = 30, random_events(4000, SIZE)
    for k in range(many):
        path = tmp_path / "set" / str(k % 4) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(one, path)
    path = tmp_path / "set" if kind == "folder" else Dataset(tmp_path / "set").to_hdf5(tmp_path / "o.h5", jobs=1).path
    found = recordings(path)
    found[0].load()
    tracemalloc.start()
    try:
        assert sum(len(r.load()) for r in found) == many * 4000
        found.fingerprint()
        assert found.sensor_size() == SIZE
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < many * sum(a.nbytes for a in (one.t, one.x, one.y, one.p)) / 4


# Dataset


def test_it_is_a_sequence_of_events_and_labels(small):
    assert repr(small) == f"<Dataset 12 of 3 classes in {small.path}>"
    assert (small.classes, small.layout, len(small)) == (("a", "b", "c"), "folders", 12)
    events, label = small[8]
    assert (events.t.tolist(), label, small.labels.tolist()) == ([8], 1, [0] * 7 + [1] * 4 + [2])
    assert ([label for _, label in small], names(small[7:9])) == (small.labels.tolist(), ["b/0.bin", "b/1.bin"])
    assert (small[-1][0].t.tolist(), small[np.array([3, 1])][0][0].t.tolist()) == ([11], [3])
    assert (names(small[small.labels == 1]), len(small[[]])) == ([f"b/{k}.bin" for k in range(4)], 0)
    assert refusal(lambda: small[[True, False]]) == "mask of length 2: expected 12, one for each sample"
    with pytest.raises(IndexError):
        small[12]
    told = f"{small.path}: has no parts, expected one named 'Train'; split() divides it"
    assert refusal(Dataset, small.path, part="Train") == told


def test_transforms_stand_one_behind_the_other(small):
    counts = small.mapped(lambda events: int(events.t[0])).mapped(lambda t: 10 * t)
    assert list(counts[2:4]) == [(20, 0), (30, 0)]
    assert pickle.loads(pickle.dumps(small.mapped(len).mapped(float)))[0] == (1.0, 0)
    assert isinstance(small[0][0], Events)


def test_samples_are_chosen_shuffled_and_drawn(messages, small):
    assert (small.only("c", "b").labels.tolist(), small.only("b").classes) == ([1, 1, 1, 1, 2], small.classes)
    first = small.shuffled(3)
    assert names(first) == names(small.shuffled(3)) != names(small.shuffled(4))
    assert sorted(names(first)) == sorted(names(small)) != names(first)
    two = small.only("a", "b")
    assert names(two.per_class(2)) == ["a/0.bin", "a/1.bin", "b/0.bin", "b/1.bin"]
    drawn = [names(two.per_class(3, seed=seed)) for seed in range(10)]
    assert all(sum(name[0] == c for name in found) == 3 for found in drawn for c in "ab")
    assert len(set(map(tuple, drawn))) > 5
    told = {f"per_class {n}": refusal(small.per_class, n) for n in (0, 2)}
    told |= {f"split {share}": refusal(small.split, share, seed=0) for share in (0, 1, 1.5, float("nan"))}
    messages(told | {"only": refusal(small.only, "B")})


@given(counts=st.lists(st.integers(0, 30), min_size=1, max_size=6), share=st.floats(0.01, 0.99), seed=st.integers(0, 9))
def test_a_split_keeps_every_sample_and_the_share_of_each_class(counts, share, seed):
    data = object.__new__(Dataset)
    data.samples = tuple(Labelled(label) for label, n in enumerate(counts) for _ in range(n))
    first, second = data.split(share, seed=seed)
    assert ({*first.samples, *second.samples}, len(first) + len(second)) == ({*data.samples}, len(data))
    for label, n in enumerate(counts):
        assert abs(sum(sample.label == label for sample in first.samples) - share * n) <= 0.5
    assert first.samples == data.split(share, seed=seed)[0].samples


def test_events_in_memory_are_decoded_once(small):
    kept = small.cached()
    assert kept[3][0] is kept[3][0] is kept.shuffled(0)[names(small.shuffled(0)).index("a/3.bin")][0]
    assert kept[3][0] == small[3][0]
    assert small[3][0] is not small[3][0]
    assert pickle.loads(pickle.dumps(kept))[5][0] == kept[5][0]


def test_an_hdf5_cache_has_the_same_samples_in_the_same_order(small, tmp_path):
    mixed, path = small.shuffled(1), tmp_path / "cache.h5"
    kept = mixed.cached(path, jobs=1)
    assert list(kept) == list(mixed)
    Path(small.path).rename(tmp_path / "gone")
    assert list(mixed.cached(path, jobs=1)) == list(kept) == list(pickle.loads(pickle.dumps(kept)))
    assert refusal(small.cached, path, jobs=1) == f"{path}: exists with other content; expected a new name"
