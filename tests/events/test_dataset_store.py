"""Data sets written to HDF5 by several processes, killed and gone on with."""

import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import h5py
import pytest

import dying_packer
from event_tests import refusal
from neuro.events import EventFileError
from neuro.events.dataset import Dataset, _store


def word(t):
    return bytes([1, 2, 128, t >> 8 & 255, t & 255])


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "set"
    for k in range(30):
        path = root / "Train" / str(k % 3) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"".join(word(t) for t in range(k)))
    return root


def same(path, folder):
    stored, data = Dataset(path), Dataset(folder)
    events = {(sample.label, sample.name.split("/")[-1]): sample.load() for sample in stored.samples}
    assert events == {(s.label, s.name.split("/")[-1][:-4]): s.load() for s in data.samples}
    assert stored.classes == data.classes


def test_the_layout_is_that_of_aertb(folder, tmp_path):
    seen = []
    done = Dataset(folder).to_hdf5(tmp_path / "o.h5", jobs=1, report=lambda *what: seen.append(what))
    assert (done.path, done.samples, done.damaged) == (str(tmp_path / "o.h5"), 30, {})
    same(done.path, folder)
    assert seen[0] == ("reading", 0, 30)
    assert ("reading", 30, 30) in seen
    assert (seen[-1], sorted(path.name for path in tmp_path.iterdir())) == (("writing", 30, 30), ["o.h5", "set"])
    with h5py.File(done.path) as file:
        assert list(file) == ["0", "1", "2"]
        sample = file["2/29"]
        assert sample.dtype.names == ("ts", "x", "y", "p")
        assert (sample.compression, sample.shuffle, sample.chunks) == ("gzip", True, (29,))
        assert (sample.attrs["sensor_size"].tolist(), sample["ts"].tolist()) == ([34, 34], list(range(29)))


def test_the_same_call_again_does_nothing_and_another_is_refused(folder, tmp_path):
    data, out = Dataset(folder), tmp_path / "o.h5"
    first, made = data.to_hdf5(out, jobs=1), out.stat().st_mtime_ns
    assert (data.to_hdf5(out, jobs=1), out.stat().st_mtime_ns) == (first, made)
    assert refusal(data[:4].to_hdf5, out, jobs=1) == f"{out}: exists with other content; expected a new name"
    (tmp_path / "other.h5").write_text("mine")
    with pytest.raises(EventFileError, match=r"other\.h5: exists with other content; expected a new name$"):
        data.to_hdf5(tmp_path / "other.h5", jobs=1)
    assert (tmp_path / "other.h5").read_text() == "mine"


def test_damaged_samples(messages, folder, tmp_path):
    (folder / "Train/1/4.bin").write_bytes(word(7) + b"ab")
    data = Dataset(folder)
    told = {f"{folder}/Train/1/4.bin": "byte 5: 2 bytes left over after 1 events of 5 bytes"}
    skipped = data.to_hdf5(tmp_path / "skip.h5", jobs=1)
    assert (skipped.samples, skipped.damaged, data.to_hdf5(tmp_path / "skip.h5", jobs=1).damaged) == (29, told, told)
    mended = data.to_hdf5(tmp_path / "mend.h5", jobs=1, damaged="mend")
    assert mended.samples == 30
    text = "byte 5: 2 bytes left over after 1 events of 5 bytes; the events before it were read"
    assert mended.damaged == {f"{folder}/Train/1/4.bin": text}
    with h5py.File(mended.path) as file:
        assert file["1/4"]["ts"].tolist() == [7]
    stop = refusal(data.to_hdf5, tmp_path / "stop.h5", jobs=1, damaged="stop")
    (folder / "Train/1/4.bin").write_bytes(word(7))
    assert data.to_hdf5(tmp_path / "stop.h5", jobs=1, damaged="stop").samples == 30
    other = refusal(data.to_hdf5, tmp_path / "skip.h5", jobs=1, damaged="stop")
    cases = {"stop": stop, "other": other, "wrong": refusal(data.to_hdf5, tmp_path / "x.h5", damaged="skipp")}
    messages({case: text.replace(f"{tmp_path}/", "") for case, text in cases.items()})


def test_samples_that_changed_are_not_taken_for_those_stored(folder, tmp_path):
    data, out = Dataset(folder), tmp_path / "o.h5"
    data.to_hdf5(out, jobs=1)
    (folder / "Train/1/4.bin").write_bytes(word(7) + word(8))
    text = "was made from samples that changed later, or by neuro 0.2.0; expected a new name"
    assert refusal(Dataset(folder).to_hdf5, out, jobs=1) == f"{out}: {text}"
    assert refusal(Dataset(folder).cached, out, jobs=1) == f"{out}: {text}"
    with h5py.File(data.to_hdf5(tmp_path / "new.h5", jobs=1).path) as file:
        assert file["1/4"]["ts"].tolist() == [7, 8]


def test_a_sample_that_changed_is_converted_anew_where_a_kill_is_gone_on_with(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(_store, "_join", lambda *words: pytest.fail("as a kill would"))
    data, out = Dataset(folder), tmp_path / "o.h5"
    with pytest.raises(pytest.fail.Exception):
        data.to_hdf5(out, jobs=1)
    monkeypatch.undo()
    (folder / "Train/1/4.bin").write_bytes(word(7) + word(8))
    with h5py.File(data.to_hdf5(out, jobs=1).path) as file:
        assert file["1/4"]["ts"].tolist() == [7, 8]


def test_a_zip_tells_changes_by_check_sums(folder, tmp_path):
    packed = tmp_path / "set.zip"

    def pack(first):
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("Train/0/0.bin", word(first))
            archive.writestr("Train/1/0.bin", word(2))

    pack(1)
    out = tmp_path / "o.h5"
    first = Dataset(packed).to_hdf5(out, jobs=1)
    pack(1)
    assert Dataset(packed).to_hdf5(out, jobs=1) == first
    pack(9)
    assert "was made from samples that changed later" in refusal(Dataset(packed).to_hdf5, out, jobs=1)


def test_a_folder_of_another_conversion_is_left_alone(messages, folder, tmp_path):
    parts, data, told = tmp_path / "o.h5.parts", Dataset(folder), {}
    parts.mkdir()
    (parts / "mine.h5").write_text("mine")
    told["no plan"] = refusal(data.to_hdf5, tmp_path / "o.h5")
    (parts / "mine.h5").rename(parts / "plan.txt")
    told["other plan"] = refusal(data.to_hdf5, tmp_path / "o.h5")
    told["no folder"] = refusal(data.to_hdf5, tmp_path / "none" / "o.h5")
    messages({case: text.replace(f"{tmp_path}/", "") for case, text in told.items()})


def test_names_that_come_twice_in_a_class_are_told_apart(tmp_path):
    for part in ("Train", "Test"):
        (tmp_path / "set" / part / "7").mkdir(parents=True)
        (tmp_path / "set" / part / "7" / "1.bin").write_bytes(word(len(part)))
    done = Dataset(tmp_path / "set").to_hdf5(tmp_path / "o.h5", jobs=1)
    with h5py.File(done.path) as file:
        found = {name: rows["ts"].tolist() for name, rows in file["7"].items()}
    assert found == {"Test_7_1.bin": [4], "Train_7_1.bin": [5]}


SLOW = """
import sys, time
from neuro.events.dataset import Dataset, _store
_store.BATCH = 1
def report(what, done, total):
    print(what, done, flush=True)
    if done >= 5: time.sleep(30)
if __name__ == "__main__":
    Dataset(sys.argv[1]).to_hdf5(sys.argv[2], jobs=2, report=report)
"""


def test_after_a_kill_the_same_call_goes_on(folder, tmp_path):
    script, out, parts = tmp_path / "slow.py", tmp_path / "o.h5", tmp_path / "o.h5.parts"
    script.write_text(SLOW)
    running = subprocess.Popen([sys.executable, script, folder, out], stdout=subprocess.PIPE, text=True)
    while not running.stdout.readline().startswith("reading 5"):
        assert running.poll() is None
    children = _children(running.pid)
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    running.stdout.close()
    limit = time.monotonic() + 10
    while any(_runs(child) for child in children) and time.monotonic() < limit:
        time.sleep(0.02)
    assert [child for child in children if _runs(child)] == []
    assert len(children) >= 2
    assert not out.exists()
    done = {}
    for part in parts.glob("*.h5"):
        with h5py.File(part) as file:
            assert json.loads(file.attrs["damaged"]) == {}
            done |= dict.fromkeys(map(int, file), part.stat().st_mtime_ns)
    assert len(done) >= 5
    (parts / ".00000099.1.part").write_bytes(b"half")
    (parts / "00000099.h5").write_bytes(b"cut by a crash of the machine")
    not_read_again = Dataset(folder).samples[max(done)].read.path
    before = not_read_again.stat()
    not_read_again.write_bytes(bytes(before.st_size))
    os.utime(not_read_again, ns=(before.st_atime_ns, before.st_mtime_ns))
    seen = []
    stored = Dataset(folder).to_hdf5(out, jobs=1, report=lambda *what: seen.append(what))
    assert (seen[0], stored.samples, stored.damaged) == (("reading", len(done), 30), 30, {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["o.h5", "set", "slow.py"]


@pytest.mark.parametrize("when", ["once", "always"])
def test_a_process_that_is_killed_loses_nothing(folder, tmp_path, monkeypatch, when):
    data, out = Dataset(folder), tmp_path / "o.h5"
    monkeypatch.setenv("DIES", f"{when}:{tmp_path / 'killed'}")
    with monkeypatch.context() as patch:
        patch.setattr(_store, "BATCH", 1)
        patch.setattr(_store, "start_worker", dying_packer.start)
        if when == "once":
            assert data.to_hdf5(out, jobs=2).samples == 30
            same(out, folder)
        else:
            lost = "a process that packs samples was ended by SIGKILL, 2 times: it was killed or ran out of memory"
            assert refusal(data.to_hdf5, out, jobs=2) == f"{out}.parts: {lost}; the same call resumes"
    assert data.to_hdf5(out, jobs=1).samples == 30


def test_a_file_that_was_gone_on_with_has_the_same_bytes(folder, tmp_path, monkeypatch):
    data = Dataset(folder)
    (folder / "Train/1/4.bin").write_bytes(b"ab")
    (folder / "Train/0/21.bin").write_bytes(b"ab")
    plain = data.to_hdf5(tmp_path / "plain.h5", jobs=1)
    for left in ([17, 18, 21], [2, 3], []):
        with monkeypatch.context() as patch:
            patch.setattr(_store, "_pack_all", lambda job, batches, jobs, left=left: stopped(job, left))
            with pytest.raises(KeyboardInterrupt):
                data.to_hdf5(tmp_path / "o.h5", jobs=1)
    assert data.to_hdf5(tmp_path / "o.h5", jobs=1).damaged == plain.damaged
    assert (tmp_path / "o.h5").read_bytes() == (tmp_path / "plain.h5").read_bytes()


def stopped(job, numbers):
    """Pack only these, then be interrupted."""
    if numbers:
        yield _store.pack(job, numbers)
    raise KeyboardInterrupt


def _children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
