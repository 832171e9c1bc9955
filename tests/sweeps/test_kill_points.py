"""A search that is cut off at any line of its journal, or within one, goes on to the trials of a whole one."""

import json
import os
import shutil
from pathlib import Path

import pytest

import neuro

pytest.importorskip("optuna", reason="the extra tune is not installed")
FOLDER = Path(__file__).parent
EVERY = "NEURO_KILLS" in os.environ
"""Whether at every line, not only at some of the last trial."""

CREATED, ENDED = 4, 6
"""Operations of a journal, as of `optuna.storages.journal.JournalOperation`."""

LOSS, BOTH = {"loss": "minimise"}, {"loss": "minimise", "cost": "minimise"}
VALUE = {"value": "maximise"}
SPACE = {"x": {"from": 0.0, "to": 5.0}, "y": {"from": 0.1, "to": 9.0, "scale": "log"}, "z": [0.0, 1.0, 2.0]}
GRID = {name: {**axis, "number": 3} if isinstance(axis, dict) else axis for name, axis in SPACE.items()}
HYPERBAND = {"by": "hyperband", "factor": 2}
SEARCHES = {
    "tpe": ("shifted", SPACE, {"sampler": "tpe", "objectives": LOSS}),
    "tpe of two": ("shifted", SPACE, {"sampler": "tpe", "objectives": BOTH}),
    "nsga2": ("shifted", SPACE, {"sampler": "nsga2", "objectives": BOTH, "trials": 21}),
    "nsga2 of one": ("shifted", SPACE, {"sampler": "nsga2", "objectives": LOSS, "trials": 21}),
    "random": ("shifted", SPACE, {"sampler": "random", "objectives": LOSS}),
    "grid": ("shifted", GRID, {"sampler": "grid", "objectives": BOTH}),
    "median": ("climbing", SPACE, {"objectives": VALUE, "prune": {"by": "median", "startup_trials": 3}}),
    "hyperband": ("climbing", SPACE, {"objectives": VALUE, "prune": {**HYPERBAND, "max_steps": 6}}),
    "hyperband without a bound": ("climbing", SPACE, {"objectives": VALUE, "prune": HYPERBAND}),
    "hyperband of random": ("climbing", SPACE, {"sampler": "random", "objectives": VALUE, "prune": HYPERBAND}),
    "median of seeds": ("shifted", SPACE, {"objectives": LOSS, "prune": "median", "seeds": 3}),
    "hyperband of seeds": ("shifted", SPACE, {"objectives": LOSS, "prune": HYPERBAND, "seeds": 3}),
}


def found(table):
    """All that a search has found: of each trial its point, its outcome and what it is worth."""
    return [(each.number, each.outcome, each.point, each.values) for each in table.trials()]


def steps(table):
    """What each run has told on its way."""
    return {key: outcome.steps for key, outcome in table.runs().outcomes().items()}


def cut(whole, lines, rest, out, kept):
    """The folder as a kill would leave it: some lines of the journal, and the runs of the trials that have ended."""
    out.mkdir()
    shutil.copy(whole / "tune.json", out)
    (out / "journal.log").write_bytes(b"".join(lines) + rest)
    logs = [json.loads(line) for line in lines]
    ended = {log["trial_id"] for log in logs if log["op_code"] == ENDED}
    for trial in kept:
        for item in trial.items if trial.number in ended else ():
            if (whole / "runs" / item.key).exists():  # of a trial that was pruned some were never begun
                shutil.copytree(whole / "runs" / item.key, out / "runs" / item.key, dirs_exist_ok=True)


SLOW = ("tpe", "nsga2 of one", "random", "hyperband", "hyperband of random", "hyperband of seeds")


@pytest.mark.parametrize(
    "search", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in SEARCHES]
)
def test_a_search_goes_on_from_any_line(searches, tmp_path, search):
    name, space, words = SEARCHES[search]
    words = {"trials": 15, "on": "here", "progress": False, **words}
    whole = neuro.tune(getattr(searches, name), space, out=tmp_path / "whole", **words)
    lines = (tmp_path / "whole" / "journal.log").read_bytes().splitlines(keepends=True)
    begins = [k for k, line in enumerate(lines) if json.loads(line)["op_code"] == CREATED]
    if "prune" in words:
        assert {trial.outcome for trial in whole.trials()} == {"done", "pruned"}
    trials = whole.trials()
    last = range(begins[-1], len(lines))
    for k in range(len(lines)) if EVERY else sorted({0, last[0], last[len(last) // 2], last[-1]}):
        for rest in (b"", lines[k][: len(lines[k]) // 2])[0 if EVERY else k % 2 :]:
            out = tmp_path / f"{k}-{len(rest)}"
            cut(tmp_path / "whole", lines[:k], rest, out, trials)
            parts = neuro.tune(getattr(searches, name), space, out=out, **words)
            assert found(parts) == found(whole), f"cut off at line {k + 1}"
            assert steps(parts) == steps(whole), f"cut off at line {k + 1}"
        made = {path: path.stat().st_mtime_ns for path in out.glob("runs/*/run.json")}
        (out / "journal.log").write_bytes(b"".join(lines[:k]))
        assert k or neuro.tuned(out).strays() == len(made) > 0
        again = neuro.tune(getattr(searches, name), space, out=out, **words)
        assert {path: path.stat().st_mtime_ns for path in made} == made
        assert found(again) == found(whole), f"cut off at line {k + 1}, with all runs"
