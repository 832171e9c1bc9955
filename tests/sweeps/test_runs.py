"""Functions over spaces: what is kept, what goes on, what fails, and who may work in one folder."""

import json
import os
import resource
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

import neuro
from neuro_sweeps.definition import Limits
from neuro_sweeps.folder import Claims, Folder, began
from neuro_sweeps.page import _metric
from neuro_sweeps.pictures import pictures, plot_data
from neuro_sweeps.space import RunItem
from neuro_sweeps.table import table_of
from neuro_sweeps.worker import LOST, Worker

FOLDER = Path(__file__).parent


def sweep(function, space, out, **words):
    return neuro.sweep(function, space, out=out, **{"progress": False, "on": "here", **words})


def test_a_table_has_a_row_for_each_run(runs, tmp_path):
    table = sweep(runs.add, {"a": [1, 2], "b": [0, 10]}, tmp_path / "out", seeds=2)
    rows = table.rows()
    assert [(row["a"], row["b"], row["seed"], row["sum"], row["product"]) for row in rows] == [
        (a, b, seed, a + b + seed, a * b) for a in (1, 2) for b in (0, 10) for seed in (0, 1)
    ]
    assert {row["outcome"] for row in rows} == {"done"}
    assert table.column("sum") == [row["sum"] for row in rows]
    assert repr(table) == "SweepTable('add', 8 runs: 8 done, 0 failed, 0 left)"
    assert [*rows[0]] == ["run", "outcome", "a", "b", "seed", "sum", "product", "error"]
    head, first, *_ = table.csv().splitlines()
    assert head == "run,outcome,a,b,seed,sum,product,error"
    assert first == f"{table.keys[0]},done,1,0,0,1,0,"
    assert sorted(os.listdir(tmp_path / "out" / "runs")) == sorted(table.keys)
    assert os.listdir(tmp_path / "out" / "claims") == []


def test_processes_do_the_same(runs, tmp_path):
    here = sweep(runs.add, {"a": [1, 2]}, tmp_path / "here")
    cores = sweep(runs.add, {"a": [1, 2]}, tmp_path / "cores", on="cores", workers=2)
    assert here.csv() == cores.csv()
    local = sweep(lambda a: a + 1, {"a": [1]}, tmp_path / "local")
    assert local.column("value") == [2]


def test_what_is_done_is_not_done_again(runs, tmp_path, notes):
    for _ in range(2):
        sweep(runs.noting, {"a": [1, 2, 3]}, tmp_path / "out", set={"notes": notes.path})
    assert notes() == {"1-0": 1, "2-0": 1, "3-0": 1}


def test_names_of_runs_follow_from_their_inputs(runs, tmp_path):
    tables = [sweep(runs.add, {"a": [1, 2]}, tmp_path / name) for name in "ab"]
    assert tables[0].keys == tables[1].keys
    other = sweep(runs.add, {"a": [1, 2]}, tmp_path / "c", set={"b": 1})
    assert not set(other.keys) & set(tables[0].keys)
    wider = sweep(runs.add, {"a": [1, 2, 3]}, tmp_path / "d")
    assert wider.keys[:2] == tables[0].keys


def test_what_fails_is_kept_and_the_rest_goes_on(runs, tmp_path):
    words = {"on": "cores", "workers": 2, "time_limit": "2 s", "memory_limit": "500 MB"}
    table = sweep(runs.uneven, {"a": list(range(10))}, tmp_path / "out", **words)
    errors = {row["a"]: row["error"] for row in table if row["outcome"] == "failed"}
    assert errors == {
        1: "time: takes longer than the limit of 2 s",
        2: "memory: needs more than the limit of 500 MB",
        3: "its process was ended by SIGABRT, 2 times",
        4: "ZeroDivisionError: a = 4",
        6: "KeyboardInterrupt",
        7: "BaseException: enough",
        9: "ZeroDivisionError: a = 9",
    }
    assert [row["value"] for row in table if row["outcome"] == "done"] == [0, 5, 8]
    assert table.counts() == {"done": 3, "failed": 7, "under way": 0, "left": 0}
    trace = Folder(tmp_path / "out").outcome(table.keys[4]).trace
    assert 'raise ZeroDivisionError(f"a = {a}")' in trace
    assert (tmp_path / "out" / "runs" / table.keys[5] / "output.txt").read_text() == "of five\n"
    assert sweep(runs.uneven, {"a": list(range(10))}, tmp_path / "out", **words).csv() == table.csv()


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


def test_a_run_that_prints_much_needs_no_memory_for_it(runs, tmp_path):
    table = sweep(runs.printing, {"a": [1]}, tmp_path / "out", memory_limit="100 MB")
    assert table.column("error") == [""]
    printed = tmp_path / "out" / "runs" / table.keys[0] / "output.txt"
    assert printed.stat().st_size < 1_100_000
    assert printed.read_text().endswith("\nand more, which is not kept\n")


def test_failures_are_done_again_where_that_is_asked_for(runs, tmp_path):
    notes = tmp_path / "notes"
    space, words = {"a": [1, 2]}, {"set": {"notes": str(notes)}}
    failed = sweep(runs.noting, space, tmp_path / "out", **words)
    assert [row["outcome"] for row in failed] == ["failed", "failed"]
    notes.mkdir()
    assert sweep(runs.noting, space, tmp_path / "out", **words).counts()["failed"] == 2
    assert sweep(runs.noting, space, tmp_path / "out", **words, retry_failed=True).column("value") == [2, 4]


def test_what_is_no_number_is_told(tmp_path):
    assert sweep(lambda a: [a], {"a": [1]}, tmp_path / "out").column("error") == [
        "metric 'value' = [1]: expected a number or a text"
    ]


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


def test_a_folder_that_others_have_just_begun_is_gone_on_with(runs, tmp_path):
    out = tmp_path / "out"
    (out / "runs").mkdir(parents=True)
    (out / "claims").mkdir()
    (out / ".sweep.json.host.1.0.part").touch()
    assert sweep(runs.add, {"a": [1]}, out).column("sum") == [1]
    (tmp_path / "other" / "runs" / "mine").mkdir(parents=True)
    with pytest.raises(neuro.ModelError, match="other: is there and is no sweep: expected a new name"):
        sweep(runs.add, {"a": [1]}, tmp_path / "other")


def test_a_claim_is_of_one_and_of_nobody_when_its_process_has_ended(tmp_path):
    mine, other = Claims(tmp_path), Claims(tmp_path)
    assert mine.take("a")
    assert not other.take("a")
    mine.give_up("a")
    assert other.take("a")
    dead = json.loads((tmp_path / "a").read_text()) | {"process": 99_999_999}
    (tmp_path / "a").write_text(json.dumps(dead))
    assert mine.free("a")
    assert mine.take("a")


def test_a_claim_of_another_machine_holds_while_it_is_touched(tmp_path):
    (tmp_path / "a").write_text(json.dumps({"machine": "another", "process": 1, "began": "1"}))
    claims = Claims(tmp_path)
    assert not claims.take("a")
    os.utime(tmp_path / "a", (1e9, 1e9))
    assert claims.take("a")


def test_of_those_who_take_over_a_claim_one_gets_it(tmp_path):
    for k in range(20):
        (tmp_path / f"k{k}").write_text("{}")
        os.utime(tmp_path / f"k{k}", (1e9, 1e9))
        got = []
        racing = [
            threading.Thread(target=lambda k=k, got=got: got.append(Claims(tmp_path).take(f"k{k}"))) for _ in "12"
        ]
        for thread in racing:
            thread.start()
        for thread in racing:
            thread.join()
        assert sum(got) == 1


def test_a_flipped_bit_of_a_run_is_no_other_number(runs, tmp_path):
    """Whichever bit: the run counts as not there, and is done again; so it does where a loss of power cut its file."""
    table = sweep(runs.add, {"a": [1, 2]}, tmp_path / "out")
    before, file = table.csv(), tmp_path / "out" / "runs" / table.keys[0] / "run.json"
    whole = file.read_bytes()
    for place in range(0, len(whole), 7):
        file.write_bytes(flipped(whole, place))
        assert table.csv() == before or table.counts()["left"] == 1
    for damaged in (flipped(whole, whole.index(b'"sum": 1') + 7), whole[:50]):
        file.write_bytes(damaged)
        assert table.counts()["left"] == 1
        assert sweep(runs.add, {"a": [1, 2]}, tmp_path / "out").csv() == before


def test_a_flipped_bit_of_what_a_sweep_is_is_told(runs, tmp_path):
    out = tmp_path / "out"
    before = sweep(runs.add, {"a": [1, 2]}, out).csv()
    whole = (out / "sweep.json").read_bytes()
    for place in range(0, len(whole), 7):
        (out / "sweep.json").write_bytes(flipped(whole, place))
        with pytest.raises(neuro.ModelError) as told:
            raise neuro.ModelError("the same") if table_of(out).csv() == before else AssertionError
        assert str(told.value).startswith(("the same", f"{out}/sweep.json: "))


def flipped(content, place):
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def test_the_folder_of_another_sweep_stays(runs, tmp_path):
    out = tmp_path / "out"
    sweep(runs.add, {"a": [1, 2]}, out)
    hint = "\n  hint: expected the same sweep, or the name of a new folder"
    with pytest.raises(neuro.ModelError) as told:
        sweep(runs.add, {"a": [1, 2]}, out, set={"b": 3})
    assert str(told.value) == f'{out}: the folder of another sweep: set is {{}} there, {{"b": 3}} now{hint}'
    with pytest.raises(neuro.ModelError) as told:
        sweep(runs.add, {"a": [1, 2, 3]}, out)
    assert (
        str(told.value) == f"{out}: the folder of another sweep: its space is not the same, 2 runs there, 3 now{hint}"
    )


def test_a_folder_with_something_else_stays(runs, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(neuro.ModelError) as told:
        sweep(runs.add, {"a": [1]}, tmp_path)
    assert str(told.value) == f"{tmp_path}: is there and is no sweep: expected a new name, or an empty folder"
    assert os.listdir(tmp_path) == ["thesis.txt"]


MISTAKES = [
    ({"c": [1]}, {}, "unknown parameter of add 'c'\n  hint: known: a, b, seed"),
    ({"b": [1]}, {}, "add needs 'a', which the space does not have"),
    ({"a": [1]}, {"share": "5/4"}, "share = '5/4': expected I/N, with I from 0 to N, such as 3/100"),
    ({"a": [1]}, {"share": "x"}, "share = 'x': expected I/N, with I from 0 to N, such as 3/100"),
    ({"a": [1]}, {"memory_limit": "3"}, "memory_limit = '3': expected a size, such as 500 MB or 2 GB"),
    ({"a": [1]}, {"time_limit": "0 s"}, "time_limit = '0 s': expected a time > 0, such as 60 s"),
    ({"a": [1]}, {"workers": 0}, "workers = 0: expected a whole number >= 1"),
    ({"a": [1]}, {"set": 3}, "set = 3: expected values by name"),
    (
        {"a": [1]},
        {"on": "somewhere"},
        "on = 'somewhere': there is no such file: expected cores, here, tcp://HOST:PORT, or the file of a scheduler",
    ),
]


@pytest.mark.parametrize(("space", "words", "told"), MISTAKES, ids=[told[:30] for _, _, told in MISTAKES])
def test_a_mistake_is_told_before_anything_runs(runs, space, words, told, tmp_path):
    if "on" in words:
        pytest.importorskip("distributed", reason="the extra dask is not installed")
    with pytest.raises(neuro.ModelError) as error:
        sweep(runs.add, space, tmp_path / "out", **words)
    assert str(error.value) == told


def test_a_function_that_other_processes_cannot_find(tmp_path):
    def inner(a):
        return a

    with pytest.raises(neuro.ModelError) as told:
        sweep(inner, {"a": [1]}, tmp_path / "out", on="cores")
    assert str(told.value).startswith(f"{inner.__qualname__}: is defined inside another function, so other processes")
    with pytest.raises(neuro.ModelError, match="function = 3: expected a function"):
        sweep(3, {"a": [1]}, tmp_path / "out")
    with pytest.raises(neuro.ModelError, match="unknown study 'nothing'"):
        sweep("nothing", {"a": [1]}, tmp_path / "out")


def test_dask_that_is_not_installed_is_told(runs, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(neuro.ModelError, match=r"on = 'tcp://h:1': the package distributed is not installed\n  hint: "):
        sweep(runs.add, {"a": [1]}, tmp_path / "out", on="tcp://h:1")


def test_parquet_has_the_rows_of_the_table(runs, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra parquet is not installed")
    table = sweep(runs.uneven, {"a": [0, 4, 5]}, tmp_path / "out")
    for _ in range(2):
        table.save(tmp_path / "table.parquet")
    found = parquet.read_table(tmp_path / "table.parquet")
    assert found.to_pylist() == table.rows()
    assert found.schema.metadata[b"neuro sweep"] == table.name.encode()
    (tmp_path / "mine.parquet").write_bytes(b"PAR1 of somebody else PAR1")
    with pytest.raises(neuro.ModelError, match="exists and is not a table of a sweep"):
        table.save(tmp_path / "mine.parquet")


@pytest.mark.parametrize(
    ("function", "values", "lack"),
    [
        (lambda a: {"found": "none" if a else 1.5}, [0, 1], r"several kinds: (?s:.)*a CSV file takes them"),
        (lambda a: 10**a, [1, 400], "whole numbers of more than 64 bits: "),
    ],
)
def test_columns_that_parquet_does_not_take(tmp_path, function, values, lack):
    pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    table = sweep(function, {"a": values}, tmp_path / "out")
    with pytest.raises(neuro.ModelError, match=f"a column has values of {lack}"):
        table.save(tmp_path / "table.parquet")
    table.save(tmp_path / "table.csv")


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


def test_parquet_without_its_package_is_told(runs, tmp_path, monkeypatch):
    table = sweep(runs.add, {"a": [1]}, tmp_path / "out")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(neuro.ModelError, match="the package pyarrow is not installed\n  hint: "):
        table.save(tmp_path / "table.parquet")
    with pytest.raises(neuro.ModelError, match=r"table.txt: expected a name that ends in .csv or .parquet"):
        table.save(tmp_path / "table.txt")


def test_a_saved_table_is_replaced_and_what_is_not_ours_stays(runs, tmp_path):
    table = sweep(runs.add, {"a": [1]}, tmp_path / "out")
    for _ in range(2):
        table.save(tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text() == table.csv()
    (tmp_path / "mine.csv").write_text("a,b\n")
    with pytest.raises(neuro.ModelError, match="exists and is not a table of a sweep"):
        table.save(tmp_path / "mine.csv")


@pytest.mark.parametrize("on", ["here", "cores"])
def test_a_full_disk(runs, mounted, on):
    """It ends with one error, what is kept is whole, and once there is room the same call goes on."""
    space, out = {"a": list(range(100))}, mounted("size=200k") / "out"
    with pytest.raises(neuro.ModelError) as told:
        sweep(runs.add, space, out, on=on)
    assert "cannot be written: No space left on device" in str(told.value)
    assert "what was done is kept: the same command goes on" in str(told.value)
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
    ended = worker.do(RunItem("other", {"a": 2}, None))
    assert ended["is"] == LOST
    assert "No space left on device" in ended["error"]
    assert list(folder.claims.glob("other")) == []


def test_a_read_only_folder(runs, mounted):
    out = mounted("ro") / "out"
    with pytest.raises(neuro.ModelError) as told:
        sweep(runs.add, {"a": [1]}, out)
    assert str(told.value) == f"{out}: cannot be made: Read-only file system"


def test_limits_of_this_process_stay(runs, tmp_path):
    before = resource.getrlimit(resource.RLIMIT_DATA)
    table = sweep(runs.uneven, {"a": [2]}, tmp_path / "out", memory_limit="300 MB")
    assert table.column("error") == ["memory: needs more than the limit of 300 MB"]
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
