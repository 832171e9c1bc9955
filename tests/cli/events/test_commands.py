"""`neuro events` and its shell."""

import io
import json
import os
import re
import subprocess
import sys

import h5py
import numpy as np
import pytest
import typer

from neuro.cli.commands import Commands
from neuro.cli.events import app, shell
from neuro.cli.mistakes import telling
from neuro.core.extras import install
from neuro.events import Events, load, save
from neuro.events.representations import binary_frame
from neuro.events.segmentation import count_segments


def root():
    made = typer.Typer(cls=Commands, name="neuro", add_completion=False, pretty_exceptions_enable=False)
    made.add_typer(app)
    made.command()(shell)
    made.command("show")(lambda: None)
    made.callback()(lambda: None)
    return made


@pytest.fixture
def run(monkeypatch, capfd, tmp_path):
    """Run some words behind `neuro events`; return exit status, output and error."""
    monkeypatch.chdir(tmp_path)

    def words(*given, group=("events",)):
        monkeypatch.setattr(sys, "argv", ["neuro", *group, *map(str, given)])
        capfd.readouterr()
        try:
            with telling():
                status = root()(standalone_mode=False, prog_name="neuro") or 0
        except SystemExit as leaving:
            status = leaving.code
        return status, *capfd.readouterr()

    return words


@pytest.fixture
def recording(tmp_path):
    """100 events, one each ms, in `in.bin`."""
    k = np.arange(100)
    events = Events(1000 * k, k % 34, k % 30, k % 2, (34, 34))
    save(events, tmp_path / "in.bin")
    return events


def test_info(run, recording, tmp_path):
    status, out, err = run("info", "in.bin")
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        "file          in.bin, 500 bytes",
        "format        N-MNIST .bin",
        "sensor        34x34, not told by the file",
        "events        100",
        "polarity      50.0% ON, 50.0% OFF",
        "time          0 to 99000 us, 0.099 s",
        "rate          1,010 events/s",
        "longest gaps  1,000 us from 0, 1,000 us from 1000, 1,000 us from 2000",
        "pixels        100 of 1,156 have events",
        "hot pixels    none",
    ]
    told = json.loads(run("info", "in.bin", "--json", "--sensor", "40x50")[1])
    assert (told["events"], told["sensor_size"], told["format"]) == (100, [40, 50], "nmnist")
    (tmp_path / "in.bin").write_bytes((tmp_path / "in.bin").read_bytes()[:-1])
    assert "damage        byte 495: 4 bytes left over after 99 events" in run("info", "in.bin")[1]
    assert run("info", "none.bin")[::2] == (2, "error: none.bin: no such file\n")


def test_info_of_long_pauses(run, tmp_path):
    save(Events([0, 5, 36 * 10**8], [0, 1, 2], [0, 0, 0], [0, 1, 0], (34, 34)), tmp_path / "in.h5")
    told = run("info", "in.h5")[1]
    assert "time          0 to 3600000000 us, 3,600 s\n" in told
    assert "rate          0.000833 events/s, at most 200 in 10 ms\n" in told
    (tmp_path / "wide.csv").write_text("1,65535,65535,1\n")
    assert "pixels     not counted, since there are 4,294,967,296\n" in run("info", "wide.csv")[1]


def test_info_says_what_was_never_tried(run, tmp_path):
    (tmp_path / "x.aedat").write_bytes(b"#!AER-DAT3.1\r\n#Format: RAW\r\n#!END-HEADER\r\n")
    assert "  untested on a real file: no recording of this format" in run("info", "x.aedat")[1]


GENERIC = b"Event Stream\x02\x00\x00\x00"


def test_info_of_generic_events(run, tmp_path):
    (tmp_path / "a.es").write_bytes(GENERIC + b"\x05\x06abc\xff" + b"\x00\x0a\xc3\xa4\x00\xff\x01")
    assert run("info", "a.es")[1].splitlines() == [
        "file    a.es",
        "format  Event Stream, generic: times with bytes, no pixels",
        "events  2",
        "time    5 to 259 us, 0.000254 s",
        "bytes   3 to 5 an event, 8 in all",
        "first   'abc'",
    ]
    (tmp_path / "b.es").write_bytes(GENERIC + b"\x05\x52" + bytes(41) + b"\x05")
    shown = run("info", "b.es")[1].splitlines()[-2:]
    assert shown == ["first   " + " ".join(["00"] * 40) + " ...", "damage  byte 59: " + CUT]
    told = json.loads(run("info", "b.es", "--json")[1])
    assert (told["type"], told["events"], told["start_us"], told["largest_bytes"]) == ("generic", 1, 5, 41)
    (tmp_path / "c.es").write_bytes(GENERIC)
    assert run("info", "c.es")[1].splitlines()[2:] == ["events  0"]


CUT = "the last event is cut after 1 bytes; what is before it was read"


def test_info_of_generic_events_in_a_pipe(tmp_path):
    words = [os.path.join(os.path.dirname(sys.executable), "neuro"), "events", "info", "-"]
    done = subprocess.run(words, input=GENERIC + b"\x05\x06abc", capture_output=True, cwd=tmp_path, check=True)
    assert b"file    <standard input>\n" in done.stdout
    assert b"events  1\n" in done.stdout


def test_info_of_one_of_several_in_hdf5(run, tmp_path):
    with h5py.File(tmp_path / "two.h5", "w") as file:
        for side in ("left", "right"):
            file[f"davis/{side}/events"] = np.array([[3, 2, 0.5, -1], [4, 2, 1.5, 1]])
    assert "name it, as in format='hdf5:/davis/left/events' or --from hdf5:" in run("info", "two.h5")[2]
    told = run("info", "two.h5", "--from", "hdf5:/davis/right")[1]
    assert "time          500000 to 1500000 us, 1 s\n" in told
    assert "  untested on a real file: no recording in another layout" in told
    assert "columns       x y t p\n" in told


def test_info_of_a_data_set(run, data, tmp_path):
    assert run("info", "set")[1].splitlines() == [
        "data set    set", "layout      N-MNIST", "recordings  6", "class 3     4", "class 7     2",
    ]  # fmt: skip
    assert json.loads(run("info", "set", "--json")[1])["classes"] == {"3": 4, "7": 2}


def test_info_of_a_data_set_in_hdf5(run, data, recording):
    assert run("tohdf5", "-f", "set", "-o", "all.h5", "--jobs", "1")[0] == 0
    assert run("info", "all.h5")[1].splitlines() == [
        "data set    all.h5", "layout      HDF5, /class/sample", "recordings  6", "class 3     4", "class 7     2",
    ]  # fmt: skip
    assert "is a data set with 6 recordings" in run("gif", "all.h5")[2]
    assert run("tohdf5", "-f", "set", "-o", "no/all.h5") == (2, "", "error: no/all.h5: there is no folder no\n")


def test_without_a_command_there_is_help(run):
    status, out, err = run()
    assert (status, err) == (0, "")
    assert "Usage: neuro events [OPTIONS]" in out


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
    expected = "error: in.bin: this is the recording itself: expected a new name\n"
    assert run("convert", "in.bin", "in.bin", "--force") == (2, "", expected)
    status, out, err = run("convert", "in.bin", "-", "--to", "csv")
    assert (status, err) == (0, "-: 100 events\n")
    assert out.splitlines()[:3] == ["# sensor 34x34", "t,x,y,p", "0,0,0,0"]
    expected = "error: Invalid value for '--sensor': '34': expected WIDTHxHEIGHT in px, such as 346x260\n"
    assert run("convert", "in.bin", "x.h5", "--sensor", "34")[2].startswith(expected)
    assert "cannot save as '.xyz'" in run("convert", "in.bin", "out.xyz")[2]


@pytest.mark.filterwarnings("default")
def test_lenient(run, recording, tmp_path):
    (tmp_path / "in.bin").write_bytes((tmp_path / "in.bin").read_bytes()[:-1])
    text = "in.bin: byte 495: 4 bytes left over after 99 events of 5 bytes"
    assert run("convert", "in.bin", "out.h5") == (2, "", f"error: {text}\n")
    told = f"warning: {text}; what is before it was read\n"
    assert run("convert", "in.bin", "out.h5", "--lenient") == (0, "out.h5: 99 events\n", told)


def test_a_pipe(recording, tmp_path):
    code = "from tests_root import root; from neuro.cli.mistakes import telling\nwith telling(): root()()"
    (tmp_path / "tests_root.py").write_text(
        "import typer\nfrom neuro.cli.events import app\n"
        "def root():\n    r = typer.Typer(); r.add_typer(app); r.callback()(lambda: None); return r\n"
    )
    call = f'{sys.executable} -c "{code}" events'
    env = {**os.environ, "PYTHONPATH": str(tmp_path)}
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


@pytest.mark.parametrize(("text", "what"), [
    ("tarr", "unknown filter 'tarr'\n  hint: did you mean 'tar'?\n"),
    ("hot", "filter 'hot': expected pixels\n  hint: such as 'hot: {pixels: [[8, 1], [205, 59]]}'; "),
    ("tar: {tua: 1}", "unknown parameter of filter 'tar' 'tua'\n  hint: did you mean 'tau'?\n"),
    ("tar: {tau: -1}", "TAR: tau is -1, expected a number > 0"),
    ("crop: {x: 5", "Invalid value for FILTER: 'crop: {x: 5': is not YAML\n"),
    ("crop: 5", "Invalid value for FILTER: 'crop: 5': expected a name, or 'name: {parameter: value}'\n"),
])  # fmt: skip
def test_wrong_filters(run, recording, tmp_path, text, what):
    status, out, err = run("filter", "in.bin", "out.h5", text)
    assert (status, out) == (2, "")
    assert err.startswith(f"error: {what}")
    assert not (tmp_path / "out.h5").exists()


def test_filters_are_listed(run):
    status, out, _ = run("filter", "--list")
    assert status == 0
    assert re.search(r"crop +x=None px, y=None px, move=True +Keep events of a rectangle\.", out)
    assert re.search(r"tar +tau=0\.08 s, theta=2\.4 events, ", out)
    assert re.search(r"background +dt_us=10000 +Keep ", out)


def test_split(run, recording, tmp_path):
    assert run("split", "in.bin", "--every", "30", "--out", "parts") == (0, "parts/in-*.bin: 4 files\n", "")
    parts = [load(path, sensor_size=(34, 34)) for path in sorted((tmp_path / "parts").iterdir())]
    assert [len(part) for part in parts] == [30, 30, 30, 10]
    assert np.concatenate([part.records() for part in parts]).tolist() == recording.records().tolist()
    words = "split", tmp_path / "parts/in-00000.bin", "--count", "12", "--as", "h5"
    assert run(*words)[1] == "in-00000-*.h5: 3 files\n"  # in the current folder
    assert len(load(tmp_path / "in-00000-00002.h5")) == 6
    (tmp_path / "in-00000-00000.h5").unlink()
    assert run(*words)[2].startswith("error: in-00000-00001.h5: exists: ")
    assert not (tmp_path / "in-00000-00000.h5").exists()
    assert run(*words, "--force")[0] == 0


def test_what_split_cannot_do(run, recording, tmp_path):
    start = "error: Invalid value for '--every' / '--count': expected one of the two"
    assert run("split", "in.bin")[2].startswith(start)
    assert "'0.0005': expected a whole number of us" in run("split", "in.bin", "--every", "0.0005")[2]
    assert (
        "'.xyz': cannot be written, expected .h5, .hdf5, " in run("split", "in.bin", "--count", "1", "--as", "xyz")[2]
    )
    (tmp_path / "none.bin").write_bytes(b"")
    expected = "error: none.bin: the recording has no events: nothing to cut\n"
    assert run("split", "none.bin", "--count", "1", "--out", "new") == (2, "", expected)
    assert not (tmp_path / "new").exists()


def test_split_leaves_out_windows_without_events(run, tmp_path):
    save(Events([0, 10_000], [0, 0], [0, 0], [0, 1], (34, 34)), tmp_path / "in.bin")
    assert run("split", "in.bin", "--every", "2")[1] == "in-*.bin: 2 files; 4 windows without events\n"
    assert (tmp_path / "in-00005.bin").exists()


def test_gif(run, recording, tmp_path):
    assert run("gif", "in.bin", "out.gif", "--window", "40") == (
        0, "out.gif: 3 frames of 272x272 px, 25 a second, as fast as it was\n", "",
    )  # fmt: skip
    _, out, _ = run("gif", "in.bin", "slow.gif", "--fps", "30", "--scale", "1")
    assert out == "slow.gif: 25 frames of 34x34 px, 33.33 a second, 0.132 times as fast as it was\n"
    assert (
        "'red,blue': expected three colours, ON,OFF,BACK" in run("gif", "in.bin", "x.gif", "--colours", "red,blue")[2]
    )
    assert run("gif", "in.bin", "x.gif", "--colours", "red,blue,whit")[2].startswith("error: unknown colour 'whit'")
    (tmp_path / "none.bin").write_bytes(b"")
    assert run("gif", "none.bin")[2] == "error: none.bin has no events: nothing to draw\n"
    assert "OUT: 'x.png': expected a name that ends in .gif" in run("gif", "in.bin", "x.png")[2]
    assert run("gif", "in.bin", "nix/x.gif")[2] == "error: nix/x.gif: there is no folder nix\n"


def test_pauses_are_left_out_of_a_gif_and_told(run, recording, tmp_path):
    twice = Events(np.append(recording.t, recording.t + 3600 * 10**6), *(
        np.tile(getattr(recording, key), 2) for key in "xyp"
    ), (34, 34))  # fmt: skip
    save(twice, tmp_path / "in.h5")
    assert run("gif", "in.h5")[1] == (
        "in.h5.gif: 31 frames of 272x272 px, 25 a second, as fast as it was; 89,972 still frames left out\n"
    )


def test_view(run, recording, tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "in.bin").rename(tmp_path / "sub" / "in.bin")
    assert run("view", "sub/in.bin") == (0, "in.bin.html: all events\n", "")
    assert (tmp_path / "in.bin.html").read_text("utf-8").endswith("</html>\n")
    told = "p.html: one of every 4 events; --most shows more\n"
    assert run("view", "sub/in.bin", "--out", "p.html", "--most", "30") == (0, told, "")


def test_interrupted(run, recording, monkeypatch, tmp_path):
    def stop(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr("neuro.events.formats.nmnist.Bin.pieces", stop)
    for words in (
        ("gif", "in.bin"),
        ("view", "in.bin"),
        ("convert", "in.bin", "o.h5"),
        ("split", "in.bin", "--count", "3"),
    ):
        status, out, err = run(*words)
        assert (status, out) == (130, "")
        assert re.fullmatch("interrupted: .* (is not written|are whole)\n", err)
    assert [path.name for path in tmp_path.iterdir()] == ["in.bin"]


@pytest.fixture
def data(tmp_path):
    for k, digit in enumerate((3, 3, 7, 3, 7, 3)):
        path = tmp_path / "set" / ("Test" if k > 4 else "Train") / str(digit) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes([1, 2, 128, 0, k]))
    return tmp_path / "set"


def test_tohdf5_as_in_the_thesis(run, data):
    words = ("tohdf5", "-f", "set/Train", "-e", "bin", "-o", "NMNIST_TRAIN.h5", "--jobs", "1")
    assert run(*words) == (0, "NMNIST_TRAIN.h5: 5 recordings of 2 classes\n", "")
    assert run(*words) == (0, "NMNIST_TRAIN.h5: 5 recordings of 2 classes\n", "")
    other = run("tohdf5", "-f", "set", "--part", "Test", "-o", "NMNIST_TRAIN.h5")
    assert other == (2, "", "error: NMNIST_TRAIN.h5: exists and holds something else; expected a new name\n")


def test_tohdf5_tells_damaged_files(run, data):
    (data / "Train/7/2.bin").write_bytes(b"abcdefg")
    words = ("tohdf5", "-f", "set", "--jobs", "1", "-o")
    path, what = "set/Train/7/2.bin", "byte 5: 2 bytes left over after 1 events of 5 bytes"
    told = f"1 damaged file, left out:\n  {path}: {what}\n"
    assert run(*words, "a.h5") == (1, "a.h5: 5 recordings of 2 classes\n", told)
    assert run(*words, "b.h5", "--strict") == (2, "", f"error: {path}: {what}\n")
    status, out, err = run(*words, "c.h5", "--lenient")
    assert (status, out) == (1, "c.h5: 6 recordings of 2 classes\n")
    assert err.startswith("1 damaged file, read as far as they are whole:\n")
    assert "expected one of the two" in run(*words, "d.h5", "--lenient", "--strict")[2]


def test_help_lists_all_and_imports_nothing_heavy():
    code = (
        "import sys; from neuro.cli.events import app\n"
        "heavy = {'numpy', 'numba', 'h5py', 'PIL', 'yaml', 'scipy', 'prompt_toolkit'} & set(sys.modules)\n"
        "sys.exit(str(sorted(heavy)) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_shell_runs_lines_and_stays_open_after_mistakes(run, recording, monkeypatch):
    lines = "info in.bin  # look\n\nnope\ninfo 'in.bin\nhelp gif\nconvert in.bin out.csv\nexit\ninfo none.bin\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
    status, out, err = run("shell")
    assert status == 0
    assert "events        100" in out
    assert "Draw a recording as a GIF" in out
    assert out.endswith("out.csv: 100 events\n")
    assert err.startswith(
        "error: No such command 'nope'\n  hint: see 'neuro events --help'\nerror: no closing quotation\n"
    )
    assert "none.bin" not in err


def test_the_shell_of_all_commands_takes_those_of_events_as_they_are(run, data, monkeypatch):
    lines = "help tohdf5\ntohdf5 -f set -e bin -o all.h5 --jobs 1\nevents info set\nshow\ninfo\nnope\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
    status, out, err = run("shell", group=())
    assert status == 0
    assert "Usage: neuro events tohdf5" in out
    assert "all.h5: 6 recordings of 2 classes\ndata set    set\n" in out
    assert err.startswith(
        "error: Missing argument 'FILE'\n  hint: see 'neuro events info --help'\nerror: unknown command 'nope'"
    )


def test_neuro_has_a_shell(monkeypatch, capsys):
    from neuro.cli.app import app as whole

    monkeypatch.setattr(sys, "stdin", io.StringIO("formats\nquit\n"))
    whole(["shell"], standalone_mode=False)
    assert "N-MNIST .bin" in capsys.readouterr().out


@pytest.fixture
def typed(run, monkeypatch, tmp_path):
    """Type keys into the shell."""
    prompt_toolkit = pytest.importorskip("prompt_toolkit")
    from prompt_toolkit.input import create_pipe_input
    from prompt_toolkit.output import DummyOutput

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(sys, "stdin", type("Terminal", (io.StringIO,), {"isatty": lambda self: True})())

    def keys(text):
        with create_pipe_input() as pipe:
            session = prompt_toolkit.PromptSession
            monkeypatch.setattr(
                prompt_toolkit, "PromptSession", lambda **more: session(input=pipe, output=DummyOutput(), **more)
            )
            pipe.send_text(text)
            return run("shell")

    return keys


def test_a_person_types_into_the_shell(typed, recording, tmp_path):
    status, out, err = typed("info in.bin\r\x04")
    assert (status, err) == (0, "")
    assert out.startswith("Tab completes, 'help' lists the commands, 'help COMMAND' tells more, 'exit' leaves.\nfile ")
    assert "+info in.bin" in (tmp_path / "state" / "neuro" / "shell-history").read_text()


def test_without_the_package_the_shell_says_how_to_get_it(run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", type("Terminal", (io.StringIO,), {"isatty": lambda self: True})())
    monkeypatch.setitem(sys.modules, "prompt_toolkit", None)
    expected = "error: the shell needs the package prompt_toolkit\n"
    assert run("shell") == (2, "", f"{expected}  hint: {install('events')}; pipes work without it\n")


def test_completion():
    from neuro.cli.events.shell import choices

    group = typer.main.get_command(root())
    context = group.make_context("neuro", [], resilient_parsing=True)
    inside = group.get_command(context, "events")
    there = inside.make_context("events", [], parent=context, resilient_parsing=True)

    def words(where, before, last):
        return [word for word, _ in choices(where, before, last)]

    assert words(there, [], "t") == ["tohdf5"]
    assert {"info", "gif", "help", "exit"} <= {*words(there, [], "")}
    assert words(there, ["help"], "vi") == ["view"]
    assert words(there, ["tohdf5"], "--st") == ["--strict"]
    assert words(there, ["tohdf5", "-f"], "in") == []
    assert words(there, ["nope"], "--x") == []
    assert words(context, [], "ev") == ["events"]
    assert words(context, [], "sh") == ["shell", "show"]
    assert words(context, [], "to") == ["tohdf5"]
    assert words(context, ["tohdf5"], "--st") == ["--strict"]
    assert words(context, ["events"], "co") == ["convert"]
    assert words(context, ["events", "gif", "a.bin"], "--fp") == ["--fps"]
    assert dict(choices(there, [], "view"))["view"].startswith("Write a page")


def test_files_are_completed_where_a_command_takes_them(recording, tmp_path, monkeypatch):
    document = pytest.importorskip("prompt_toolkit.document")
    from neuro.cli.events.shell import _completer

    monkeypatch.chdir(tmp_path)
    command = typer.main.get_command(app)
    completer = _completer(command.make_context("events", [], resilient_parsing=True))

    def found(line):
        return [one.text for one in completer.get_completions(document.Document(line), None)]

    assert found("info i") == ["n.bin"]
    assert found("inf") == ["info"]
    assert found("gif in.bin --fp") == ["--fps"]
    assert found("gi") == ["gif"]


def test_frames(run, recording, tmp_path):
    given = "count_segments: {count: 10}"
    status, out, err = run("frames", "in.bin", "a.npz", "--cut", given, "--as", "binary_frame")
    assert (status, err) == (0, "")
    with np.load(tmp_path / "a.npz") as found:
        assert np.array_equal(found["bounds"], count_segments(recording.t, 10))
        assert np.array_equal(found["frames"], binary_frame(recording, segments=found["bounds"]))
        assert out == f"a.npz: {len(found['frames'])} of binary_frame, {list(found['frames'].shape[1:])} bool\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--as", "hat"), "unknown representation 'hat'\n  hint: did you mean 'hats'?"),
        (("--cut", "msd_segments: {tua: 1}"), "unknown parameter of segmenter 'msd_segments' 'tua'"),
        (("--cut", "count_segments"), "Invalid value for '--cut': 'count_segments': expected all of count, rest=False"),
        (("--cut", "count_segments: {count: 1000000}"), "finds no segment in"),
    ],
)
def test_frames_that_cannot_be_made_are_told(run, recording, options, message):
    status, _, err = run("frames", "in.bin", "a.npz", *options)
    assert status == 2
    assert message in err
