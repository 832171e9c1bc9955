"""`neuro new --template agent`: what it writes runs, passes as written, and leads on."""

import contextlib
import io
import re
import runpy
import sys
from pathlib import Path

import pytest

import neuro_agent


@pytest.fixture
def folder(answer, tmp_path, monkeypatch):
    """A folder as the command writes it, with the current one in it; its modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    written = answer("new", "mine", "--template", "agent")
    assert written.out == (
        "mine: made from agent\nfiles: test_world.py, train.py, world.py\n"
        "next:\n  cd mine\n  python train.py\n  python -m pytest     # needs pytest: pip install pytest\n"
        "  neuro agent watch agent.h5 world:Room --out episode.html\n"
    )
    monkeypatch.chdir("mine")
    monkeypatch.syspath_prepend(Path.cwd())
    yield answer
    for name in ("world", "train"):
        sys.modules.pop(name, None)


def test_list(answer):
    listed = answer("new", "--list").out
    assert re.search(r"agent +Agent: spiking neurons learn by reward in an environment of your own *\n", listed)


@pytest.fixture
def cut(monkeypatch):
    """Let trainings end sooner."""
    train = neuro_agent.ActorCritic.train

    def cut(most):
        monkeypatch.setattr(
            neuro_agent.ActorCritic, "train", lambda self, env, steps: train(self, env, steps=min(steps, most))
        )

    return cut


def test_the_script_runs_and_the_page_is_written(folder, cut):
    cut(500)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path("train.py", run_name="__main__")
    assert re.fullmatch(r"untrained: \d+ of 100 steps .*\ntrained: \d+ of 100 steps .*\n", printed.getvalue())
    told = folder("agent", "watch", "agent.h5", "world:Room", "--out", "episode.html")
    assert told.err == ""
    assert re.fullmatch(r"episode\.html: 100 steps, return \d+, cut off by the environment; 101 frames\n", told.out)


def test_its_tests_pass_as_written(folder, cut):
    cut(2500)
    tests = {name: f for name, f in runpy.run_path("test_world.py").items() if name.startswith("test_")}
    assert len(tests) == 2
    for test in tests.values():
        test()
