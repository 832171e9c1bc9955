import multiprocessing
import pickle
import random
import zipfile

import pytest

from neuro.events import Dataset, EventFileError, recordings

EVENT = bytes([1, 2, 128, 0, 9])


def write(root, *names, data=EVENT):
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(data)
    return root


def zipped(root):
    path = root.with_suffix(".zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(root.rglob("*")):
            archive.write(file, file.relative_to(root).as_posix())
    return path


@pytest.fixture
def folder(tmp_path):
    names = ("Train/10/2.bin", "Train/10/10.bin", "Train/9/1.bin", "Test/9/1.bin", "Test/2/1.bin")
    return write(tmp_path / "set", *names, "readme.txt", ".hidden/9/1.bin", "__MACOSX/9/1.bin")


@pytest.mark.parametrize("place", [lambda root: root, zipped], ids=["folder", "zip"])
def test_found_and_sorted(folder, place):
    path = place(folder)
    found = recordings(path)
    assert found.classes == ("2", "9", "10")
    assert [r.name for r in found] == [
        "Test/2/1.bin", "Test/9/1.bin", "Train/9/1.bin", "Train/10/2.bin", "Train/10/10.bin",
    ]  # fmt: skip
    assert [r.label for r in found] == [0, 1, 1, 2, 2]
    assert found[0].load().t.tolist() == [9]
    assert len(found[1:3]) == 2
    assert pickle.loads(pickle.dumps(found))[4].read() == EVENT
    assert found.fingerprint() == recordings(folder).fingerprint()
    assert found.fingerprint() != found[1:].fingerprint()


def test_part_and_classes(folder):
    train = recordings(folder, part="train")
    assert train.classes == ("9", "10")
    assert len(train) == 3
    with pytest.raises(EventFileError) as error:
        recordings(folder, part="Test", classes=train.classes)
    assert str(error.value) == f"{folder}: class '2' is new, expected one of 9, 10"
    assert [r.label for r in recordings(folder, part="Test", classes=("9", "2"))] == [1, 0]
    with pytest.raises(EventFileError) as error:
        recordings(folder, part="Val")
    assert str(error.value) == f"{folder}: no recordings in a folder 'Val'"
    assert len(recordings(folder / "Train", part="Train")) == 3


def test_manifest(tmp_path):
    root = write(tmp_path / "set", "a.bin", "b.bin", "c.bin")
    (root / "MANIFEST.csv").write_text("file,label,class,extra\nb.bin,1,lion,\na.bin,0,zebra,\n")
    found = recordings(root, classes=None)
    assert found.classes == ("zebra", "lion")
    assert [(r.name, found.classes[r.label]) for r in found] == [("a.bin", "zebra"), ("b.bin", "lion")]
    (root / "MANIFEST.csv").write_text("file,label,class\na.bin,1,zebra\nd.bin,0,lion\n")
    with pytest.raises(EventFileError) as error:
        recordings(root)
    assert str(error.value) == f"{root}: MANIFEST.csv line 3: no file 'd.bin'"


def told(path, **options):
    """What is said of a path, without its name."""
    with pytest.raises(EventFileError) as error:
        recordings(path, **options)
    assert str(error.value).startswith(f"{path}: ")
    return str(error.value).removeprefix(f"{path}: ")


def test_messages(tmp_path):
    expected = "no recordings, expected class folders with event files such as 3/00017.bin"
    hint = "; 'neuro events formats' lists the endings"
    assert told(tmp_path) == expected + hint
    write(tmp_path / "npy", "cl/1.npy", "he/notes", "README.md")
    assert told(tmp_path / "npy") == f"{expected} (there are only .md, .npy){hint}"
    assert told(tmp_path / "none") == "no such folder, zip or HDF5 file"
    write(tmp_path, "a.bin", "b.tar.gz", "c.what")
    expected = "is no folder, zip or HDF5 file, expected one with recordings"
    assert told(tmp_path / "b.tar.gz") == f"{expected}; unpack it first"
    assert told(tmp_path / "c.what").startswith("unknown kind of event file, expected one of: ROS")
    with pytest.raises(EventFileError) as error:
        Dataset(tmp_path / "a.bin")
    assert str(error.value) == f"{tmp_path}/a.bin: {expected}"
    expected = "a.bin lies in no class folder (is this one? then give the one above it), and there is no MANIFEST.csv "
    assert told(tmp_path) == f"{expected}with the columns file, label, class"


def test_archives_come_in_archives(folder, tmp_path):
    """N-MNIST's zip holds Train.zip and Test.zip; N-CARS' and N-Caltech101's are like it."""
    zipped(folder).rename(write(tmp_path / "outer", "README.md") / "Train.zip")
    expected = "no recordings, but Train.zip: unpack it first, or give its name if it is a zip"
    assert told(tmp_path / "outer") == told(zipped(tmp_path / "outer")) == expected


def test_a_part_may_be_a_must(folder):
    assert len(recordings(folder / "Train", part="Test")) == len(recordings(folder / "Train"))
    expected = "has no parts, expected one named 'Test'; split() divides it"
    assert told(folder / "Train", part="Test", whole=False) == expected
    assert len(recordings(folder / "Train", part="train", whole=False)) == 3
    assert len(recordings(folder, part="train", whole=False)) == 3


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


def test_damaged_recording_names_itself(folder):
    write(folder, "Train/9/1.bin", data=b"abc")
    with pytest.raises(EventFileError) as error:
        recordings(folder / "Train")[0].load()
    assert str(error.value) == f"{folder / 'Train'}/9/1.bin: byte 0: 3 bytes left over after 0 events of 5 bytes"


def test_damaged_zip(folder):
    path = zipped(write(folder, "Test/2/1.bin", data=bytes(1000)))
    data = bytearray(path.read_bytes())
    at = data.index(b"Test/2/1.bin") + len("Test/2/1.bin")
    data[at : at + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    with pytest.raises(EventFileError, match=r"Test/2/1\.bin: damaged in the zip: "):
        recordings(path, part="Test")[0].load()


def test_the_official_files(shared):
    train = recordings(shared / "data" / "nmnist" / "nmnist_train1000_bin.zip")
    assert train.classes == tuple("0123456789")
    assert [sum(r.label == k for r in train) for k in range(10)] == [97, 116, 99, 93, 105, 92, 94, 117, 87, 100]
    poker = recordings(shared / "data" / "poker_dvs" / "poker_dvs_shared_aedat2.zip")
    assert poker.classes == ("club", "diamond", "heart", "spade")
    assert [sum(r.label == k for r in poker) for k in range(4)] == [20, 29, 15, 23]
    assert sum(len(r.load()) for r in poker) == 219428
