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
from neuro_sweeps.folder import SWEEP, Folder, sum_of
from neuro_sweeps.rerun import copy_input, first_difference, rerun
from neuro_sweeps.table import table_of
from refused import refused

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
    """The lines that `neuro rerun` prints, or its error."""

    def lines(*words, status=0):
        capsys.readouterr()
        run("rerun", *words, status=status)
        printed = capsys.readouterr()
        return printed.err if status == 2 else printed.out.splitlines()

    return lines


SAME = ["a.h5: the same bits"]


@pytest.fixture
def made(folder, run):
    """Results of a run of 20 ms."""
    run("run", "net.yaml", "--for", 20, "--backend", "reference", "--seed", 3, "--out", "a.h5")
    return folder


def test_results_tell_where_they_come_from_and_are_made_again(made, again):
    told = json.loads(neuro.results.read("a.h5").about[ATTRIBUTE])
    assert told["neuro"] == neuro.__version__
    assert (told["backend"], told["seed"], told["threads"], told["steered"]) == ("reference", 3, 1, [])
    assert told["command"] == "neuro run net.yaml --for 20 --backend reference --seed 3 --out a.h5"
    assert told["folder"] == str(made)
    assert told["inputs"] == {str(made / name): digest_of(made / name) for name in ("net.yaml", "w.npy")}
    assert {"python", "numpy", "numba"} <= told["versions"].keys()
    assert "cores" in told["machine"]
    assert again("a.h5") == SAME


def record(file, **words):
    """Change what a file says of where it comes from."""
    with h5py.File(file, "r+") as opened:
        told = json.loads(opened.attrs[ATTRIBUTE]) | words
        opened.attrs[ATTRIBUTE] = json.dumps(told)
    seal(Path(file))
    return told


def test_a_run_that_keeps_some_spikes_only(folder, run, again):
    run("run", "net.yaml", "--for", 20, "--record", "noise", "--out", "a.h5")
    assert again("a.h5") == SAME


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")
def test_another_backend_gives_other_bits(made, again):
    first, *changed = again("a.h5", "--backend", "loihi", status=1)
    assert first.startswith("a.h5: not the same: populations/")
    assert " then, " in first
    assert changed == ["changed: backend: reference then, loihi now"]


def test_edited_files_and_other_versions_are_told(made, again):
    """The network is in the file as it was."""
    np.save(made / "w.npy", np.linspace(100.0, 400.0, 200))
    (made / "net.yaml").unlink()
    record("a.h5", neuro="0.0.9", versions=provenances.versions() | {"numpy": "1.0"})
    assert again("a.h5") == [
        *SAME,
        f"changed: neuro: 0.0.9 then, {neuro.__version__} now",
        f"changed: numpy: 1.0 then, {np.__version__} now",
        f"changed: input {made}/net.yaml: is missing",
        f"changed: input {made}/w.npy: was edited",
    ]


def test_what_differs_first_is_told(made, again):
    with h5py.File("a.h5", "r+") as file:
        weight = file["projections/noise_exc/weight"]
        now = float(weight[7])
        weight[7] = now + 1.0
    seal(Path("a.h5"))
    (first,) = again("a.h5", status=1)
    assert first == f"a.h5: not the same: projections/noise_exc/weight[7]: {now + 1.0!r} then, {now!r} now"


@pytest.fixture
def played(folder, run):
    (folder / "plays.yaml").write_text(PLAYS)
    shutil.copy(shipped("examples")["walk.dat"], folder / "walk.dat")
    run("run", "plays.yaml", "--for", 50, "--backend", "reference", "--out", "a.h5")
    return folder


def test_a_recording_that_was_moved(played, again):
    assert again("a.h5") == SAME
    assert again("a.h5", "--backend", "event") == [*SAME, "changed: backend: reference then, event now"]
    (played / "away").mkdir()
    (played / "walk.dat").rename(played / "away" / "other.dat")
    err = again("a.h5", status=2)
    assert f"a.h5: plays {played}/walk.dat, which is missing" in err
    assert "--moved-to FOLDER searches a folder for the file, by content" in err
    moved = f"changed: input {played}/walk.dat: moved to {played}/away/other.dat, with the same content"
    assert again("a.h5", "--moved-to", "away") == [*SAME, moved]


STREAMED = PLAYS.replace(
    "{file: walk.dat}", '{stream: "udp://127.0.0.1:0", format: spif, sensor: [9, 7], first_within: 10 ms}'
)


def test_a_stream_that_was_played(folder, run, again):
    """Nobody sends to it, so it ends at once; it is not opened while a file is made again."""
    (folder / "streamed.yaml").write_text(STREAMED)
    run("run", "streamed.yaml", "--for", 50, "--backend", "reference", "--out", "a.h5")
    err = again("a.h5", status=2)
    assert "a.h5: listens to udp://127.0.0.1:0: a stream cannot be repeated" in err
    assert "'neuro events listen' records a stream" in err
    page_of(folder, "neuro compare streamed.yaml --backends reference,event --html p.html", "streamed.yaml")
    assert "udp://127.0.0.1:0: streams cannot be opened while a file is reproduced" in again("p.html", status=2)


def test_a_page_is_made_again_and_asks_for_no_code(made, run, again):
    run("report", "a.h5")
    assert again("a.html") == ["a.html: the same bits"]
    page, asked = (made / "a.html").read_text(), "neuro report a.h5"
    for command, said in ((f"{asked} --with evil.py", "it was made with"), ("python -c evil", "by a command of neuro")):
        (made / "a.html").write_text(page.replace(f"{asked}&quot;", f"{command}&quot;"))
        assert said in again("a.html", status=2)
    assert "nothing.h5: no such file: expected results, a model, a page" in again("nothing.h5", status=2)
    assert "net.yaml: found no provenance" in again("net.yaml", status=2)


def test_a_recording_that_was_edited(played, again):
    data = bytearray((played / "walk.dat").read_bytes())
    data[len(data) - 8 * len(neuro.events.load("walk.dat")) + 8 * 5 + 4] ^= 1  # x of the sixth event
    (played / "walk.dat").write_bytes(data)
    first, *changed = again("a.h5", status=1)
    assert first.startswith("a.h5: not the same: ")
    assert changed == [f"changed: input {played}/walk.dat: was edited"]


def test_a_run_that_was_steered_is_refused(folder):
    sim = neuro.compile(neuro.load("net.yaml"), backend="reference")
    with sim.record_to("a.h5"):
        sim.run(10.0)
        sim.set("exc", V_th=-52.0)
        sim.run(10.0)
    assert json.loads(neuro.results.read("a.h5").about[ATTRIBUTE])["steered"] == ["set"]
    error = refused(rerun, folder / "a.h5")
    assert "a.h5: the run was steered by sim.set: expected a run without" in error
    assert "written by: " in error


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


def test_a_run_of_a_sweep_is_made_again(folder, run, again):
    (folder / "sweep.yaml").write_text("network: net.yaml\nfor: 20 ms\nbackend: reference\nseeds: 2\nkeep: results\n")
    run("sweep", "run", "sweep.yaml", "--on", "here")
    key = f"runs/runs/{table_of('runs').keys[1]}"
    assert again(key) == [f"{key}: the same bits"]
    path = folder / key / "run.json"
    told = json.loads(path.read_text())
    told["metrics"]["spikes"] += 1
    told["sum"] = sum_of({word: value for word, value in told.items() if word != "sum"})
    path.write_text(json.dumps(told))
    then = told["metrics"]["spikes"]
    assert again(key, status=1) == [f"{key}: not the same: metric spikes: {then} then, {then - 1} now"]


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


def test_what_is_refused_does_not_steer():
    net = neuro.Network("refused", resolution=0.1)
    net.population("spikes", 1, neuro.spike_generator(spike_times=[1.0]))
    net.population("cells", 1, neuro.iaf_psc_exp())
    net.connect("spikes", "cells", neuro.all_to_all(), weight=100.0, delay=0.1, name="in")
    for call, refuse in REFUSED.items():
        sim = neuro.compile(net, backend="reference")
        sim.run(1.0)
        refused(refuse, sim)
        assert list(sim.steered) == [], call
        assert sim.get("cells", "V_m")[0] == -70.0, call
        sim.set("cells", V_m=-60.0)
        assert list(sim.steered) == ["set"], call


def page_of(folder, command, *inputs):
    """A page that says it was made by a command."""
    told = {"command": command, "folder": str(folder), "inputs": {str(folder / name): "x" for name in inputs}}
    (folder / "p.html").write_text(f'<meta name="{ATTRIBUTE}" content="{html.escape(json.dumps(told))}">')


EVIL = [
    *(f"neuro report {words}" for words in ("a.h5 --with=evil.py", "--with evil.py -- a.h5", "a.h5 --wit=evil.py")),
    *("neuro check net.yaml --with=evil.py", "neuro convert s.py out.yaml --run-script", "neuro report a.h5 --help"),
    *("neuro agent train evil:Env --steps 1", "neuro events view tcp://127.0.0.1:9", "neuro report a.h5 b.h5"),
]


def test_a_record_asks_for_nothing_that_is_not_on_the_list(folder, again, messages):
    (folder / "evil.py").write_text("open('CODE_RAN', 'w')")
    for command in EVIL:
        page_of(folder, command, "evil.py", "net.yaml")
        messages({command: again("p.html", status=2).replace(str(folder), "HERE")})
    assert not (folder / "CODE_RAN").exists()


def test_a_message_steers_no_terminal(folder, again):
    """Nor is it as long as the command that it names."""
    page_of(folder, "python \x1b]0;owned\x07")
    assert "\\x1b]0;owned\\x07" in (err := again("p.html", status=2))
    assert "\x1b" not in err
    page_of(folder, "neuro report " + "x " * 300_000)
    err = again("p.html", status=2)
    assert "its command has 600,013 characters: expected at most 65,536" in err
    assert len(err) < 2000


def test_the_list_has_parameters_of_commands_that_are_there():
    commands = typer.main.get_command(app)
    for name, allowed in ALLOWED.items():
        options = {each.name: each for each in command_of(commands, name.split()).params}
        assert set(allowed.split()) <= options.keys(), name
        chip = {"on"} if name == "train" else set()  # `on` of a training is its option --chip
        assert not {"run_script", "page", "on", "host"} & set(allowed.split()) - chip


def test_a_path_that_leads_out_leads_into_the_new_folder(made, run, again):
    """Also where it is absolute, or passes through a link in an input folder, and no input is written."""
    run("report", "a.h5")
    (made / "elsewhere").mkdir()
    page, out = (made / "a.html").read_bytes(), made / "elsewhere" / "a.html"
    for path in (out, "../" * 40 + str(out)[1:], "elsewhere/a.html"):
        out.write_bytes(page)
        before = out.stat()
        page_of(made, f"neuro report a.h5 --out {path}", "a.h5", "elsewhere")
        again("p.html", status=1)
        assert (out.stat().st_ino, out.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_inputs_that_are_not_copied(folder, again, monkeypatch):
    """Links that lead out, more than the disk holds, Python files and settings."""
    for name in ("evil.py", "evil.so", "evil.pyc", "matplotlibrc", ".numba_config.yaml", "w2.npy"):
        (folder / name).touch()
    copies = [*copy_input(folder, folder.parent / "copies")]
    assert sorted(path.name for path in copies) == ["net.yaml", "w.npy", "w2.npy"]
    (folder / "data").mkdir()
    (folder / "data" / "in").symlink_to("/etc")
    page_of(folder, "neuro report a.h5", "data")
    link = f"{folder}/data/in: is a link out of {folder}/data: expected files"
    assert link in again("p.html", status=2)
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=10))
    page_of(folder, "neuro report a.h5", "net.yaml")
    size = (folder / "net.yaml").stat().st_size
    assert f"{folder}/net.yaml: needs {size:,} bytes in " in again("p.html", status=2)


def test_a_function_of_a_sweep_is_that_of_a_file_that_the_user_names(folder, again, registries):
    (folder / "my_study.py").write_text("import os\ndef f(command):\n    return len(command)\n")
    sys.path.insert(0, str(folder))
    from my_study import f

    neuro.sweep(f, {"command": ["touch CODE_RAN"]}, out=folder / "runs", on="here", progress=False)
    runs, trusted = Folder(folder / "runs", SWEEP), ("--with", "my_study.py")
    key = f"runs/runs/{runs.read()['runs'][0][0]}"
    said = "it was made with my_study.py\n  hint: if you trust this file, add --with my_study.py"
    assert said in again(key, status=2)
    again(key, *trusted)
    for name, module in (("system", "posix"), ("os.system", "my_study"), ("os.path.exists", "my_study")):
        content = {word: value for word, value in runs.read().items() if word not in ("format", "digest")}
        content["what"] |= {"name": name, "module": module}
        runs.write(content)
        said = "it was made with posix.py" if module == "posix" else "my_study.py: defines no function"
        assert said in again(key, *trusted, status=2)
    assert not (folder / "CODE_RAN").exists()


def test_a_sweep_goes_on_by_the_definition_of_the_user(folder, run, capsys):
    """Worker processes read the folder, in which somebody else may have written another function, or a link."""
    (folder / "sweep.yaml").write_text("network: net.yaml\nfor: 20 ms\nseeds: 1\nbackend: reference\n")
    run("sweep", "run", "sweep.yaml", "--on", "here")
    runs = Folder(folder / "runs", SWEEP)
    content = {word: value for word, value in runs.read().items() if word not in ("format", "digest")}
    what = content["what"]
    content["what"] = {"kind": "function", "name": "system", "module": "posix", "file": "", "set": {}, "paths": []}
    runs.write(content | {"with": {"evil.py": "x"}})
    run("sweep", "run", "sweep.yaml", "--on", "here")
    assert (runs.read()["what"], runs.read()["with"]) == (what, {})
    for name in ("away", "linked"):
        (folder / name).mkdir()
    (folder / "linked" / "runs").symlink_to(folder / "away")
    run("sweep", "run", "sweep.yaml", "--on", "here", "--out", "linked", status=2)
    assert "linked/runs: is a link: expected a folder with its own runs" in capsys.readouterr().err


def test_results_copy_no_file_out_of_the_new_folder(played, again):
    (played / "source.dat").write_bytes(b"mine")
    with h5py.File("a.h5", "r+") as opened:
        text = bytes(opened["network"][()]).decode()
        del opened["network"]
        opened["network"] = text.replace("walk.dat", "../../stolen.dat")
    record("a.h5", inputs={f"{played}/source.dat/../../stolen.dat": "x"})
    assert "expected a file beside the network" in again("a.h5", status=2)


def linked(file, kind):
    """Link a part of a file elsewhere: to a pipe that nobody writes into, or in a ring."""
    if kind == "virtual":
        layout = h5py.VirtualLayout(shape=(4,), dtype="i8")
        layout[:] = h5py.VirtualSource("pipe", "x", shape=(4,))
        file.create_virtual_dataset("more", layout)
    elif kind == "stored":
        file.create_dataset("more", (4,), "u1", external=[("pipe", 0, 4)])
    else:
        links = {"soft": h5py.SoftLink("/"), "external": h5py.ExternalLink("pipe", "/"), "ring": file["populations"]}
        file["more"] = links[kind]


def test_results_that_are_not_their_own_are_refused(made, answer):
    whole = (made / "a.h5").read_bytes()
    os.mkfifo(made / "pipe")
    for kind in ("soft", "external", "ring", "virtual", "stored"):
        (made / "a.h5").write_bytes(whole)
        with h5py.File("a.h5", "r+") as file:
            linked(file, kind)
        seal(made / "a.h5")
        for command in ("plot", "report", "rerun"):
            end = answer(command, "a.h5")
            assert (end.status, "lies elsewhere: expected a part of the file" in end.err) == (2, True), kind
