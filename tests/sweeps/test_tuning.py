"""Points looked for by Optuna: what is asked, kept, gone on with, pruned, refused."""

import json
import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings, strategies as st

import neuro
from neuro import ModelError
from neuro.core.extension import run_extensions
from neuro_sweeps.folder import Claims, Folder, claimed
from neuro_sweeps.plan import SearchPlan, front, plan_of
from neuro_sweeps.rerun import rerun
from neuro_sweeps.worker import Worker
from refused import refused

pytest.importorskip("optuna", reason="the extra tune is not installed")
FOLDER = Path(__file__).parent
RANGE = {"x": {"from": 0.0, "to": 5.0}}
LOSS = {"loss": "minimise"}
BOTH = {"loss": "minimise", "cost": "minimise"}


def tune(function, space, out, **words):
    return neuro.tune(function, space, out=out, **{"progress": False, "on": "here", "objectives": LOSS, **words})


def test_a_table_has_a_row_for_each_trial(searches, tmp_path):
    table = tune(searches.bowl, {**RANGE, "y": [0.0, 1.0]}, tmp_path / "out", trials=12)
    rows, losses = table.rows(), table.column("loss")
    names = "trial,outcome,x,y,loss,cost,best,error"
    assert ",".join(rows[0]) == table.csv().splitlines()[0] == names
    assert [row["trial"] for row in rows] == list(range(12))
    assert losses == [(row["x"] - 2.0) ** 2 + row["y"] ** 2 for row in rows]
    assert [row["best"] for row in rows] == [loss == min(losses) for loss in losses]
    assert repr(table) == "TuneTable('bowl', 12 trials: 12 done, 0 failed, 0 left)"
    (best,) = table.best()
    assert best.values == (min(losses),)
    assert best.point == {name: rows[best.number][name] for name in ("x", "y")}
    assert len(table.runs()) == 12
    assert sorted(os.listdir(tmp_path / "out" / "runs")) == sorted(table.runs().keys)
    assert neuro.tuned(tmp_path / "out").csv() == table.csv()


@pytest.mark.parametrize("sampler", ["tpe", "nsga2", "random", "grid"])
def test_one_worker_asks_for_the_same_trials_twice(searches, tmp_path, sampler):
    """Also where a search is interrupted again and again."""
    number = {"number": 6} if sampler == "grid" else {}
    space = {"x": {"from": 0.0, "to": 5.0, **number}, "y": [0.0, 1.0, 2.0]}
    words = {"sampler": sampler, "objectives": BOTH}
    whole = tune(searches.bowl, space, tmp_path / "whole", trials=18, **words)
    for trials in (1, 7, 8, 17, 18):
        parts = tune(searches.bowl, space, tmp_path / "parts", trials=trials, **words)
        assert len(parts) == trials
    assert parts.csv() == whole.csv()
    other = tune(searches.bowl, space, tmp_path / "other", trials=18, draw=1, **words)
    assert other.column("x") != whole.column("x")
    if sampler == "grid":
        assert sorted(zip(whole.column("x"), whole.column("y"), strict=True)) == [
            (x, y) for x in sorted(set(whole.column("x"))) for y in (0.0, 1.0, 2.0)
        ]


@pytest.mark.parametrize("stopped", [KeyboardInterrupt, ModelError], ids=["by a user", "by a full disk"])
def test_the_same_process_goes_on_after_an_interrupt(searches, tmp_path, monkeypatch, stopped):
    """Trials under way are nobody's then, so the second call does not wait for the first."""
    before, number = set(threading.enumerate()), {"asked": 0}

    def do(worker, item):
        number["asked"] += 1
        if number["asked"] == 3:
            raise stopped("now")
        return whole(worker, item)

    whole = Worker.do
    space, words = {"x": list(range(8))}, {"trials": 6, "sampler": "random"}
    monkeypatch.setattr(Worker, "do", do)
    with pytest.raises(stopped):
        tune(searches.bowl, space, tmp_path / "out", **words)
    assert claimed(tmp_path / "out" / "claims") == []
    table = tune(searches.bowl, space, tmp_path / "out", **words)
    assert table.counts() == {"done": 6, "failed": 0, "pruned": 0, "left": 0}
    assert table.csv() == tune(searches.bowl, space, tmp_path / "whole", **words).csv()
    for each in set(threading.enumerate()) - before:
        each.join(timeout=10.0)
        assert not each.is_alive(), "who asked has left a thread"


def test_processes_ask_for_what_this_one_does(searches, tmp_path):
    here = tune(searches.bowl, RANGE, tmp_path / "here", trials=12)
    cores = tune(searches.bowl, RANGE, tmp_path / "cores", trials=12, on="cores", workers=1)
    assert cores.csv() == here.csv()


def test_tpe_finds_what_it_looks_for(searches, tmp_path):
    tpe = tune(searches.bowl, RANGE, tmp_path / "tpe", trials=40)
    random = tune(searches.bowl, RANGE, tmp_path / "random", trials=40, sampler="random")
    late = [np.median(table.column("loss")[20:]) for table in (tpe, random)]
    assert late[0] < 0.3 * late[1]
    assert abs(tpe.best()[0].point["x"] - 2.0) < 0.1


def test_the_same_point_is_not_run_twice(searches, tmp_path, notes):
    words = {"set": {"notes": notes.path}, "objectives": {"value": "max"}, "sampler": "random"}
    space = {"x": {"from": 0, "to": 3, "whole": True}}
    table = tune(searches.noting, space, tmp_path / "out", trials=15, on="cores", workers=2, **words)
    assert table.counts() == {"done": 15, "failed": 0, "pruned": 0, "left": 0}
    assert notes() == {str(x): 1 for x in range(4)}
    assert table.column("value") == [x * x for x in table.column("x")]


def test_lists_and_scales(searches, tmp_path):
    table = tune(
        searches.listed, {"shape": [[2, 3], [4, 5]]}, tmp_path / "a", trials=6, objectives={"value": "maximize"}
    )
    assert {json.dumps(shape) for shape in table.column("shape")} == {"[2, 3]", "[4, 5]"}
    assert table.best()[0].point == {"shape": [4, 5]}
    space = {"x": {"from": 1e-6, "to": 1.0, "scale": "log"}}
    x = np.array(tune(searches.bowl, space, tmp_path / "b", trials=60, sampler="random").column("x"))
    assert 15 < np.count_nonzero(x < 1e-3) < 45


def test_means_over_seeds_and_folds(searches, tmp_path):
    words = {"objectives": {"right": "maximise"}, "folds": 4, "seeds": 2}
    table = tune(searches.folded, RANGE, tmp_path / "out", trials=3, **words)
    assert table.column("right") == pytest.approx([x * 2.5 / 4 + 0.5 for x in table.column("x")])
    assert len(table.runs()) == 3 * 4 * 2
    assert {row["fold"] for row in table.runs()} == {0, 1, 2, 3}
    assert max(table.column("right")) < 100, "the held-out part was seen"


def test_a_trial_of_which_a_run_fails_fails(searches, tmp_path, messages):
    space = {"x": list(range(6))}
    table = tune(searches.uneven, space, tmp_path / "out", trials=30, sampler="grid", on="cores", workers=1)
    messages({str(row["x"]): row["error"] for row in table})
    assert table.counts() == {"done": 2, "failed": 4, "pruned": 0, "left": 0}
    assert table.best()[0].point == {"x": 0}


def test_a_run_of_a_tuning_is_made_again(searches, tmp_path, monkeypatch, registries, messages):
    monkeypatch.chdir(tmp_path)
    run = Path("out", "runs", tune(searches.bowl, RANGE, "out", trials=2).runs().keys[1])
    said = {"without its file": refused(rerun, run)}
    run_extensions((str(FOLDER / "my_searches.py"),))
    assert rerun(run).same
    said["a backend"] = refused(rerun, run, backend="event")
    (run / "run.json").write_text("{")
    said["damaged"] = refused(rerun, run)
    messages({case: text.replace(str(FOLDER), "FOLDER").replace(run.name, "KEY") for case, text in said.items()})


def test_trials_of_which_a_run_failed_are_done_again_where_that_is_asked_for(searches, tmp_path):
    notes, space = tmp_path / "notes", {"x": [0, 1, 2, 3, 4]}
    words = {"trials": 6, "sampler": "grid", "objectives": {"value": "minimise"}, "set": {"notes": str(notes)}}
    before = tune(searches.noting, space, tmp_path / "out", **words)
    assert before.counts() == {"done": 0, "failed": 5, "pruned": 0, "left": 0}
    (notes / "3").mkdir(parents=True)  # this one fails again
    points = [trial.point for trial in before.trials()]
    for failed in (1, 0):
        after = tune(searches.noting, space, tmp_path / "out", retry_failed=True, **words)
        assert after.counts() == {"done": 5 - failed, "failed": failed, "pruned": 0, "left": 0}
        assert [trial.point for trial in after.trials()] == points
        if failed:
            (notes / "3").rmdir()
    assert after.best()[0].point == {"x": 0}
    assert [len((notes / str(x)).read_text().split()) for x in range(5)] == [1] * 5


def test_what_failed_is_not_done_again_while_others_work(searches, tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    words = {"trials": 1, "retry_failed": True}
    tune(searches.uneven, {"x": [1]}, "out", trials=1)
    claims = Claims(Path("out", "claims"))
    claims.take("trial-7")
    said = {"others": refused(tune, searches.uneven, {"x": [1]}, "out", **words)}
    claims.give_up("trial-7")
    messages(said | {"a share": refused(tune, searches.uneven, {"x": [1]}, "out", share="1/2", **words)})


points = st.lists(st.tuples(*[st.integers(0, 6)] * 3), min_size=0, max_size=15)
ways = st.tuples(*[st.sampled_from(["maximise", "minimise"])] * 3)


def beats(a, b, directions):
    """By the book: at least as good in all, better in one."""
    pairs = [(x, y) if way == "maximise" else (-x, -y) for x, y, way in zip(a, b, directions, strict=True)]
    return all(x >= y for x, y in pairs) and any(x > y for x, y in pairs)


@settings(max_examples=40)
@given(points, ways)
def test_the_front_is_what_nothing_beats(points, directions):
    kept = front(np.array(points, float).reshape(-1, 3), directions)
    assert kept.tolist() == [not any(beats(other, point, directions) for other in points) for point in points]


def test_a_front_in_a_table(searches, tmp_path):
    table = tune(searches.bowl, RANGE, tmp_path / "out", trials=30, objectives=BOTH)
    best = table.best()
    assert len(best) > 1
    losses, costs = (np.array([each.values[k] for each in best]) for k in (0, 1))
    assert (np.diff(losses) > 0).all()
    assert (np.diff(costs) < 0).all()
    assert {each.number for each in best} == {row["trial"] for row in table if row["best"]}


def test_trials_are_pruned_on_the_way(searches, tmp_path):
    notes = tmp_path / "notes"
    notes.mkdir()
    words = {"objectives": {"value": "maximise"}, "sampler": "random", "set": {"notes": str(notes)}}
    table = tune(
        searches.stepping, RANGE, tmp_path / "out", trials=20, prune={"by": "median", "startup_trials": 3}, **words
    )
    counts = table.counts()
    assert counts["pruned"] > 3
    assert counts["pruned"] + counts["done"] == 20
    steps = {
        row["x"]: int((notes / repr(row["x"])).read_text()) if (notes / repr(row["x"])).exists() else -1
        for row in table
    }
    for row in table:
        assert (steps[row["x"]] == 9) == (row["outcome"] == "done")
        assert (row["value"] is None) == (row["outcome"] == "pruned")
    assert table.best()[0].point["x"] == max(table.column("x")), "the best was pruned"
    full = tune(searches.stepping, RANGE, tmp_path / "full", trials=20, **words)
    assert full.column("x") == table.column("x")
    assert full.counts()["done"] == 20
    pruned = next(key for key, each in table.runs().outcomes().items() if each.outcome == "pruned")
    assert Folder(tmp_path / "out").outcome(pruned).steps
    with pytest.raises(neuro.ModelError, match="was pruned: expected a run that is done"):
        rerun(tmp_path / "out" / "runs" / pruned)


def test_hyperband_prunes_in_processes(searches, tmp_path):
    prune = {"by": "hyperband", "min_steps": 1, "max_steps": 10, "factor": 3}
    words = {"objectives": {"value": "maximise"}, "sampler": "random", "prune": prune, "on": "cores", "workers": 1}
    table = tune(searches.stepping, RANGE, tmp_path / "out", trials=20, **words)
    assert table.counts()["pruned"] > 3
    assert table.counts()["left"] == 0


def test_trials_are_pruned_after_a_fold(searches, tmp_path):
    words = {"objectives": {"right": "maximise"}, "folds": 3, "sampler": "random"}
    table = tune(searches.folded, RANGE, tmp_path / "out", trials=20, prune={"startup_trials": 4}, **words)
    pruned = [trial for trial in table.trials() if trial.outcome == "pruned"]
    assert pruned
    there = Folder(tmp_path / "out").outcomes(item.key for trial in pruned for item in trial.items)
    assert len(there) < 3 * len(pruned)


def test_steps_are_reported_where_nobody_prunes(searches, tmp_path, messages):
    assert searches.stepping(3.0) == 3.0
    table = neuro.sweep(searches.stepping, {"x": [1.0]}, out=tmp_path / "out", progress=False, on="here")
    assert next(iter(table.outcomes().values())).steps["9"] == 1.0
    messages({str(words): refused(neuro.report_step, *words) for words in ((float("nan"), 0), (1.0, -1))})


def test_a_folder_that_is_read_only(searches, mounted):
    """It can still be read."""
    out = mounted("rw") / "out"
    text = tune(searches.bowl, RANGE, out, trials=3).csv()
    mounted("remount,ro")
    assert neuro.tuned(out).csv() == text
    assert "cannot be written: Read-only file system" in refused(tune, searches.bowl, RANGE, out, trials=4)
    new = out.with_name("new")
    assert refused(tune, searches.bowl, RANGE, new, trials=1) == f"{new}: cannot be made: Read-only file system"


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["search"]


def test_mistakes(searches, tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    for k, (space, words) in enumerate(MISTAKES):
        messages({f"{space} {words}": refused(tune, searches.bowl, space, str(k), **{"trials": 3} | words)})
    tune(searches.bowl, RANGE, "out", trials=1)
    neuro.sweep(searches.bowl, {"x": [1]}, out="sweep", on="here", progress=False)
    messages(
        {"other draw": refused(tune, searches.bowl, RANGE, "out", trials=1, draw=3)}
        | {"other space": refused(tune, searches.bowl, {"x": [1, 2]}, "out", trials=1)}
        | {"in a sweep": refused(tune, searches.bowl, RANGE, "sweep", trials=1)}
        | {"of a sweep": refused(neuro.tuned, "sweep")}
    )
    monkeypatch.setitem(sys.modules, "optuna", None)
    messages({"no optuna": refused(tune, searches.bowl, RANGE, "new", trials=1).partition("pip install")[0]})
    assert not Path("new").exists()


def journal(out):
    return out / "journal.log"


def test_optuna_reads_the_journal(searches, tmp_path):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    table = tune(searches.bowl, RANGE, tmp_path / "out", trials=5)
    storage = JournalStorage(JournalFileBackend(str(journal(tmp_path / "out"))))
    study = optuna.load_study(study_name="search", storage=storage)
    assert [trial.value for trial in study.trials] == table.column("loss")


def test_plans_survive_being_written():
    plan = plan_of(
        {"x": {"from": 1, "to": 8, "scale": "log", "whole": True}, "y": ["a", None, 2.5]},
        {"a": "max"}, 7, seeds=[3, 5], folds=2, prune={"by": "hyperband", "factor": 4},
    )  # fmt: skip
    assert SearchPlan.from_dict(json.loads(json.dumps(plan.as_dict()))) == plan
