"""Searches by several processes at once, of which one is killed: no trial is lost or doubled."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import neuro

pytest.importorskip("optuna", reason="the extra tune is not installed")
FOLDER = Path(__file__).parent
SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
import my_searches, neuro
if __name__ == "__main__":
    neuro.tune(my_searches.noting, {{"x": {{"from": 0.0, "to": 1.0}}}}, objectives={{"value": "minimise"}},
               trials={trials}, out={out!r}, set={{"notes": {notes!r}, "pause": {pause}}}, progress=False, **{words!r})
"""


@pytest.fixture
def start(tmp_path):
    """What begins a process that searches; all are ended afterwards."""
    (tmp_path / "notes").mkdir()
    begun = []

    def begin(trials, pause=0.02, **words):
        places = {"folder": str(FOLDER), "out": str(tmp_path / "out"), "notes": str(tmp_path / "notes")}
        text = SCRIPT.format(trials=trials, pause=pause, words=words, **places)
        begun.append(subprocess.Popen([sys.executable, "-c", text], start_new_session=True))
        return begun[-1]

    yield begin
    for process in begun:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def times_begun(tmp_path):
    return [len(path.read_text().split()) for path in (tmp_path / "notes").iterdir()]


def check_whole(tmp_path, trials):
    table = neuro.tuned(tmp_path / "out")
    assert table.counts() == {"done": trials, "failed": 0, "pruned": 0, "left": 0}
    assert table.column("trial") == list(range(trials))
    assert table.column("value") == [x * x for x in table.column("x")]
    assert len(set(table.column("x"))) == trials, "asked for twice"
    assert sorted(os.listdir(tmp_path / "out" / "runs")) == sorted(table.runs().keys)
    assert table.strays() == 0


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(({}, {}), id="free"),
        pytest.param(({"share": "1/2"}, {"share": "2/2"}), id="parts", marks=pytest.mark.slow),
    ],
)
def test_two_processes_ask_one_journal(start, tmp_path, words):
    running = [start(30, on="here", **each) for each in words]
    assert [process.wait(120) for process in running] == [0, 0]
    check_whole(tmp_path, 30)
    assert times_begun(tmp_path) == [1] * 30


def test_a_trial_of_a_process_that_died_is_taken_over_at_once(start, tmp_path):
    """By one that is at work: what the dead one had begun is not lost."""
    first = start(20, pause=0.1, workers=1)
    while not times_begun(tmp_path):
        assert first.poll() is None
        time.sleep(0.02)
    second = start(20, pause=0.1, workers=1)
    os.killpg(first.pid, signal.SIGKILL)
    assert second.wait(120) == 0
    check_whole(tmp_path, 20)
    assert sum(times_begun(tmp_path)) <= 21
