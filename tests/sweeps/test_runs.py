"""Functions over spaces: what is kept, what goes on, what fails, and who may work in one folder."""

import json
import os
import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
import yaml

import neuro
from neuro_sweeps.definition import Limits
from neuro_sweeps.folder import Claims, Folder, _tag, alive, began, holder_of
from neuro_sweeps.page import _metric
from neuro_sweeps.pictures import pictures, plot_data
from neuro_sweeps.space import RunItem
from neuro_sweeps.table import table_of
from neuro_sweeps.worker import Worker
from refused import error_of, refused

FOLDER = Path(__file__).parent


def sweep(function, space, out, **words):
    return neuro.sweep(function, space, out=out, **{"progress": False, "on": "here", **words})


def test_a_table_has_a_row_for_each_run(runs, tmp_path, notes):
    table = sweep(runs.add, {"a": [1, 2], "b": [0, 10]}, tmp_path / "out", seeds=2)
    rows = table.rows()
    points = [(a, b, seed) for a in (1, 2) for b in (0, 10) for seed in (0, 1)]
    assert [(row["a"], row["b"], row["seed"]) for row in rows] == points
    assert [(row["sum"], row["product"]) for row in rows] == [(a + b + seed, a * b) for a, b, seed in points]
    assert {row["outcome"] for row in rows} == {"done"}
    assert table.column("sum") == [row["sum"] for row in rows]
    assert repr(table) == "SweepTable('add', 8 runs: 8 done, 0 failed, 0 left)"
    names = "run,outcome,a,b,seed,sum,product,error"
    assert ",".join(rows[0]) == names
    assert table.csv().splitlines()[:2] == [names, f"{table.keys[0]},done,1,0,0,1,0,"]
    assert sorted(os.listdir(tmp_path / "out" / "runs")) == sorted(table.keys)
    assert os.listdir(tmp_path / "out" / "claims") == []
    for _ in range(2):
        sweep(runs.noting, {"a": [1, 2, 3]}, tmp_path / "noting", set={"notes": notes.path})
    assert notes() == {"1-0": 1, "2-0": 1, "3-0": 1}


def test_claims(tmp_path):
    """One has it, nobody when its process has ended; that of another machine holds while it is touched."""
    mine, other = Claims(tmp_path), Claims(tmp_path)
    assert mine.take("a")
    assert not other.take("a")
    mine.give_up("a")
    assert other.take("a")
    dead = json.loads((tmp_path / "a").read_text()) | {"process": 99_999_999}
    (tmp_path / "a").write_text(json.dumps(dead))
    assert not alive(tmp_path / "a")
    assert mine.take("a")
    (tmp_path / "a").write_text(json.dumps({"machine": "another", "process": 1, "began": "1"}))
    assert not mine.take("a")
    os.utime(tmp_path / "a", (1e9, 1e9))
    assert mine.take("a")


def test_processes_do_the_same(runs, tmp_path):
    here = sweep(runs.add, {"a": [1, 2]}, tmp_path / "here")
    cores = sweep(runs.add, {"a": [1, 2]}, tmp_path / "cores", on="cores", workers=2)
    assert here.csv() == cores.csv()
    local = sweep(lambda a: a + 1, {"a": [1]}, tmp_path / "local")
    assert local.column("value") == [2]


def test_names_of_runs_follow_from_their_inputs(runs, tmp_path):
    tables = [sweep(runs.add, {"a": [1, 2]}, tmp_path / name) for name in "ab"]
    assert tables[0].keys == tables[1].keys
    other = sweep(runs.add, {"a": [1, 2]}, tmp_path / "c", set={"b": 1})
    assert not set(other.keys) & set(tables[0].keys)
    wider = sweep(runs.add, {"a": [1, 2, 3]}, tmp_path / "d")
    assert wider.keys[:2] == tables[0].keys


def test_what_fails_is_kept_and_the_rest_goes_on(runs, tmp_path, messages):
    words = {"on": "cores", "workers": 2, "time_limit": "2 s", "memory_limit": "500 MB"}
    table = sweep(runs.uneven, {"a": list(range(10))}, tmp_path / "out", **words)
    messages({str(row["a"]): row["error"] for row in table if row["outcome"] == "failed"})
    assert [row["value"] for row in table if row["outcome"] == "done"] == [0, 5, 8]
    assert table.counts() == {"done": 3, "failed": 7, "under way": 0, "left": 0}
    trace = Folder(tmp_path / "out").outcome(table.keys[4]).trace
    assert 'raise ZeroDivisionError(f"a = {a}")' in trace
    assert (tmp_path / "out" / "runs" / table.keys[5] / "output.txt").read_text() == "of five\n"
    assert sweep(runs.uneven, {"a": list(range(10))}, tmp_path / "out", **words).csv() == table.csv()
    assert sweep(lambda a: [a], {"a": [1]}, tmp_path / "list").column("error") == [
        "metric 'value' = [1]: expected a number or a text"
    ]


def test_limits_hold_in_this_process_and_leave_it(runs, tmp_path):
    """A run that prints much needs no memory for it."""
    before = resource.getrlimit(resource.RLIMIT_DATA)
    printing = sweep(runs.printing, {"a": [1]}, tmp_path / "printing", memory_limit="100 MB")
    assert printing.column("error") == [""]
    printed = tmp_path / "printing" / "runs" / printing.keys[0] / "output.txt"
    assert printed.stat().st_size < 1_100_000
    assert printed.read_text().endswith("\n(the rest is not kept)\n")
    table = sweep(runs.uneven, {"a": [2]}, tmp_path / "out", memory_limit="300 MB")
    assert table.column("error") == ["memory: exceeds the limit of 300 MB"]
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


def test_ctrl_c_in_this_process_is_no_failure_of_a_run(runs, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        sweep(runs.uneven, {"a": [5, 6]}, tmp_path / "out")
    assert table_of(tmp_path / "out").counts() == {"done": 1, "failed": 0, "under way": 0, "left": 1}


def test_what_a_run_forks_ends_with_its_process_and_is_not_waited_for(runs, tmp_path):
    table = sweep(
        runs.forking, {"a": [1, 2, 3, 4]}, tmp_path / "out", set={"notes": str(tmp_path)}, on="cores", workers=1
    )
    assert table.column("error") == ["", "", "its process was ended by SIGABRT, 2 times", ""]
    for a in (1, 3):
        child = (tmp_path / f"child-{a}").read_text()  # empty where it was ended before it had written
        assert child == "" or began(int(child)) == ""


def test_a_run_whose_process_dies_is_tried_once_more(runs, tmp_path, notes):
    words = {"set": {"notes": notes.path}, "on": "cores", "workers": 1}
    table = sweep(runs.dying, {"a": [1, 2]}, tmp_path / "out", **words)
    assert [(row["value"], row["attempts"]) for row in table.rows(times=True)] == [(1, 2), (2, 2)]
    assert notes() == {"1-0": 2, "2-0": 2}


def test_failures_are_done_again_where_that_is_asked_for(runs, tmp_path):
    notes = tmp_path / "notes"
    space, words = {"a": [1, 2]}, {"set": {"notes": str(notes)}}
    failed = sweep(runs.noting, space, tmp_path / "out", **words)
    assert [row["outcome"] for row in failed] == ["failed", "failed"]
    notes.mkdir()
    assert sweep(runs.noting, space, tmp_path / "out", **words).counts()["failed"] == 2
    assert sweep(runs.noting, space, tmp_path / "out", **words, retry_failed=True).column("value") == [2, 4]


def test_parts_make_the_whole(runs, tmp_path):
    whole = sweep(runs.add, {"a": list(range(10))}, tmp_path / "whole")
    parts = [sweep(runs.add, {"a": list(range(10))}, tmp_path / "parts", share=f"{k}/4").counts() for k in range(1, 5)]
    assert [counts["done"] for counts in parts] == [3, 6, 8, 10]
    assert table_of(tmp_path / "parts").csv() == whole.csv()


def test_a_table_fills(runs, tmp_path):
    seen = []
    sweep(runs.add, {"a": [1, 2, 3]}, tmp_path / "out", each=lambda table: seen.append(table.counts()["done"]))
    assert len(seen) == 3
    assert seen[-1] == 3


SEVERAL = """
import os, sys, time
sys.path.insert(0, {folder!r})
import my_runs, neuro
if __name__ == "__main__":
    os.mkdir({ready!r} + str(os.getpid()))
    while len(os.listdir(os.path.dirname({ready!r}))) < 3:
        time.sleep(0.01)
    neuro.sweep(my_runs.noting, {{"a": list(range(40))}}, out={out!r}, set={{"notes": {notes!r}, "pause": 0.01}},
                progress=False, **{words!r})
"""


def test_several_work_in_one_folder_and_nothing_is_done_twice(runs, tmp_path, notes):
    places = {"folder": str(FOLDER), "out": str(tmp_path / "out"), "notes": notes.path, "ready": f"{tmp_path}/ready/"}
    (tmp_path / "ready").mkdir()
    words = [{"on": "here", "share": "1/2"}, {"on": "here"}, {"workers": 1}]
    scripts = [SEVERAL.format(words=each, **places) for each in words]
    running = [subprocess.Popen([sys.executable, "-c", text]) for text in scripts]
    assert [process.wait(120) for process in running] == [0] * 3
    assert sorted(notes().values()) == [1] * 40
    assert table_of(tmp_path / "out").column("value") == [2 * a for a in range(40)]


def test_when_a_sweep_is_killed_its_runs_and_what_they_forked_end(runs, tmp_path):
    text = (
        f"import sys; sys.path.insert(0, {str(FOLDER)!r}); import my_runs, neuro\n"
        f"neuro.sweep(my_runs.forking, {{'a': [5]}}, out={str(tmp_path / 'out')!r}, set={{'notes': {str(tmp_path)!r}}})"
    )
    child = tmp_path / "child-5"
    with subprocess.Popen([sys.executable, "-c", text], stderr=subprocess.DEVNULL) as parent:
        while not (child.exists() and child.read_text()):
            assert parent.poll() is None
            time.sleep(0.02)
        (claim,) = (tmp_path / "out" / "claims").iterdir()
        holder = holder_of(claim)
        parent.kill()
    until = time.monotonic() + 10
    while (began(holder.process) or began(int(child.read_text()))) and time.monotonic() < until:
        time.sleep(0.02)
    assert (began(holder.process), began(int(child.read_text()))) == ("", "")


def test_what_a_killed_process_leaves_late_is_removed_at_the_end(runs, tmp_path):
    """Its parent is killed first, so it may begin a folder when the next sweep has looked for such folders."""
    late = tmp_path / "out" / "runs" / f".a.{_tag()}.99999999-1.0"
    table = sweep(runs.add, {"a": [1, 2]}, tmp_path / "out", each=lambda table: late.mkdir(exist_ok=True))
    assert sorted(os.listdir(late.parent)) == sorted(table.keys)


UNLOCKED = """
import fcntl
from neuro_sweeps import folder
fcntl.flock, folder.machine = (lambda *words: None), (lambda: {name!r})
"""


def test_two_machines_share_a_folder_whose_locks_do_not_work(runs, tmp_path, notes):
    """Both take over what a third machine has left; a run that both do is kept once."""
    out, space, words = tmp_path / "out", {"a": list(range(40))}, {"set": {"notes": notes.path, "pause": 0.01}}
    keys = sweep(runs.noting, space, out, share="1/40", **words).keys
    for key in keys[1::2]:
        (out / "claims" / key).write_text(json.dumps({"machine": "third", "process": 1, "began": "1"}))
        os.utime(out / "claims" / key, (1e9, 1e9))
    places = {"folder": str(FOLDER), "out": str(out), "notes": notes.path, "ready": f"{tmp_path}/ready/"}
    (tmp_path / "ready" / "third").mkdir(parents=True)
    scripts = [UNLOCKED.format(name=name) + SEVERAL.format(words={"on": "here"}, **places) for name in ("one", "two")]
    running = [subprocess.Popen([sys.executable, "-c", text]) for text in scripts]
    assert [process.wait(120) for process in running] == [0] * 2
    assert set(notes()) == {f"{a}-0" for a in range(40)}
    assert max(notes().values()) <= 2
    assert sweep(runs.noting, space, out, **words).column("value") == [2 * a for a in range(40)]
    assert (sorted(os.listdir(out / "runs")), os.listdir(out / "claims")) == (sorted(keys), [".lock"])


def test_a_folder_that_others_have_just_begun_is_gone_on_with(runs, tmp_path):
    out = tmp_path / "out"
    (out / "runs").mkdir(parents=True)
    (out / "claims").mkdir()
    (out / ".sweep.json.host.1.0.part").touch()
    assert sweep(runs.add, {"a": [1]}, out).column("sum") == [1]
    (tmp_path / "other" / "runs" / "mine").mkdir(parents=True)
    with pytest.raises(neuro.ModelError, match="other: is not the folder of a sweep: expected a new or empty"):
        sweep(runs.add, {"a": [1]}, tmp_path / "other")


def test_of_those_who_take_over_a_claim_one_gets_it(tmp_path):
    for k in range(20):
        (tmp_path / f"k{k}").write_text("{}")
        os.utime(tmp_path / f"k{k}", (1e9, 1e9))
        with ThreadPoolExecutor(2) as pool:
            assert (
                sum(pool.map(lambda claims, name=f"k{k}": claims.take(name), (Claims(tmp_path), Claims(tmp_path)))) == 1
            )


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["run"]


def test_mistakes_are_told_before_anything_runs(runs, tmp_path, monkeypatch, messages):
    pytest.importorskip("distributed", reason="the extra dask is not installed")

    def inner(a):
        return a

    monkeypatch.chdir(tmp_path)
    out, space = "out", {"a": [1]}
    messages({f"{row} {words}": refused(sweep, runs.add, row, out, **words) for row, words in MISTAKES})
    messages({repr(function): refused(sweep, function, space, out) for function in (3, "nothing")})
    messages({"inner": refused(sweep, inner, space, out, on="cores")})
    monkeypatch.setitem(sys.modules, "distributed", None)
    messages({"no dask": refused(sweep, runs.add, space, out, on="tcp://h:1").partition("pip install")[0]})


def test_the_folder_of_something_else_stays(runs, tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    sweep(runs.add, {"a": [1, 2]}, "out")
    os.makedirs("others")
    Path("others", "thesis.txt").write_text("mine")
    messages(
        {"other words": refused(sweep, runs.add, {"a": [1, 2]}, "out", set={"b": 3})}
        | {"other space": refused(sweep, runs.add, {"a": [1, 2, 3]}, "out")}
        | {"no sweep": refused(sweep, runs.add, {"a": [1]}, "others")}
    )
    assert os.listdir("others") == ["thesis.txt"]


def test_tables_are_saved(runs, tmp_path, monkeypatch, messages):
    """They replace tables of sweeps only."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra parquet is not installed")
    monkeypatch.chdir(tmp_path)
    table = sweep(runs.uneven, {"a": [0, 4, 5]}, "out")
    for name in ("table.parquet", "table.csv") * 2:
        table.save(name)
    assert Path("table.csv").read_text() == table.csv()
    kept = parquet.read_table("table.parquet")
    assert kept.to_pylist() == table.rows()
    assert kept.schema.metadata[b"neuro sweep"] == table.name.encode()
    Path("mine.parquet").write_bytes(b"PAR1 of somebody else PAR1")
    Path("mine.csv").write_text("a,b\n")
    said = {name: refused(table.save, name) for name in ("mine.parquet", "mine.csv", "table.txt")}
    mixed = sweep(lambda a: {"found": "none" if a else 1.5}, {"a": [0, 1]}, "mixed")
    large = sweep(lambda a: 10**a, {"a": [1, 400]}, "large")
    for name, each in (("mixed", mixed), ("large", large)):
        error = error_of(each.save, "table.parquet")
        said[name] = error.message.rpartition(": ")[0]  # the rest is pyarrow's
        assert "CSV" in error.hint
        each.save(f"{name}.csv")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    messages(said | {"no pyarrow": refused(table.save, "table.parquet").partition("pip install")[0]})


def test_pictures_of_metrics_named_like_paths_have_names_of_one_folder(tmp_path):
    table = sweep(lambda a: {"val/loss": a, "../up": -a}, {"a": [1, 2]}, tmp_path / "out")
    assert list(pictures(table)) == ["val-loss-lines", "-up-lines"]


def test_pictures_hide_no_parameter(tmp_path):
    """A third parameter has lines of its own, and a mean is never over values without saying so."""
    space = {"rate": [1, 2, 3], "w": [10, 20], "tau_m": [5, 100]}
    table = sweep(lambda rate, w, tau_m, seed: rate + w + tau_m + seed, space, tmp_path / "out", seeds=[0, 2])
    (lines,) = pictures(table, kind="lines").values()
    (axis,) = lines.axes
    names = [text.get_text() for text in axis.get_legend().get_texts()]
    assert names == ["w = 10, tau_m = 5", "w = 10, tau_m = 100", "w = 20, tau_m = 5", "w = 20, tau_m = 100"]
    assert [line.get_ydata().tolist() for line in axis.lines][1] == [112, 113, 114]
    assert axis.get_title() == "mean over seeds; band: lowest to highest run"
    band = axis.collections[1].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == (111, 115)
    (map_of_two,) = pictures(table, kind="map").values()
    assert map_of_two.axes[0].get_title() == "mean over tau_m and seeds"
    (some,) = pictures(table, of=["rate", "w"], kind="lines").values()
    assert some.axes[0].get_title() == "mean over tau_m and seeds; band: lowest to highest run"
    (data,) = plot_data(table, (), ("rate", "tau_m"), "lines")
    assert "over rate: mean over w and seeds; band: lowest to highest run" in str(_metric(data))


@pytest.mark.parametrize("on", ["here", "cores"])
def test_a_full_disk(runs, mounted, on):
    """It ends with one error, what is kept is whole, and once there is room the same call goes on."""
    space, out = {"a": list(range(100))}, mounted("size=200k") / "out"
    told = refused(sweep, runs.add, space, out, on=on)
    assert "cannot be written: No space left on device" in told
    assert "finished runs are kept: run the same command again to continue" in told
    there = [path for path in (out / "runs").iterdir() if not path.name.startswith(".")]
    assert there
    assert all(json.loads((path / "run.json").read_text())["outcome"] == "done" for path in there)
    mounted("remount,size=20m")
    assert sweep(runs.add, space, out, on=on).counts()["done"] == 100


def test_a_claim_for_which_there_is_no_room_is_not_left(runs, mounted):
    out = mounted("size=200k") / "out"
    sweep(runs.add, {"a": [1]}, out)
    folder = Folder(out)
    with suppress(OSError), open(out / "full", "wb", buffering=0) as file:
        while file.write(b"0" * 4096):
            pass
    worker = Worker(folder, lambda point, seed: ({}, None, {}), Limits(), ())
    assert "No space left on device" in refused(worker.do, RunItem("other", {"a": 2}, None))
    assert list(folder.claims.glob("other")) == []


def test_a_read_only_folder(runs, mounted):
    out = mounted("ro") / "out"
    assert refused(sweep, runs.add, {"a": [1]}, out) == f"{out}: cannot be made: Read-only file system"
