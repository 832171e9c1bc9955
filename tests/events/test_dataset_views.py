"""`Dataset`: layouts, drawing, splitting, caching."""

import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro.core.errors import ModelError
from neuro.events import EventFileError, Events
from neuro.events.dataset import LAYOUTS, Dataset


def word(t, x=1, y=2):
    return bytes([x, y, 128 | t >> 16, t >> 8 & 255, t & 255])


def write(root, *names, data=None):
    for k, name in enumerate(names):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(word(k) if data is None else data)
    return root


@pytest.fixture
def small(tmp_path):
    """Three classes of 7, 4 and 1 recordings; the only event of recording k is at k us."""
    names = [f"{c}/{k}.bin" for c, n in (("a", 7), ("b", 4), ("c", 1)) for k in range(n)]
    return Dataset(write(tmp_path / "set", *names))


def test_it_is_a_sequence_of_events_and_labels(small):
    assert repr(small) == f"<Dataset 12 of 3 classes in {small.path}>"
    assert (small.classes, small.layout, len(small)) == (("a", "b", "c"), "folders", 12)
    events, label = small[8]
    assert (events.t.tolist(), label) == ([8], 1)
    assert small.labels.tolist() == [0] * 7 + [1] * 4 + [2]
    assert [label for _, label in small] == small.labels.tolist()
    assert [sample.name for sample in small[7:9].samples] == ["b/0.bin", "b/1.bin"]
    assert small[-1][0].t.tolist() == [11]
    assert small[np.array([3, 1])][0][0].t.tolist() == [3]
    assert names(small[small.labels == 1]) == [f"b/{k}.bin" for k in range(4)]
    assert len(small[[]]) == 0
    with pytest.raises(ModelError) as error:
        small[[True, False]]
    assert str(error.value) == "mask of length 2: expected 12, one for each sample"
    with pytest.raises(IndexError):
        small[12]


def test_transforms_stand_one_behind_the_other(small):
    counts = small.mapped(lambda events: int(events.t[0])).mapped(lambda t: 10 * t)
    assert list(counts[2:4]) == [(20, 0), (30, 0)]
    assert pickle.loads(pickle.dumps(small.mapped(len).mapped(float)))[0] == (1.0, 0)
    assert isinstance(small[0][0], Events)


def test_classes_are_chosen_by_name(small):
    assert small.only("c", "b").labels.tolist() == [1, 1, 1, 1, 2]
    assert small.only("b").classes == small.classes
    with pytest.raises(ModelError) as error:
        small.only("B")
    assert str(error.value) == "unknown class 'B'\n  hint: did you mean 'b'?"


def names(data):
    return [sample.name for sample in data.samples]


def test_shuffled_is_a_permutation_that_the_seed_decides(small):
    first = small.shuffled(3)
    assert names(first) == names(small.shuffled(3)) != names(small.shuffled(4))
    assert sorted(names(first)) == sorted(names(small)) != names(first)


def test_equally_many_of_each_class(small):
    two = small.only("a", "b")
    assert names(two.per_class(2)) == ["a/0.bin", "a/1.bin", "b/0.bin", "b/1.bin"]
    drawn = [names(two.per_class(3, seed=seed)) for seed in range(10)]
    assert all(sum(name[0] == c for name in found) == 3 for found in drawn for c in "ab")
    assert len(set(map(tuple, drawn))) > 5
    with pytest.raises(ModelError) as error:
        small.per_class(2)
    assert str(error.value) == "per_class(n=2): class 'c' has 1 samples, expected n from 1 to 1"
    with pytest.raises(ModelError, match=r"^per_class\(n=0\): class 'a' has 7 samples, expected n from 1 to 7$"):
        small.per_class(0)


class Nothing:
    """A sample that is never loaded."""

    def __init__(self, label):
        self.label = label


@given(counts=st.lists(st.integers(0, 30), min_size=1, max_size=6), share=st.floats(0.01, 0.99), seed=st.integers(0, 9))
def test_a_split_keeps_every_sample_and_the_share_of_each_class(counts, share, seed):
    data = object.__new__(Dataset)
    data.samples = tuple(Nothing(label) for label, n in enumerate(counts) for _ in range(n))
    first, second = data.split(share, seed=seed)
    assert {*first.samples, *second.samples} == {*data.samples}
    assert len(first) + len(second) == len(data)
    for label, n in enumerate(counts):
        mine = sum(sample.label == label for sample in first.samples)
        assert abs(mine - share * n) <= 0.5
    assert first.samples == data.split(share, seed=seed)[0].samples


def test_a_share_is_between_0_and_1(small):
    for share in (0, 1, 1.5, float("nan")):
        with pytest.raises(ModelError) as error:
            small.split(share, seed=0)
        assert str(error.value) == f"split(share={share!r}): expected a share between 0 and 1"


def test_events_in_memory_are_decoded_once(small):
    kept = small.cached()
    assert kept[3][0] is kept[3][0]
    assert kept[3][0] is kept.shuffled(0)[names(small.shuffled(0)).index("a/3.bin")][0]
    assert kept[3][0] == small[3][0]
    assert small[3][0] is not small[3][0]


def test_an_hdf5_cache_has_the_same_samples_in_the_same_order(small, tmp_path):
    mixed = small.shuffled(1)
    kept = mixed.cached(tmp_path / "cache.h5", jobs=1)
    for (events, label), (was, told) in zip(kept, mixed, strict=True):
        assert (events, label) == (was, told)
    Path(small.path).rename(tmp_path / "gone")
    again = mixed.cached(tmp_path / "cache.h5", jobs=1)
    assert [events for events, _ in again] == [events for events, _ in kept]
    with pytest.raises(EventFileError, match=r"cache\.h5: exists and holds something else; expected a new name$"):
        small.cached(tmp_path / "cache.h5", jobs=1)


def test_it_can_be_sent_to_another_process(small, tmp_path):
    kept = small.cached(tmp_path / "cache.h5", jobs=1)
    assert kept[5][0] == pickle.loads(pickle.dumps(kept))[5][0] == pickle.loads(pickle.dumps(small))[5][0]


LIES = {
    "nmnist": ["Train/3/1.bin", "Train/7/2.bin", "Test/3/3.bin"],
    "ncars": ["n-cars_train/cars/obj_1_td.dat", "n-cars_train/background/o_2_td.dat", "n-cars_test/cars/o_3_td.dat"],
    "ncaltech101": [
        "Caltech101/ant/image_0001.bin", "Caltech101/bee/image_0001.bin", "Caltech101_annotations/ant/annotation_1.bin",
    ],
    "poker_dvs": ["xclub01.aedat", "xheart02i.aedat", "readme.txt"],
    "poker_dvs_es": ["trcl0.es", "trsp16.es", "tssp1.es"],
    "dvs_gesture": ["user01_led.aedat", "user01_led_labels.csv"],
    "folders": ["x/one/1.bin", "x/two/2.aedat", "notes.txt"],
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
    write(tmp_path, *LIES["ncars"])
    assert names(Dataset(tmp_path, part="Train")) == sorted(LIES["ncars"][:2])
    assert names(Dataset(tmp_path, part="test")) == LIES["ncars"][2:]
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path, part="val")
    assert str(error.value) == f"{tmp_path}: no recordings in a folder 'val'"


def test_parts_in_names(tmp_path):
    write(tmp_path, *LIES["poker_dvs_es"])
    assert names(Dataset(tmp_path, part="Train")) == ["trcl0.es", "trsp16.es"]
    assert names(Dataset(tmp_path, part="test")) == ["tssp1.es"]


def test_a_part_that_is_not_there_is_not_the_whole(small, tmp_path):
    with pytest.raises(EventFileError) as error:
        Dataset(small.path, part="Train")
    assert str(error.value) == f"{small.path}: has no parts, expected one named 'Train'; split() divides it"
    file = small.to_hdf5(tmp_path / "o.h5", jobs=1).path
    assert len(Dataset(file, layout="hdf5")) == 12
    for name, value in (("part", "Train"), ("ending", "bin"), ("layout", "nmnist")):
        with pytest.raises(ModelError) as wrong:
            Dataset(file, **{name: value})
        assert str(wrong.value) == f"{name}='{value}': expected None, since {file} is an HDF5 file"


def test_a_wrong_layout_is_told(tmp_path):
    write(tmp_path, *LIES["ncars"])
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path, layout="nmnist")
    assert str(error.value) == f"{tmp_path}: does not lie as N-MNIST does"
    with pytest.raises(ModelError) as wrong:
        Dataset(tmp_path, layout="n-mnist")
    assert str(wrong.value) == "unknown layout 'n-mnist'\n  hint: did you mean 'nmnist'?"


def test_only_files_with_an_ending(tmp_path):
    write(tmp_path, "a/1.bin", "a/2.aedat", "b/3.BIN")
    assert names(Dataset(tmp_path, ending="bin")) == ["a/1.bin", "b/3.BIN"]
    assert names(Dataset(tmp_path, ending=".aedat")) == ["a/2.aedat"]
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path, ending="es")
    assert str(error.value).startswith(f"{tmp_path}: no recordings")


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


@pytest.mark.parametrize(("table", "what"), [
    (b"class,start\n1,2\n", "expected the columns class, startTime_usec, endTime_usec"),
    (LABELS + b"1,2\n", "line 4: expected three whole numbers"),
    (LABELS + b"12,2,3\n", "line 4: class 12 from 2 to 3 us; expected a class from 1 to 11 that ends after it begins"),
    (LABELS + b"2,3,3\n", "line 4: class 2 from 3 to 3 us; expected a class from 1 to 11 that ends after it begins"),
])  # fmt: skip
def test_wrong_tables_of_gestures(table, what, tmp_path):
    write(tmp_path, "u.aedat", "u_labels.csv", data=table)
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path)
    assert str(error.value) == f"{tmp_path}/u_labels.csv: {what}"


def test_a_table_without_its_recording(tmp_path):
    write(tmp_path, "u.aedat", "u_labels.csv", "v_labels.csv", data=LABELS)
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path)
    assert str(error.value) == f"{tmp_path}: v_labels.csv has no recording v.aedat beside it"


def test_aertb_files_are_read(tmp_path):
    import h5py

    rows = np.array([(1, 2, 3.0, 1), (4, 5, 6.0, 0)], [("x", "<u2"), ("y", "<u2"), ("ts", "<f4"), ("p", "i1")])
    with h5py.File(tmp_path / "old.h5", "w") as file:
        file["10/b"], file["2/a"] = rows[:1], rows
    data = Dataset(tmp_path / "old.h5")
    assert (data.classes, names(data)) == (("2", "10"), ["2/a", "10/b"])
    assert data[0][0].t.tolist() == [3, 6]
    assert Dataset(tmp_path / "old.h5", sensor_size=(50, 60))[0][0].sensor_size == (50, 60)
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path / "old.h5", sensor_size=(4, 60))[0]
    assert str(error.value) == f"{tmp_path}/old.h5/2/a: event 1: x is 4, expected 0 to 3 (sensor 4x60)"
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path / "old.h5", classes=["2"])
    assert str(error.value) == f"{tmp_path}/old.h5: class '10' is new, expected one of 2"


def test_other_hdf5_files_are_no_data_sets(tmp_path):
    import h5py

    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a/b"] = np.arange(3)
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path / "x.h5")
    expected = "holds no samples, expected /<class>/<sample> with rows ts, x, y, p"
    assert str(error.value) == f"{tmp_path}/x.h5: {expected}"
    (tmp_path / "cut.h5").write_bytes((tmp_path / "x.h5").read_bytes()[:900])
    with pytest.raises(EventFileError, match=r"cut\.h5: no whole HDF5: "):
        Dataset(tmp_path / "cut.h5")


def test_the_official_files(shared):
    data = Dataset(shared / "data" / "nmnist" / "nmnist_test50_bin.zip")
    decoded = np.load(shared / "data" / "nmnist" / "nmnist_test50.npz")
    assert data.layout == "nmnist"
    assert sorted(data.labels.tolist()) == sorted(decoded["labels"].tolist())
    counts = {len(events) for events, _ in data}
    assert counts == set(np.diff(decoded["offsets"]).tolist())
    assert {events.sensor_size for events, _ in data[:5]} == {(34, 34)}


def test_names_of_poker_give_the_classes_of_its_manifest(shared, tmp_path):
    with zipfile.ZipFile(shared / "data" / "poker_dvs" / "poker_dvs_shared_aedat2.zip") as archive:
        archive.extractall(tmp_path)
    listed = Dataset(tmp_path)
    assert listed.layout == "manifest"
    (tmp_path / "MANIFEST.csv").unlink()
    told = Dataset(tmp_path)
    assert told.layout == "poker_dvs"
    assert (told.classes, told.labels.tolist()) == (listed.classes, listed.labels.tolist())
    assert told[0][0].sensor_size == (35, 35)
    assert np.array_equal(told[0][0].records(), listed[0][0].records())
