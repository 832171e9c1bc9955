"""`neuro new` and `neuro example`: what they write runs, and nothing of the user's is ever replaced."""

import contextlib
import io
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from neuro.cli.start import RECORDINGS, shipped
from neuro.events import load

TEMPLATES = ["balanced-network", "closed-loop", "custom-neuron", "event-camera", "winner-take-all"]
RECORDING = Path(__file__).parents[2] / "examples" / "recordings.py"


@pytest.fixture
def empty(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def inside(empty, monkeypatch):
    """Go into a folder as a script that is started there; its modules are forgotten afterwards."""

    def go(folder):
        monkeypatch.chdir(folder)
        monkeypatch.syspath_prepend(Path.cwd())

    yield go
    for name in ("run", "world"):
        sys.modules.pop(name, None)


def test_list(neuro):
    answer = neuro("new", "--list")
    assert (answer.status, answer.err) == (0, "")
    assert [word for word in answer.out.split() if word in TEMPLATES] == TEMPLATES
    assert "Balanced network: excitation and inhibition cancel, so that neurons fire irregularly" in answer.out


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_folder_runs_and_passes_as_written(neuro, inside, template):
    written = neuro("new", "mine", "--template", template)
    assert written.status == 0, written.err
    inside("mine")
    assert neuro("check", "network.yaml").status == 0
    world = ["--with", "world.py"] * Path("world.py").exists()
    assert neuro("run", "network.yaml", *world, "--for", "100").status == 0
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path("run.py", run_name="__main__")
    assert printed.getvalue()
    tests = {name: f for name, f in runpy.run_path("test_network.py").items() if name.startswith("test_")}
    assert tests
    for test in tests.values():
        test()


def test_a_classifier_learns_to_recognise(neuro, inside, messages):
    messages({"classifier": neuro("new", "classifier").out})
    inside("classifier")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path("learn.py", run_name="__main__")
    sys.modules.pop("learn", None)
    right = re.fullmatch(r"18 unseen recordings: (\d+)% right, 33% by chance\n", printed.getvalue())
    assert int(right[1]) > 60
    assert "remus for 3 classes, learnt from 18 recordings" in neuro("recognise", "show", "model.h5").out


def test_a_name_that_is_no_template_is_a_balanced_network(neuro, empty, messages):
    """What is told next works in a shell."""
    messages({name: neuro("new", name).out for name in ("mine", "closed-loop", "clasifier")})
    assert "env.step" not in Path("mine/run.py").read_text()
    assert "did you mean" not in neuro("new", "clasifierr", "--template", "closed-loop").out
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(words, cwd="mine", capture_output=True, text=True)
    assert "3 passed" in done.stdout, done.stdout + done.stderr


def test_an_empty_folder_is_filled_and_others_are_kept(neuro, empty, messages):
    Path("there").mkdir()
    assert neuro("new", "there").status == 0
    before = {file: file.read_bytes() for file in Path("there").iterdir()}
    Path("file").write_text("mine")
    messages({name: neuro("new", name, "--template", "closed-loop").err for name in ("there", "file", "file/inside")})
    assert {file: file.read_bytes() for file in Path("there").iterdir()} == before
    assert sorted(path.name for path in empty.iterdir()) == ["file", "there"]


def test_mistakes(neuro, empty, messages):
    wrong = (["my net!"], ["."], ["a", "--template", "balanced"], [])
    answers = {" ".join(words): neuro("new", *words) for words in wrong}
    assert {answer[:2] for answer in answers.values()} == {(2, "")}
    assert not list(empty.iterdir())
    messages({f"new {words}": answer.err for words, answer in answers.items()})
    messages({"example walk.dta": neuro("example", "walk.dta").err, "example": neuro("example").err})


def test_examples_are_written_and_never_replace(neuro, empty, messages):
    listed = neuro("example", "--list").out
    assert all(name in listed for name in shipped("examples"))
    assert neuro("example", "net.yaml", "walk.dat").out == "net.yaml\nwalk.dat\n"
    assert neuro("example", "net.yaml").status == 0
    Path("net.yaml").write_text("mine")
    Path("walk.dat").unlink()
    messages({"own": neuro("example", "walk.dat", "net.yaml").err})
    assert [path.name for path in empty.iterdir()] == ["net.yaml"]
    assert Path("net.yaml").read_text() == "mine"


def test_recordings_are_those_that_the_script_makes(empty):
    runpy.run_path(str(RECORDING), run_name="__main__")
    for name in RECORDINGS:
        content = shipped("examples")[name].read_bytes()
        assert Path(name).read_bytes() == content, name
        assert len(content) < 100_000
    camera = load("walk.dat")
    assert camera.sensor_size == (64, 48)
    assert np.diff(camera.t).min() >= 0
