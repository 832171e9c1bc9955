"""Files say where they come from, and are made again to the bit; what changed is told."""

import html
import json
import os
import shutil
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import typer

import neuro
from neuro.cli.commands import app
from neuro.cli.start import shipped
from neuro.core import provenance as provenances
from neuro.core.hdf5 import seal
from neuro.core.inputs import digest_of, gathering, record_input
from neuro.core.provenance import ATTRIBUTE, differences, provenance
from neuro_sweeps.cli.recorded import ALLOWED, command_of
from neuro_sweeps.folder import SWEEP, Folder
from neuro_sweeps.rerun import copy_input, first_difference

NET = """\
neuro: 1
name: pair
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 20}
  exc: {model: iaf_psc_exp, shape: 10}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: {file: w.npy}, delay: 1.0, synapse: {stdp: {Wmax: 900.0}}}
probes:
  v: {of: exc, record: V_m, every: 5.0}
"""
PLAYS = """\
neuro: 1
name: plays
resolution: 1.0
populations:
  eye: {model: {event_camera: {file: walk.dat}}, shape: auto}
probes: {seen: {of: eye}}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NET)
    np.save(tmp_path / "w.npy", np.linspace(300.0, 400.0, 200))
    return tmp_path


@pytest.fixture
def again(run, capsys):
    """The lines that `neuro rerun` tells."""

    def told(*words, status=0):
        capsys.readouterr()
        run("rerun", *words, status=status)
        return capsys.readouterr().out.splitlines()

    return told


def record(file, **words):
    """Change what a file says of where it comes from."""
    with h5py.File(file, "r+") as opened:
        told = json.loads(opened.attrs[ATTRIBUTE]) | words
        opened.attrs[ATTRIBUTE] = json.dumps(told)
    seal(Path(file))
    return told


def test_results_tell_where_they_come_from(folder, run):
    run("run", "net.yaml", "--for", 50, "--seed", 3, "--backend", "reference", "--out", "a.h5")
    told = json.loads(neuro.results.read("a.h5").about[ATTRIBUTE])
    assert told["neuro"] == neuro.__version__
    assert (told["backend"], told["seed"], told["threads"], told["steered"]) == ("reference", 3, 1, [])
    assert told["command"] == "neuro run net.yaml --for 50 --seed 3 --backend reference --out a.h5"
    assert told["folder"] == str(folder)
    assert told["inputs"] == {str(folder / name): digest_of(folder / name) for name in ("net.yaml", "w.npy")}
    assert {"python", "numpy", "numba"} <= told["versions"].keys()
    assert "cores" in told["machine"]


def test_the_same_bits(folder, run, again):
    run("run", "net.yaml", "--for", 50, "--seed", 3, "--out", "a.h5")
    assert again("a.h5") == ["a.h5: the same bits"]


def test_another_backend_with_the_same_bits(played, again):
    assert again("a.h5", "--backend", "reference") == [
        "a.h5: the same bits",
        "changed: backend: event then, reference now",
    ]


def test_a_run_that_keeps_some_spikes_only(folder, run, again):
    run("run", "net.yaml", "--for", 20, "--record", "noise", "--out", "a.h5")
    assert again("a.h5") == ["a.h5: the same bits"]


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")
def test_another_backend_gives_other_bits(folder, run, again):
    run("run", "net.yaml", "--for", 50, "--out", "a.h5")
    first, *changed = again("a.h5", "--backend", "loihi", status=1)
    assert first.startswith("a.h5: not the same: populations/")
    assert " then, " in first
    assert changed == ["changed: backend: event then, loihi now"]


def test_an_edited_file_is_told(folder, run, again):
    """The network is in the file as it was."""
    run("run", "net.yaml", "--for", 50, "--out", "a.h5")
    np.save(folder / "w.npy", np.linspace(100.0, 400.0, 200))
    (folder / "net.yaml").unlink()
    assert again("a.h5") == [
        "a.h5: the same bits",
        f"changed: input {folder}/net.yaml: is not there any more",
        f"changed: input {folder}/w.npy: was edited",
    ]


def test_other_versions_are_told(folder, run, again, monkeypatch):
    run("run", "net.yaml", "--for", 20, "--out", "a.h5")
    versions = provenances.versions() | {"numpy": "1.0"}
    record("a.h5", neuro="0.0.9", versions=versions)
    assert again("a.h5") == [
        "a.h5: the same bits",
        f"changed: neuro: 0.0.9 then, {neuro.__version__} now",
        f"changed: numpy: 1.0 then, {np.__version__} now",
    ]


def test_what_differs_first_is_told(folder, run, again):
    run("run", "net.yaml", "--for", 50, "--out", "a.h5")
    with h5py.File("a.h5", "r+") as file:
        weight = file["projections/noise_exc/weight"]
        before = weight[7]
        weight[7] = before + 1.0
    seal(Path("a.h5"))
    (first,) = again("a.h5", status=1)
    assert first == (
        f"a.h5: not the same: projections/noise_exc/weight[7]: {float(before) + 1.0!r} then, {float(before)!r} now"
    )


@pytest.fixture
def played(folder, run):
    (folder / "plays.yaml").write_text(PLAYS)
    shutil.copy(shipped("examples")["walk.dat"], folder / "walk.dat")
    run("run", "plays.yaml", "--for", 50, "--out", "a.h5")
    return folder


def test_a_recording_that_was_moved(played, run, again, capsys):
    assert again("a.h5") == ["a.h5: the same bits"]
    (played / "away").mkdir()
    (played / "walk.dat").rename(played / "away" / "other.dat")
    run("rerun", "a.h5", status=2)
    err = capsys.readouterr().err
    assert f"a.h5: plays {played}/walk.dat, which is not there any more" in err
    assert "--moved-to FOLDER looks for it there, by its content" in err
    told = again("a.h5", "--moved-to", "away")
    assert told == [
        "a.h5: the same bits",
        f"changed: input {played}/walk.dat: lies at {played}/away/other.dat now, with the same content",
    ]


def test_a_stream_that_was_played(folder, run, capsys):
    """Nobody sends to it, so it ends at once."""
    streamed = '{stream: "udp://127.0.0.1:0", format: spif, sensor: [9, 7], first_within: 10 ms}'
    (folder / "streamed.yaml").write_text(PLAYS.replace("{file: walk.dat}", streamed))
    run("run", "streamed.yaml", "--for", 50, "--out", "a.h5")
    run("rerun", "a.h5", status=2)
    told = capsys.readouterr().err
    assert "a.h5: listens to udp://127.0.0.1:0: what came from there does not come again" in told
    assert "'neuro events listen' keeps a stream" in told


def test_a_recording_that_was_edited(played, again):
    data = bytearray((played / "walk.dat").read_bytes())
    data[len(data) - 8 * len(neuro.events.load("walk.dat")) + 8 * 5 + 4] ^= 1  # x of the sixth event
    (played / "walk.dat").write_bytes(data)
    first, *changed = again("a.h5", status=1)
    assert first.startswith("a.h5: not the same: ")
    assert changed == [f"changed: input {played}/walk.dat: was edited"]


def test_a_run_that_was_steered_is_refused(folder):
    net = neuro.load("net.yaml")
    sim = neuro.compile(net, backend="reference")
    with sim.record_to("a.h5"):
        sim.run(10.0)
        sim.set("exc", V_th=-52.0)
        sim.run(10.0)
    told = json.loads(neuro.results.read("a.h5").about[ATTRIBUTE])
    assert told["steered"] == ["set"]
    from neuro_sweeps.rerun import rerun

    with pytest.raises(neuro.ModelError) as error:
        rerun(folder / "a.h5")
    assert "a.h5: was changed while it ran by sim.set: expected a run without" in str(error.value)
    assert "it was made by: " in str(error.value)


def test_a_state_has_its_network_and_its_record(folder):
    sim = neuro.compile(neuro.load("net.yaml"), backend="reference", seed=2)
    sim.run(5.0)
    sim.save("state.h5")
    with h5py.File("state.h5") as file:
        told = json.loads(file.attrs[ATTRIBUTE])
        assert "populations:" in bytes(file["network_files/network.yaml"][()]).decode()
    assert (told["seed"], told["time_ms"], [*told["inputs"]]) == (2, 5.0, [f"{folder}/net.yaml", f"{folder}/w.npy"])
    other = neuro.compile(neuro.load("net.yaml"), backend="reference", seed=2)
    other.restore("state.h5")
    other.save("again.h5")
    assert first_difference(folder / "state.h5", folder / "again.h5") == ""


def test_a_page_is_made_again(folder, run, again):
    run("run", "net.yaml", "--for", 20, "--out", "a.h5")
    run("report", "a.h5")
    assert again("a.html") == ["a.html: the same bits"]


def test_a_run_of_a_sweep_is_made_again(folder, run, again):
    (folder / "sweep.yaml").write_text("network: net.yaml\nfor: 20 ms\nseeds: 2\nkeep: results\n")
    run("sweep", "run", "sweep.yaml", "--on", "here")
    from neuro_sweeps.folder import sum_of
    from neuro_sweeps.table import table_of

    key = table_of("runs").keys[1]
    assert again(f"runs/runs/{key}") == [f"runs/runs/{key}: the same bits"]
    path = folder / "runs" / "runs" / key / "run.json"
    told = json.loads(path.read_text())
    told["metrics"]["spikes"] += 1
    told["sum"] = sum_of({word: value for word, value in told.items() if word != "sum"})
    path.write_text(json.dumps(told))
    now = told["metrics"]["spikes"] - 1
    assert again(f"runs/runs/{key}", status=1) == [
        f"runs/runs/{key}: not the same: metric spikes: {now + 1} then, {now} now"
    ]


def test_a_file_runs_no_code_that_its_reader_did_not_name(folder, run, capsys):
    run("run", "net.yaml", "--for", 20, "--out", "a.h5")
    run("report", "a.h5")
    page = (folder / "a.html").read_text()
    (folder / "a.html").write_text(page.replace("neuro report a.h5&quot;", "neuro report a.h5 --with evil.py&quot;"))
    run("rerun", "a.html", status=2)
    assert "it was made with" in capsys.readouterr().err
    (folder / "a.html").write_text(page.replace("neuro report a.h5&quot;", "python -c evil&quot;"))
    run("rerun", "a.html", status=2)
    assert "a.html: was not made by a command of neuro: expected one" in capsys.readouterr().err


MISTAKES = [
    ("nothing.h5", "nothing.h5: no such file: expected results, a model, a page, or the folder of a run"),
    ("net.yaml", "net.yaml: does not say where it comes from"),
]


@pytest.mark.parametrize(("file", "told"), MISTAKES)
def test_a_mistake_is_told(folder, run, file, told, capsys):
    run("rerun", file, status=2)
    assert told in capsys.readouterr().err


def test_a_folder_counts_as_one_input(tmp_path):
    for k in range(3):
        (tmp_path / f"{k}.txt").write_text("a")
    before = digest_of(tmp_path)
    told = provenance([str(tmp_path), str(tmp_path / "0.txt")])
    assert told["inputs"] == {str(tmp_path): before}
    (tmp_path / "0.txt").write_text("ab")
    assert digest_of(tmp_path) != before


def test_a_pipe_is_not_waited_for(tmp_path):
    """What comes through a pipe cannot be read twice."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    threading.Thread(target=lambda: pipe.open("wb").close(), daemon=True).start()  # so that one who opens it goes on
    assert digest_of(pipe) == ""
    assert digest_of(tmp_path)
    os.close(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK))


def test_differences_name_what_changed():
    now = provenance((), backend="event")
    assert differences(now, now) == []
    assert differences(now | {"machine": "another"}, now) == [f"machine: another then, {now['machine']} now"]


def test_what_is_read_in_a_block_is_gathered(tmp_path):
    with gathering() as found:
        record_input(tmp_path / "a")
    record_input(tmp_path / "b")
    assert [*found] == [str(tmp_path / "a")]


REFUSED = {
    "set": lambda sim: sim.set("cells", tau_m=-1.0),
    "set nothing": lambda sim: sim.set("cells"),
    "set of two, one of them wrong": lambda sim: sim.set("cells", V_m=-60.0, tau_m=-1.0),
    "set a projection": lambda sim: sim.set("in", weight="large"),
    "set_weights": lambda sim: sim.set_weights("in", [1.0, 2.0, 3.0]),
    "inject": lambda sim: sim.inject("spikes", [0.05]),
    "inject into neurons": lambda sim: sim.inject("cells", [5.0]),
    "feed": lambda sim: sim.feed("spikes", []),
    "signal": lambda sim: sim.signal("reward", 1.0),
    "reset": lambda sim: sim.reset(weights="all"),
    "a port": lambda sim: sim.port("cells", "tau_m").set(-1.0),
}


@pytest.mark.parametrize("call", REFUSED)
def test_what_is_refused_does_not_steer(call):
    net = neuro.Network("refused", resolution=0.1)
    net.population("spikes", 1, neuro.spike_generator(spike_times=[1.0]))
    net.population("cells", 1, neuro.iaf_psc_exp())
    net.connect("spikes", "cells", neuro.all_to_all(), weight=100.0, delay=0.1, name="in")
    sim = neuro.compile(net, backend="reference")
    sim.run(1.0)
    with pytest.raises(neuro.ModelError):
        REFUSED[call](sim)
    assert list(sim.steered) == []
    assert sim.get("cells", "V_m")[0] == -70.0
    sim.set("cells", V_m=-60.0)
    assert list(sim.steered) == ["set"]


def page_of(folder, command, *inputs):
    """A page that says it was made by a command."""
    told = {"command": command, "folder": str(folder), "inputs": {str(folder / name): "x" for name in inputs}}
    (folder / "p.html").write_text(f'<meta name="{ATTRIBUTE}" content="{html.escape(json.dumps(told))}">')


EVIL = [
    ("neuro check net.yaml --with=evil.py", "asks for 'neuro check net.yaml', which no file may ask for"),
    ("neuro report a.h5 --with=evil.py", "it was made with evil.py"),
    ("neuro report --with evil.py -- a.h5", "it was made with evil.py"),
    ("neuro report a.h5 --wit=evil.py", "unknown option '--wit'"),
    ("neuro convert s.py out.yaml --run-script", "asks for 'neuro convert s.py', which no file may ask for"),
    ("neuro agent train evil:Env --steps 1", "it was made with evil.py"),
    ("neuro events view tcp://127.0.0.1:9", "asks for the address tcp://127.0.0.1:9, which no file may ask for"),
    ("neuro report a.h5 --help", "asks for --help of 'neuro report', which no file may ask for"),
    ("neuro report a.h5 b.h5", "asks for 'b.h5' of 'neuro report', which no file may ask for"),
]


@pytest.mark.parametrize(("command", "told"), EVIL)
def test_a_record_asks_for_nothing_that_is_not_on_the_list(folder, run, capsys, command, told):
    (folder / "evil.py").write_text("open('CODE_RAN', 'w')")
    page_of(folder, command, "evil.py", "net.yaml")
    run("rerun", "p.html", status=2)
    assert told in capsys.readouterr().err
    assert not (folder / "CODE_RAN").exists()


def test_the_list_has_parameters_of_commands_that_are_there():
    commands = typer.main.get_command(app)
    for name, allowed in ALLOWED.items():
        options = {each.name: each for each in command_of(commands, name.split()).params}
        assert set(allowed.split()) <= options.keys(), name
        chip = {"on"} if name == "train" else set()  # `on` of a training is its option --chip
        assert not {"run_script", "page", "on", "host"} & set(allowed.split()) - chip


def test_a_path_that_leads_out_leads_into_the_new_folder(folder, run, again):
    """Also where it is absolute, or passes through a link in an input folder, and no input is written."""
    run("run", "net.yaml", "--for", 20, "--out", "a.h5")
    run("report", "a.h5")
    (folder / "elsewhere").mkdir()
    page, out = (folder / "a.html").read_bytes(), folder / "elsewhere" / "a.html"
    for path in (out, "../" * 40 + str(out)[1:], "elsewhere/a.html"):
        out.write_bytes(page)
        before = out.stat()
        page_of(folder, f"neuro report a.h5 --out {path}", "a.h5", "elsewhere")
        again("p.html", status=1)
        assert (out.stat().st_ino, out.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_a_link_out_of_an_input_folder_is_refused(folder, run, capsys):
    (folder / "data").mkdir()
    (folder / "data" / "in").symlink_to("/etc")
    page_of(folder, "neuro report a.h5", "data")
    run("rerun", "p.html", status=2)
    assert f"{folder}/data/in: a link that leads out of {folder}/data: expected files" in capsys.readouterr().err


def test_more_than_the_disk_holds_is_not_copied(folder, run, capsys, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=10))
    page_of(folder, "neuro report a.h5", "net.yaml")
    run("rerun", "p.html", status=2)
    assert f"{folder}/net.yaml: has {(folder / 'net.yaml').stat().st_size:,} bytes to copy" in capsys.readouterr().err


def test_python_files_and_settings_are_not_copied(folder):
    for name in ("evil.py", "evil.so", "evil.pyc", "matplotlibrc", ".numba_config.yaml", "w2.npy"):
        (folder / name).touch()
    copies = [*copy_input(folder, folder.parent / "copies")]
    assert sorted(path.name for path in copies) == ["net.yaml", "w.npy", "w2.npy"]


def test_a_function_of_a_sweep_is_that_of_a_file_that_the_user_names(folder, run, capsys, registries):
    (folder / "my_study.py").write_text("import os\ndef f(command):\n    return len(command)\n")
    sys.path.insert(0, str(folder))
    from my_study import f

    neuro.sweep(f, {"command": ["touch CODE_RAN"]}, out=folder / "runs", on="here", progress=False)
    runs = Folder(folder / "runs", SWEEP)
    key = runs.read()["runs"][0][0]
    run("rerun", f"runs/runs/{key}", status=2)
    assert (
        "it was made with my_study.py\n  hint: say so, if you trust it: --with my_study.py" in capsys.readouterr().err
    )
    run("rerun", f"runs/runs/{key}", "--with", "my_study.py")
    for name, module in (("system", "posix"), ("os.system", "my_study"), ("os.path.exists", "my_study")):
        content = {word: value for word, value in runs.read().items() if word not in ("format", "digest")}
        content["what"] |= {"name": name, "module": module}
        runs.write(content)
        run("rerun", f"runs/runs/{key}", "--with", "my_study.py", status=2)
        assert ("it was made with posix.py", "my_study.py: defines no function")[module == "my_study"] in (
            capsys.readouterr().err
        )
    assert not (folder / "CODE_RAN").exists()


def test_a_sweep_goes_on_by_the_definition_of_the_user(folder, run):
    """Worker processes read the folder, in which somebody else may have written another function."""
    (folder / "sweep.yaml").write_text("network: net.yaml\nfor: 20 ms\nseeds: 1\nbackend: reference\n")
    run("sweep", "run", "sweep.yaml", "--on", "here")
    runs = Folder(folder / "runs", SWEEP)
    content = {word: value for word, value in runs.read().items() if word not in ("format", "digest")}
    what = content["what"]
    content["what"] = {"kind": "function", "name": "system", "module": "posix", "file": "", "set": {}, "paths": []}
    runs.write(content | {"with": {"evil.py": "x"}})
    run("sweep", "run", "sweep.yaml", "--on", "here")
    assert (runs.read()["what"], runs.read()["with"]) == (what, {})


def test_a_sweep_writes_through_no_link(folder, run, capsys):
    (folder / "sweep.yaml").write_text("network: net.yaml\nfor: 20 ms\nseeds: 1\nbackend: reference\n")
    (folder / "runs").mkdir()
    (folder / "away").mkdir()
    (folder / "runs" / "runs").symlink_to(folder / "away")
    run("sweep", "run", "sweep.yaml", "--on", "here", status=2)
    assert "runs/runs: is a link: expected a folder that holds its own runs" in capsys.readouterr().err


def test_a_message_steers_no_terminal(folder, run, capsys):
    page_of(folder, "python \x1b]0;owned\x07")
    run("rerun", "p.html", status=2)
    told = capsys.readouterr().err
    assert "\\x1b]0;owned\\x07" in told
    assert "\x1b" not in told


def test_no_stream_is_opened_while_a_file_is_made_again(folder, run, capsys, monkeypatch):
    """Also where the network of a record listens."""
    streamed = '{stream: "udp://127.0.0.1:0", format: spif, sensor: [9, 7], first_within: 10 ms}'
    (folder / "streamed.yaml").write_text(PLAYS.replace("{file: walk.dat}", streamed))
    page_of(folder, "neuro compare streamed.yaml --backends reference,event --html p.html", "streamed.yaml")
    run("rerun", "p.html", status=2)
    assert "udp://127.0.0.1:0: is not opened while a file is made again" in capsys.readouterr().err


def test_results_copy_no_file_out_of_the_new_folder(folder, played, run, capsys):
    (folder / "source.dat").write_bytes(b"mine")
    with h5py.File("a.h5", "r+") as opened:
        text = bytes(opened["network"][()]).decode()
        del opened["network"]
        opened["network"] = text.replace("walk.dat", "../../stolen.dat")
    record("a.h5", inputs={f"{folder}/source.dat/../../stolen.dat": "x"})
    run("rerun", "a.h5", status=2)
    assert "expected a file beside the network" in capsys.readouterr().err


def test_a_command_that_is_long_is_refused_soon(folder, run, capsys):
    page_of(folder, "neuro report " + "x " * 300_000)
    run("rerun", "p.html", status=2)
    told = capsys.readouterr().err
    assert "its command has 600,013 characters: expected at most 65,536" in told
    assert len(told) < 2000


@pytest.mark.parametrize("kind", ["soft", "external", "ring", "virtual", "stored"])
def test_results_that_are_not_their_own_are_refused(folder, run, capsys, kind):
    """A link to another file, here a pipe that nobody writes into, and groups that hold each other."""
    run("run", "net.yaml", "--for", 20, "--out", "a.h5")
    os.mkfifo(folder / "pipe")
    with h5py.File("a.h5", "r+") as opened:
        if kind == "soft":
            opened["more"] = h5py.SoftLink("/")
        elif kind == "external":
            opened["more"] = h5py.ExternalLink("pipe", "/")
        elif kind == "ring":
            opened["more"] = opened["populations"]
        elif kind == "virtual":
            layout = h5py.VirtualLayout(shape=(4,), dtype="i8")
            layout[:] = h5py.VirtualSource("pipe", "x", shape=(4,))
            opened.create_virtual_dataset("more", layout)
        else:
            opened.create_dataset("more", (4,), "u1", external=[("pipe", 0, 4)])
    seal(folder / "a.h5")
    for words in (("plot", "a.h5"), ("report", "a.h5"), ("rerun", "a.h5")):
        run(*words, status=2)
        assert "lies elsewhere: expected a part of the file" in capsys.readouterr().err
