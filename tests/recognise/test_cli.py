import json
import pickle
import re
from pathlib import Path

from matplotlib.image import imread

from neuro.events import load, save
from neuro_recognise.method import METHODS
from refused import mistakes_of


def test_list_names_all_methods_and_their_settings(neuro):
    code, out, _ = neuro("list")
    assert code == 0
    assert all(name in out for name in METHODS)
    code, out, _ = neuro("list", "tar_hats")
    assert code == 0
    assert all(word in out for word in ("cleaner.theta", "thesis figure 85"))
    assert "--preset poker: size=[35, 35], cell=12, tau=10.0" in out


def test_train_test_predict(neuro, folder, tmp_path):
    code, out, _ = neuro("train", "hats", "--data", folder, "--set", "cell=9", "--out", "m.h5")
    assert (code, out) == (0, "m.h5: hats for 3 classes, learnt from 24 recordings\n")
    code, out, _ = neuro("test", "m.h5", "--data", folder, "--json", "--out", "pictures")
    told = json.loads(out.partition("\n")[2])
    assert (code, told["method"], told["n"], told["silent"], told["accuracy"]) == (0, "hats", 9, 1, 8 / 9)
    assert imread(tmp_path / "pictures" / "confusion.png").ndim == 3
    code, out, _ = neuro("test", "m.h5", "--data", folder, "--part", "Train")
    assert (code, "100.0%" in out) == (0, True)
    files = sorted((folder / "Test").glob("*/*.bin"))
    code, out, _ = neuro("predict", "m.h5", *files, "--json")
    said = json.loads(out)
    assert code == 0
    assert [one["class"] for one in said] == [None if f.name == "32.bin" else f.parent.name for f in files]
    assert all(0 < one["decided_ms"] <= one["length_ms"] for one in said if one["class"])
    code, out, _ = neuro("predict", "m.h5", files[0])
    assert re.search(rf"{files[0].parent.name}\s+\d+ of \d+ ms", out.replace(str(files[0]), ""))


def test_silent_decisions_are_named_with_a_way_out(neuro, folder):
    assert neuro("train", "hfirst", "--data", folder, "--set", "s1_threshold=100000", "--out", "mute.h5")[0] == 0
    code, out, _ = neuro("test", "mute.h5", "--data", folder)
    assert code == 0
    way = "expected lower values than --set s1_threshold=100000, --set s2_threshold=150, or recordings with more events"
    assert f"recordings are silent, which counts as wrong: {way}" in out


def test_files_of_any_format_are_predicted(neuro, folder, model, tmp_path):
    events = load(next((folder / "Test" / "lying").glob("*.bin")))
    files = [f"one.{ending}" for ending in ("aedat", "npz", "csv", "dat", "raw")]
    for file in files:
        save(events, tmp_path / file)
    code, out, _ = neuro("predict", "m.h5", *files, "--json")
    assert (code, [one["class"] for one in json.loads(out)]) == (0, ["lying"] * 5)


def test_mistakes_are_one_message(neuro, folder, messages):
    Path("net.yaml").touch()
    messages(mistakes_of(neuro, messages.cases, folder=folder))


def test_compare_keeps_what_is_done(neuro, folder, tmp_path, monkeypatch):
    """Folds and what comes of them go to other processes and back."""

    def sent(run, jobs, processes, tell):
        assert processes == 2
        return [pickle.loads(pickle.dumps(run(pickle.loads(pickle.dumps(job)), tell))) for job in jobs]

    monkeypatch.setattr("neuro.core.grid.side_by_side", sent)
    words = f"compare --data {folder} --folds 2 --method hats --method boe:tar --out all --workers 2".split()
    code, out, _ = neuro(*words)
    assert (code, out.splitlines()[-2:]) == (0, ["all/table.md", "all/compare.html"])
    rows = (tmp_path / "all" / "table.md").read_text().splitlines()
    assert rows[2].startswith("| method | runs on | accuracy | 95 % interval |")
    assert [row.split(" | ")[0] for row in rows[4:]] == ["| hats", "| boe:tar"]
    page = (tmp_path / "all" / "compare.html").read_text()
    assert page.count("data:image/png;base64") == 3
    assert "24 recordings" in page
    files = sorted((tmp_path / "all").glob("*.json"))
    assert [file.name for file in files] == [f"{name}-0-{k}.json" for name in ("boe-tar", "hats") for k in (0, 1)]
    told = json.loads(files[2].read_text())
    assert (len(told["tested"]), len(told["decided"])) == (12, 12)
    before = {file: file.stat().st_mtime_ns for file in files}
    files[0].unlink()
    assert neuro(*words)[0] == 0
    again = {file: file.stat().st_mtime_ns for file in files}
    assert [again[file] == before[file] for file in files] == [False, True, True, True]
    files[1].write_text("{}")
    code, _, err = neuro(*words)
    assert (code, "boe-tar-0-1.json" in err) == (2, True)


def test_a_method_that_cannot_be_run_is_a_row_of_the_table(neuro, folder, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "sklearn", None)
    code, out, _ = neuro("compare", "--data", folder, "--folds", 2, "--method", "hats", "--out", "all", "--workers", 1)
    assert code == 0
    assert "not run" in out
    assert "- hats: this readout is trained by scikit-learn, which is not installed" in out
