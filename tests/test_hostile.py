"""No file of a stranger runs code, writes outside of the folder, or opens a connection, whatever command reads it."""

import hashlib
import os
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import hostile

pytest.importorskip("optuna", reason="the extra tune is not installed")
pytest.importorskip("gymnasium", reason="the extra agent is not installed")


QUICK = (
    "page_with_1",
    "page_run_script",
    "page_out_replaces",
    "results_stream",
    "state_command",
    "agent_environment_0",
    "sweep_function_0",
    "tuning_function_0",
    "journal_distribution",
    "yaml_tag",
    "events_pickle",
)
"""Folders of cases whose first command is run in every test."""


@pytest.fixture(scope="module")
def written(tmp_path_factory, status_of):
    """All cases, the folder that none may change, and a folder for the watch."""
    top = tmp_path_factory.mktemp("hostile")
    base, place, outside = (top / name for name in ("base", "cases", "outside"))
    for folder in (base, place, outside):
        folder.mkdir()
    before = os.getcwd()
    os.chdir(base)
    try:
        hostile.make_base(base, lambda *words: status_of(*words) in (0, 1) or pytest.fail(str(words)))
    finally:
        os.chdir(before)
    (outside / "victim.html").write_bytes((base / "a.html").read_bytes())
    (outside / "victim.txt").write_text("mine")
    (outside / "empty.txt").touch()
    return hostile.attacks(hostile.Writer(base, place, outside)), top, outside


def contents(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def judge(cases, top, outside, name):
    """What went wrong, a line for each."""
    before, wrong = contents(outside), []
    for ran in hostile.run(cases, top / name, [top / "cases"], 3000.0):
        if ran.did:
            wrong.append(f"{ran.case.name}: {ran.did}")
        if ran.status not in (0, 1, 2) or "Traceback" in ran.printed:
            wrong.append(f"{ran.case.name}: status {ran.status}: {ran.printed[-1500:]}")
        if "\x1b" in ran.printed:
            wrong.append(f"{ran.case.name}: steers the terminal")
    if contents(outside) != before:
        wrong.append(f"outside was changed: {sorted(contents(outside).items() ^ before.items())}")
    return wrong


def of_kind(written, *kinds):
    return [case for case in written[0] if case.kind in kinds]


def test_the_watch_sees_code_files_and_connections(written):
    """Commands that do so, because their user asks for it."""
    cases, top, outside = written
    case = next(case for case in cases if case.kind == "page")
    asked = [
        hostile.Case("code", "", case.folder, ("check", "net.yaml", "--with", "evil.py")),
        hostile.Case("file", "", case.folder, ("report", "a.h5", "--out", str(outside / "asked.html"))),
        hostile.Case("connection", "", case.folder, ("run", "streamed.yaml", "--for", "1", "--backend", "reference")),
    ]
    code, file, connection = hostile.run(asked, top / "seen", [top / "cases"], 300.0)
    (outside / "CODE_RAN").unlink()
    (outside / "asked.html").unlink()
    assert "runs " in code.did
    assert "CODE_RAN" in code.did
    assert "asked.html" in file.did
    assert "socket." in connection.did


def test_a_few_of_each_kind(written):
    first = {}
    for case in written[0]:
        first.setdefault(case.folder.name, case)
    cases = [first[name] for name in QUICK]
    assert judge(cases, *written[1:], "few") == []


def test_a_world_imports_nothing_and_has_one_error(written):
    cases = [case for case in written[0] if case.name.startswith("world ")]
    assert len(cases) == len(hostile.WORLDS)
    for ran in hostile.run(cases, written[1] / "worlds", [written[1] / "cases"], 3000.0):
        assert (ran.did, ran.status, ran.printed.count("error:")) == ("", 2, 1), (ran.case.name, ran.printed)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kinds",
    [("page",), ("results", "state"), ("model",), ("sweep", "journal"), ("description", "recording", "exchange")],
    ids=" and ".join,
)
def test_all_of_each_kind(written, kinds):
    assert judge(of_kind(written, *kinds), *written[1:], kinds[0]) == []


def test_optimisers_hold_no_code(torch, tmp_path):
    """Of a checkpoint of `dqn`."""
    from neuro_drone.controllers import make
    from neuro_drone.scenario import load

    class Runs:
        def __reduce__(self):
            return exec, (f"open({str(tmp_path / 'CODE_RAN')!r}, 'w')",)

    controller = make("dqn", load("B60"), 0, {})
    state = controller.state()
    state["optimizers"] = np.frombuffer(pickle.dumps([Runs()], protocol=2), np.uint8)
    with pytest.raises(pickle.UnpicklingError):
        controller.restore(state)
    assert not (tmp_path / "CODE_RAN").exists()


def test_every_promise_of_the_page_is_held_by_a_test_that_is_there():
    root = Path(__file__).parents[1]
    rows = [line for line in (root / "SECURITY.md").read_text().splitlines() if line.startswith("| ")]
    promises = [row for row in rows if not row.startswith(("| from somebody", "| ---"))]
    assert len(promises) >= 17
    for row in promises:
        named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", row)
        assert named, row
        for file, test in named:
            assert f"\ndef {test}(" in (root / file).read_text(), f"{file}::{test}"


def test_there_are_many(written):
    """At least sixty hostile files, of every kind; `pytest -s` shows how many commands read them."""
    cases = written[0]
    for kind in dict.fromkeys(case.kind for case in cases):
        files, commands = {case.folder for case in cases if case.kind == kind}, len(of_kind(written, kind))
        print(f"{kind}: {len(files)} hostile files, {commands} commands")
    assert len({case.folder for case in cases}) >= 60
    assert {case.kind for case in cases} >= {"page", "results", "state", "model", "sweep", "journal"}
