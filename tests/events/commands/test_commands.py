"""`neuro events`: what its commands write and tell."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from neuro.events import Events, load, save
from neuro.events.representations import binary_frame
from neuro.events.segmentation import count_segments
from refused import mistakes_of


def test_without_a_command_there_is_help(run):
    status, out, err = run()
    assert (status, err) == (0, "")
    assert "Usage: neuro events [OPTIONS]" in out


def test_help_lists_all_and_imports_nothing_heavy():
    code = (
        "import sys; from neuro_events.cli import app\n"
        "heavy = {'numpy', 'numba', 'h5py', 'PIL', 'yaml', 'scipy', 'prompt_toolkit'} & set(sys.modules)\n"
        "sys.exit(str(sorted(heavy)) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_formats(run):
    status, out, _ = run("formats")
    rows = [re.split("  +", line.strip()) for line in out.splitlines() if line.strip()]
    assert status == 0
    assert ["nmnist", "N-MNIST .bin", ".bin", "yes", "on real files"] in rows
    assert next(row for row in rows if row[0] == "aedat3")[3] == "no"
    assert not next(row for row in rows if row[0] == "aedat3")[4].startswith("on real files")


def test_convert(run, recording, tmp_path):
    assert run("convert", "in.bin", "out.h5") == (0, "out.h5: 100 events\n", "")
    assert load(tmp_path / "out.h5") == recording
    expected = "error: out.h5: exists: expected a new name, or --force to replace it\n"
    assert run("convert", "in.bin", "out.h5") == (2, "", expected)
    assert run("convert", "in.bin", "out.h5", "--force")[0] == 0
    status, out, err = run("convert", "in.bin", "-", "--to", "csv")
    assert (status, err) == (0, "-: 100 events\n")
    assert out.splitlines()[:3] == ["# sensor 34x34", "t,x,y,p", "0,0,0,0"]


@pytest.mark.filterwarnings("default")
def test_lenient(run, recording, tmp_path):
    (tmp_path / "in.bin").write_bytes((tmp_path / "in.bin").read_bytes()[:-1])
    text = "in.bin: byte 495: 4 bytes left over after 99 events of 5 bytes"
    assert run("convert", "in.bin", "out.h5") == (2, "", f"error: {text}\n")
    told = f"warning: {text}; the events before it were read\n"
    assert run("convert", "in.bin", "out.h5", "--lenient") == (0, "out.h5: 99 events\n", told)


def test_a_pipe(recording, tmp_path):
    code = "from tests_root import root; from neuro.cli.mistakes import telling\nwith telling(): root()()"
    (tmp_path / "tests_root.py").write_text(
        "import typer\nfrom neuro_events.cli import app\n"
        "def root():\n    r = typer.Typer(); r.add_typer(app); r.callback()(lambda: None); return r\n"
    )
    call, env = f'{sys.executable} -c "{code}" events', {**os.environ, "PYTHONPATH": str(tmp_path)}
    convert = f"{call} convert - - --from nmnist --to dat --sensor 34x34"
    line = f"echo '% x' > out.dat; cat in.bin | {convert} >> out.dat; cat out.dat | {call} info -"
    done = subprocess.run(line, shell=True, capture_output=True, text=True, cwd=tmp_path, env=env)
    told = [line for line in done.stderr.splitlines() if "compiling kernels" not in line]
    assert told == ["-: 100 events"]
    assert "file          <standard input>\nformat        Prophesee DAT\n" in done.stdout
    assert load(tmp_path / "out.dat") == recording


def test_filter(run, recording, tmp_path):
    words = "crop: {x: [0, 20]}", "flip"
    status, out, err = run("filter", "in.bin", "out.h5", *words)
    n = int((recording.x < 20).sum())
    assert (status, out, err) == (0, f"out.h5: {n} of 100 events\n", "")
    got = load(tmp_path / "out.h5")
    assert got.sensor_size == (20, 34)
    assert np.array_equal(got.x, 19 - recording.x[recording.x < 20])


def test_filters_are_listed(run):
    status, out, _ = run("filter", "--list")
    assert status == 0
    assert re.search(r"crop +x=None px, y=None px, move=True +Keep the events of a rectangle\.", out)
    assert re.search(r"tar +tau=0\.08 s, theta=2\.4 events, ", out)
    assert re.search(r"background +dt_us=10000 +Keep ", out)


def test_split(run, recording, tmp_path):
    assert run("split", "in.bin", "--every", "30", "--out", "parts") == (0, "parts/in-*.bin: 4 files\n", "")
    parts = [load(path, sensor_size=(34, 34)) for path in sorted((tmp_path / "parts").iterdir())]
    assert [len(part) for part in parts] == [30, 30, 30, 10]
    assert np.concatenate([part.records() for part in parts]).tolist() == recording.records().tolist()
    words = "split", tmp_path / "parts/in-00000.bin", "--count", "12", "--to", "h5"
    assert run(*words)[1] == "in-00000-*.h5: 3 files\n"  # in the current folder
    assert len(load(tmp_path / "in-00000-00002.h5")) == 6
    (tmp_path / "in-00000-00000.h5").unlink()
    assert run(*words)[2].startswith("error: in-00000-00001.h5: exists: ")
    assert not (tmp_path / "in-00000-00000.h5").exists()
    assert run(*words, "--force")[0] == 0


def test_split_leaves_out_windows_without_events(run, tmp_path):
    save(Events([0, 10_000], [0, 0], [0, 0], [0, 1], (34, 34)), tmp_path / "in.bin")
    assert run("split", "in.bin", "--every", "2")[1] == "in-*.bin: 2 files; 4 windows without events\n"
    assert (tmp_path / "in-00005.bin").exists()


def test_gif(run, recording, tmp_path):
    assert run("gif", "in.bin", "out.gif", "--frame", "40") == (
        0, "out.gif: 3 frames of 272x272 px, 25 per second, in real time\n", "",
    )  # fmt: skip
    _, out, _ = run("gif", "in.bin", "slow.gif", "--fps", "30", "--zoom", "1")
    assert out == "slow.gif: 25 frames of 34x34 px, 33.33 per second, at 0.132 times real time\n"


def test_pauses_are_left_out_of_a_gif_and_told(run, recording, tmp_path):
    twice = Events(np.append(recording.t, recording.t + 3600 * 10**6), *(
        np.tile(getattr(recording, key), 2) for key in "xyp"
    ), (34, 34))  # fmt: skip
    save(twice, tmp_path / "in.h5")
    assert run("gif", "in.h5")[1] == (
        "in.h5.gif: 31 frames of 272x272 px, 25 per second, in real time; 89,972 still frames skipped\n"
    )


def test_view(run, recording, tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "in.bin").rename(tmp_path / "sub" / "in.bin")
    assert run("view", "sub/in.bin") == (0, "in.bin.html: all events\n", "")
    assert (tmp_path / "in.bin.html").read_text("utf-8").endswith("</html>\n")
    told = "p.html: 1 of every 4 events; --most shows more\n"
    assert run("view", "sub/in.bin", "--out", "p.html", "--most", "30") == (0, told, "")


def test_interrupted(run, recording, monkeypatch, tmp_path):
    def stop(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr("neuro.events.formats.event_stream.Bin.pieces", stop)
    for words in (
        ("gif", "in.bin"), ("view", "in.bin"), ("convert", "in.bin", "o.h5"), ("split", "in.bin", "--count", "3")
    ):  # fmt: skip
        status, out, err = run(*words)
        assert (status, out) == (130, "")
        assert re.fullmatch("interrupted: .* (is not written|are complete)\n", err)
    assert [path.name for path in tmp_path.iterdir()] == ["in.bin"]


def test_tohdf5_as_in_the_thesis(run, data):
    words = ("tohdf5", "-f", "set/Train", "-e", "bin", "-o", "NMNIST_TRAIN.h5", "--workers", "1")
    assert run(*words) == (0, "NMNIST_TRAIN.h5: 5 recordings of 2 classes\n", "")
    assert run(*words) == (0, "NMNIST_TRAIN.h5: 5 recordings of 2 classes\n", "")
    other = run("tohdf5", "-f", "set", "--part", "Test", "-o", "NMNIST_TRAIN.h5")
    assert other == (2, "", "error: NMNIST_TRAIN.h5: exists with other content; expected a new name\n")


def test_tohdf5_tells_damaged_files(run, data):
    (data / "Train/7/2.bin").write_bytes(b"abcdefg")
    words = ("tohdf5", "-f", "set", "--workers", "1", "-o")
    path, what = "set/Train/7/2.bin", "byte 5: 2 bytes left over after 1 events of 5 bytes"
    told = f"1 damaged file, skipped:\n  {path}: {what}\n"
    assert run(*words, "a.h5") == (1, "a.h5: 5 recordings of 2 classes\n", told)
    assert run(*words, "b.h5", "--strict") == (2, "", f"error: {path}: {what}\n")
    status, out, err = run(*words, "c.h5", "--lenient")
    assert (status, out) == (1, "c.h5: 6 recordings of 2 classes\n")
    assert err.startswith("1 damaged file, read up to the damage:\n")
    assert "expected one of the two" in run(*words, "d.h5", "--lenient", "--strict")[2]


def test_frames(run, recording, tmp_path):
    given = "count_segments: {count: 10}"
    status, out, err = run("frames", "in.bin", "a.npz", "--cut", given, "--as", "binary_frame")
    assert (status, err) == (0, "")
    with np.load(tmp_path / "a.npz") as found:
        assert np.array_equal(found["bounds"], count_segments(recording.t, 10))
        assert np.array_equal(found["frames"], binary_frame(recording, segments=found["bounds"]))
        assert out == f"a.npz: {len(found['frames'])} of binary_frame, {list(found['frames'].shape[1:])} bool\n"


def test_mistakes(messages, run, recording, tmp_path):
    (tmp_path / "none.bin").write_bytes(b"")
    messages(mistakes_of(run, messages.cases))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.bin", "none.bin"]
