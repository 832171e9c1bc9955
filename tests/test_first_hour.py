"""The first hour of who comes from NEST: our script does what the one for NEST does, and is no longer."""

import contextlib
import io
import runpy
from pathlib import Path

import pytest

from beside import beside
from neuro import results

EXAMPLE = Path(__file__).parents[1] / "examples" / "first_hour.py"
(NEST,) = beside(__file__, "NEST")


def ours():
    """The lines that do what those of NEST do."""
    lines = EXAMPLE.read_text("utf-8").splitlines()
    return lines[lines.index('net = neuro.Network("first-hour", resolution=0.1)') : lines.index("print(net)") - 1]


def test_no_line_is_longer_than_those_of_nest():
    theirs = NEST.splitlines()
    assert len(ours()) <= len(theirs)
    assert max(map(len, ours())) <= max(map(len, theirs))
    assert sum(map(len, ours())) <= sum(map(len, theirs))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What is defined when the script has run, in a folder of its own."""
    printed = io.StringIO()
    folder = tmp_path_factory.mktemp("first-hour")
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        found = runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert "noise_generator" in printed.getvalue()
    return found | {"folder": folder}


def test_all_is_there_at_its_end(run):
    left = results.read(run["folder"] / "run.h5")
    assert left.spikes("exc", since=100.0)[0].tolist() == run["times"].tolist()
    assert left.trace("cells")[1]["V_m"].shape == (500, 10)
    assert left.trace("w")[1]["weight"].tolist() == run["sent"]["weight"].tolist()
    page = (run["folder"] / "run.html").read_text("utf-8")
    assert "first-hour" in page
    assert all((run["folder"] / name).read_bytes().startswith(b"\x89PNG") for name in ("glance.png", "weights.png"))


def test_the_network_does_what_that_of_nest_does(run, own_nest):
    there = {"nest": own_nest}
    exec(NEST, there)
    theirs = there["times"][there["times"] > 100.0].size
    assert run["times"].size == pytest.approx(theirs, rel=0.15)
    assert run["sent"]["weight"].mean() == pytest.approx(there["sent"]["weights"].mean(), rel=0.02)
