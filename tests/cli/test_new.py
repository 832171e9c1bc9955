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
    sys.modules.pop("run", None)


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
    assert neuro("run", "network.yaml", "--for", "100").status == 0
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path("run.py", run_name="__main__")
    assert printed.getvalue()
    tests = {name: f for name, f in runpy.run_path("test_network.py").items() if name.startswith("test_")}
    assert tests
    for test in tests.values():
        test()


def test_a_classifier_learns_to_recognise(neuro, inside):
    written = neuro("new", "classifier")
    assert written.out == (
        "classifier: made from classifier\nfiles: learn.py, test_classifier.py, shapes.zip\n"
        "next:\n  cd classifier\n  python learn.py\n  python -m pytest     # needs pytest: pip install pytest\n"
        "  neuro recognise watch model.h5 RECORDING     # a page on which it decides while events arrive\n"
    )
    inside("classifier")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path("learn.py", run_name="__main__")
    sys.modules.pop("learn", None)
    found = re.fullmatch(r"18 unseen recordings: (\d+)% right, 33% by chance\n", printed.getvalue())
    assert found
    assert int(found[1]) > 60
    assert "remus for 3 classes, learnt from 18 recordings" in neuro("recognise", "show", "model.h5").out


def test_a_name_that_is_no_template_is_a_balanced_network(neuro, empty):
    files = "files: network.yaml, run.py, test_network.py\n"
    assert neuro("new", "mine").out.startswith(f"mine: made from balanced-network\n{files}")
    assert neuro("new", "closed-loop").out.startswith(f"closed-loop: made from closed-loop\n{files}")
    assert "env.step" not in Path("mine/run.py").read_text()


def test_a_name_that_is_nearly_a_template_is_pointed_out(neuro, empty):
    first = neuro("new", "clasifier").out.partition("\n")[0]
    assert first == "clasifier: made from balanced-network; did you mean 'neuro new classifier'?"
    assert "did you mean" not in neuro("new", "clasifierr", "--template", "closed-loop").out


def test_what_is_told_next_works_in_a_shell(neuro, empty):
    answer = neuro("new", "mine")
    assert answer.out == (
        "mine: made from balanced-network\nfiles: network.yaml, run.py, test_network.py\n"
        "next:\n  cd mine\n  python run.py\n  python -m pytest     # needs pytest: pip install pytest\n"
        "  neuro run network.yaml --out out.h5\n"
    )
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(words, cwd="mine", capture_output=True, text=True)
    assert "3 passed" in done.stdout, done.stdout + done.stderr


def test_an_empty_folder_is_filled_and_others_are_kept(neuro, empty):
    Path("there").mkdir()
    assert neuro("new", "there").status == 0
    before = {file: file.read_bytes() for file in Path("there").iterdir()}
    again = neuro("new", "there", "--template", "closed-loop")
    assert again.err == "error: there: is a folder with files in it: expected a new name, or an empty folder\n"
    assert {file: file.read_bytes() for file in Path("there").iterdir()} == before
    Path("file").write_text("mine")
    assert neuro("new", "file").err == "error: file: is no folder: expected a new name\n"
    assert neuro("new", "file/inside").err == (
        "error: file: is no folder: expected the name of a folder, or a new name\n"
    )
    assert sorted(path.name for path in empty.iterdir()) == ["file", "there"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["my net!"],
            "'my net!': expected a name of letters, digits, '_', '-' and '.' that begins with a letter\n"
            "  hint: neuro new my-net",
        ),
        (["."], "'.': expected a name of letters, digits, '_', '-' and '.' that begins with a letter\n"
            "  hint: neuro new my-network"),
        (["a", "--template", "balanced"], "unknown template 'balanced'\n  hint: did you mean 'balanced-network'?"),
        ([], "which folder? expected the name of one to make\n  hint: neuro new my-network, or --list"),
    ],
)  # fmt: skip
def test_mistakes(neuro, empty, words, message):
    answer = neuro("new", *words)
    assert (answer.status, answer.out, answer.err) == (2, "", f"error: {message}\n")
    assert not list(empty.iterdir())


def test_examples_are_written_and_never_replace(neuro, empty):
    assert neuro("example", "net.yaml", "walk.dat").out == "net.yaml\nwalk.dat\n"
    assert neuro("example", "net.yaml").status == 0
    Path("net.yaml").write_text("mine")
    Path("walk.dat").unlink()
    refused = neuro("example", "walk.dat", "net.yaml")
    assert refused.err == (
        "error: net.yaml: exists and is not the example\n  hint: go to an empty folder: mkdir try && cd try\n"
    )
    assert [path.name for path in empty.iterdir()] == ["net.yaml"]
    assert Path("net.yaml").read_text() == "mine"


def test_examples_are_listed_and_misspelt(neuro, empty):
    listed = neuro("example", "--list").out
    assert all(name in listed for name in shipped("examples"))
    assert neuro("example", "walk.dta").err == "error: unknown example 'walk.dta'\n  hint: did you mean 'walk.dat'?\n"
    assert neuro("example").err == (
        "error: which example? expected the names of files\n  hint: neuro example net.yaml, or --list\n"
    )


def test_recordings_are_those_that_the_script_makes(empty):
    runpy.run_path(str(RECORDING), run_name="__main__")
    for name in RECORDINGS:
        content = shipped("examples")[name].read_bytes()
        assert Path(name).read_bytes() == content, name
        assert len(content) < 100_000
    camera = load("walk.dat")
    assert camera.sensor_size == (64, 48)
    assert np.diff(camera.t).min() >= 0
