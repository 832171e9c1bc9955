"""Files of a sweep's folder that are damaged, copied, or of another time: messages, no traceback, no hang."""

import json
import os
import shutil
import time
from pathlib import Path

import pytest

import neuro
from neuro_sweeps.folder import LEASE_S, Claims, Folder, alive, machine
from neuro_sweeps.pictures import pictures, search_pictures
from neuro_sweeps.table import table_of
from refused import refused

SWEEP = "study: twice\nparameters: {x: [1, 2, 3]}\nseeds: 1\n"
TUNE = "study: twice\nparameters: {x: {from: 0, to: 4}}\nobjectives: {value: max}\ntrials: 4\n"
STUDY = """\
import neuro


@neuro.register(kind="study")
def twice(x, seed=0):
    return {"value": 2 * x + seed, "other": 1.0}
"""
DEEP = "[" * 100_000
WRONG = (None, True, 3, -1, 1e300, 10**400, "x", "", [], [1], {}, {"a": 1})
"""What may stand in the place of any value."""


@pytest.fixture
def made(tmp_path, monkeypatch, registries, run):
    """A folder with a sweep that is done, and a search."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    (tmp_path / "tune.yaml").write_text(TUNE)
    (tmp_path / "my_study.py").write_text(STUDY)
    run("sweep", "run", "sweep.yaml", "--on", "here", "--with", "my_study.py")
    return tmp_path


@pytest.fixture
def searched(made, run):
    pytest.importorskip("optuna", reason="the extra tune is not installed")
    run("tune", "run", "tune.yaml", "--on", "here", "--with", "my_study.py")
    return Path("tuned")


@pytest.fixture
def told(answer):
    """What a command says; its exit status is 0, or 2 with a message."""

    def tell(*words, status=(0, 2)):
        said = answer(*words)
        assert said.status in status
        assert (said.status == 2) == said.err.startswith("error: ")
        return said.out + said.err

    return tell


RUN = ("sweep", "run", "sweep.yaml", "--on", "here", "--with", "my_study.py")


def claim(path, content, touched=0.0):
    """A claim that was touched so many seconds from now."""
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    os.utime(path, (time.time() + touched,) * 2)


HERE = {"machine": machine(), "process": 4_000_000, "began": "1"}
ELSEWHERE = {"machine": "another 1 2", "process": 1, "began": "1"}
OF_MACHINES = (("machine", "x"), ("machine", ""))
NOBODYS = {
    "of a process that is dead": (HERE, 10.0),
    "of a number that another process has now": ({**HERE, "process": os.getpid()}, 0.0),
    "of a machine that is switched off": (ELSEWHERE, -3600.0),
    "of the future": (ELSEWHERE, 3600.0),
    "of the far future": (ELSEWHERE, 1e9),
    "a list": ([1], -2.0),
    "a list of the future": ([1], 3600.0),
    "a number of the near future": (3, 30.0),
    "empty, of the future": (b"", 3600.0),
    "binary": (b"\xff\0\1", -2.0),
    "too deep": (DEEP.encode(), -2.0),
    "with more": ({**HERE, "more": 1}, -2.0),
}


def test_a_claim_of_nobody_is_taken_over(made, told):
    key = table_of("runs").keys[1]
    for name, (content, touched) in NOBODYS.items():
        shutil.rmtree(made / "runs" / "runs" / key)
        claim(made / "runs" / "claims" / key, content, touched)
        assert "2 done, 0 failed, 0 under way, 1 left" in told("sweep", "status", "runs"), name
        assert "3 done, 0 failed, 0 left" in told(*RUN), name
        assert not (made / "runs" / "claims" / key).exists(), name


def test_a_claim_with_another_value_in_any_place_is_nobodys(tmp_path):
    changed = [{**HERE, word: value} for word in HERE for value in WRONG if (word, value) not in OF_MACHINES]
    for content in (*changed, *({w: v for w, v in HERE.items() if w != word} for word in HERE)):
        claim(tmp_path / "claim", content, -2.0)
        assert not alive(tmp_path / "claim")
        assert Claims(tmp_path).take("claim")
    claim(tmp_path / "claim", {"machine": machine(), "process": os.getpid(), "began": "0"})
    assert not alive(tmp_path / "claim")


def test_who_waits_says_for_whom(made, told, monkeypatch):
    """A claim of another machine that was touched near to now is somebody's; it is given up while one waits."""
    key, said = table_of("runs").keys[1], []
    shutil.rmtree(made / "runs" / "runs" / key)
    for touched in (-LEASE_S / 2, LEASE_S / 2):
        claim(made / "runs" / "claims" / key, ELSEWHERE, touched)
        assert alive(made / "runs" / "claims" / key)

    def say(bar, text):
        said.append(text)
        if text.startswith("waiting"):
            (made / "runs" / "claims" / key).unlink(missing_ok=True)

    monkeypatch.setattr("neuro.core.progress.Bar.say", say)
    assert "3 done, 0 failed, 0 left" in told("sweep", "run", "sweep.yaml", "--workers", 1, "--with", "my_study.py")
    assert f"waiting for 1 run of other processes, first process 1 on another (runs/claims/{key})" in said


def test_a_claim_that_cannot_be_written_is_told(made, told):
    key = table_of("runs").keys[1]
    shutil.rmtree(made / "runs" / "runs" / key)
    (made / "runs" / "claims" / key / "full").mkdir(parents=True)
    os.utime(made / "runs" / "claims" / key, (1, 1))
    assert f"runs/claims/{key}: cannot be written: Is a directory" in told(*RUN, status=(2,))
    with pytest.raises(neuro.ModelError):
        Claims(made / "runs" / "claims").take(key)


def test_a_run_that_was_copied_from_another_is_not_there(made, told):
    before = table_of("runs").csv()
    first, second, third = (made / "runs" / "runs" / key for key in table_of("runs").keys)
    shutil.copy(first / "run.json", second)
    shutil.rmtree(third)
    shutil.copytree(first, third)
    assert "1 done, 0 failed, 0 under way, 2 left" in told("sweep", "status", "runs")
    told("rerun", second, status=(2,))
    assert "3 done, 0 failed, 0 left" in told(*RUN)
    assert table_of("runs").csv() == before


def damages(content):
    """A file with another value in each place of its JSON in turn, and what is no JSON."""
    told = json.loads(content)
    for k, word in enumerate(told):
        for value in (WRONG[k % len(WRONG)], WRONG[(k + 5) % len(WRONG)]):
            if value != told[word]:
                yield json.dumps({**told, word: value}).encode()
        yield json.dumps({name: one for name, one in told.items() if name != word}).encode()
    yield from (b"", b"[1]", b"3", b"null", b"\xff\xfe\0", DEEP.encode(), content[: len(content) // 2], content * 2)


def test_a_damaged_run_is_not_there(made):
    before = table_of("runs").csv()
    key = table_of("runs").keys[1]
    path = made / "runs" / "runs" / key / "run.json"
    for content in damages(path.read_bytes()):
        path.write_bytes(content)
        assert Folder(made / "runs").outcome(key) is None
    path.unlink()
    path.mkdir()
    assert table_of("runs").counts()["left"] == 1
    neuro.sweep("twice", {"x": [1, 2, 3]}, seeds=1, out="runs", on="here", progress=False)
    assert table_of("runs").csv() == before


def test_a_damaged_file_of_a_folder_is_told(searched, told):
    for command, out, read in (("sweep", "runs", table_of), ("tune", "tuned", neuro.tuned)):
        path = searched.parent / out / f"{command}.json"
        for content in damages(path.read_bytes()):
            path.write_bytes(content)
            assert refused(read, out).startswith(f"{out}/{command}.json: ")
        reads = [(word, out) for word in ("status", "table", "page", "plot")]
        for words in (*reads, ("run", f"{command}.yaml", "--out", out)):
            assert told(command, *words, status=(2,)).startswith(f"error: {out}/{command}.json: ")


def test_a_line_of_a_journal_that_is_damaged_is_told(searched, told):
    """Missing, doubled, or behind the one that followed it: the first line that does not follow is named."""
    path = searched / "journal.log"
    lines = path.read_bytes().splitlines(keepends=True)

    def damaged(changed):
        path.write_bytes(b"".join(changed))
        error = refused(neuro.tuned(searched).rows)
        assert "damaged: expected the line that 'neuro tune" in error
        return int(error.removeprefix("tuned/journal.log: line ").partition(":")[0])

    for k, line in enumerate(lines[:-1]):
        assert damaged(lines[:k] + lines[k + 1 :]) == k + 1
        assert damaged(lines[: k + 1] + lines[k:]) == k + 2
        assert damaged([*lines[:k], lines[k + 1], line, *lines[k + 2 :]]) == k + 1
    for content in damages(lines[2]):
        assert damaged([*lines[:2], content + b"\n", *lines[3:]]) in (3, 4)
    path.write_bytes(b"".join(lines[:2] + lines[3:]))
    for words in (*((word, "tuned") for word in ("status", "table", "page", "plot")), ("run", "tune.yaml")):
        assert told("tune", *words, status=(2,)).startswith("error: tuned/journal.log: line 3: damaged: ")


@pytest.mark.parametrize("name", ["journal.log", "claims/.ask", "claims/.journal"])
def test_a_folder_in_the_place_of_a_file_is_told(searched, told, name):
    (searched / name).unlink()
    (searched / name).mkdir()
    (searched.parent / "tune.yaml").write_text(TUNE.replace("trials: 4", "trials: 5"))
    assert told("tune", "run", "tune.yaml", status=(2,)).startswith(f"error: tuned/{name}: cannot be ")


FORMULA = "$\\x_{^%$"
"""A name that matplotlib cannot read as the formula that it looks like."""


def test_names_are_no_formulas(tmp_path):
    """Of metrics, parameters, values and of what is run: drawn letter by letter."""
    pytest.importorskip("optuna", reason="the extra tune is not installed")

    def formula(seed=0, **point):
        return {FORMULA: point["a"] + seed, "$${": 1.0}

    formula.__qualname__ = FORMULA
    words = {"on": "here", "progress": False}
    space = {FORMULA: [f"{FORMULA}1", f"{FORMULA}2"], "a": [1, 2, 3], "$b_{$": {"from": 0.0, "to": 1.0, "number": 2}}
    drawn = {}
    for names, kind in ((["a", FORMULA], "map"), ([FORMULA, "a"], "lines"), ([*space], "parallel")):
        points = {"a": [1], **{name: space[name] for name in names}}
        table = neuro.sweep(formula, points, seeds=2, out=tmp_path / kind, **words)
        drawn |= {f"{kind} {name}": figure for name, figure in pictures(table, [FORMULA], (), kind).items()}
    objectives = {FORMULA: "max", "$${": "min"}
    table = neuro.tune(formula, space, objectives=objectives, trials=9, sampler="grid", out=tmp_path / "tuned", **words)
    drawn |= search_pictures(table)
    assert "importance" in drawn
    for figure in drawn.values():
        figure.savefig(tmp_path / "a.png", dpi=20)
