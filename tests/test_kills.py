"""What is killed again and again comes to the bits of what was never killed; see `helpers/kills.py`.

`NEURO_KILLS=20 python -m pytest tests/test_kills.py -s` kills each kind 20 times and prints the table; without it some
kinds are killed a few times.
"""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

KILLS = os.environ.get("NEURO_KILLS", "")
FEW = {"sweep": "4", "tuning": "4", "sweep-cores": "20", "tuning-nsga2": "20", "agent": "20", "sweep-world": "20"}
SCRIPT = Path(__file__).parent / "helpers" / "kills.py"
NEEDS = {"tuning": "optuna", "tuning-nsga2": "optuna", "training": "torch"}


@pytest.mark.parametrize("kind", ["sweep", "tuning", "training", "drone", "drone-search", "remus"])
def test_the_same_bits_after_kills(kind):
    if not KILLS and kind not in FEW:
        pytest.skip("NEURO_KILLS is not set")
    killed(kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sweep-cores", "tuning-nsga2", "agent", "sweep-world"])
def test_processes_that_are_killed_come_to_the_same_bits(kind):
    killed(kind)


def killed(kind):
    if (package := NEEDS.get(kind)) and find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    command = [sys.executable, SCRIPT, kind, KILLS or FEW[kind], "0"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    print(done.stdout, end="")


STOPPED = SCRIPT.with_name("stopped_writers.py")


FEW_WRITERS = ("run", "sonata", "save", "checkpoint", "listen dat", "listen npz", "convert .npz", "c")


@pytest.mark.parametrize(
    ("count", "writers"), [("16", FEW_WRITERS), pytest.param("1000", (), marks=pytest.mark.slow)], ids=["few", "all"]
)
def test_writers_that_are_stopped_keep_what_was_complete(count, writers):
    """`NEURO_STOPS` is how often; `helpers/stopped_writers.py` has the table of writers."""
    command = [sys.executable, STOPPED, os.environ.get("NEURO_STOPS", count), "0", *writers]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    print(done.stdout, end="")
