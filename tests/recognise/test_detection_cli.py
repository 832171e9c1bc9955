"""The commands `scenes`, `crops` and `detect`: from recordings of one object to boxes in scenes of several."""

import json
import re
from functools import partial

import numpy as np
import pytest
from matplotlib.image import imread

from neuro.events import Events, save
from neuro_recognise.detection.boxes import read_boxes
from players import tracks_of
from refused import mistakes_of


@pytest.fixture(scope="module")
def made(shapes_folder, status_of, tmp_path_factory):
    """A folder with scenes and a recogniser that learnt from crops out of others."""
    path, halves = tmp_path_factory.mktemp("made"), f"--data {shapes_folder} --folds 2 --fold 0"
    for words in (
        f"scenes {halves} --out {path}/learn --count 6 --others", f"crops {path}/learn --out {path}/crops",
        f"train hats --data {path}/crops --out {path}/model.h5",
        f"scenes {halves} --out {path}/scenes --count 3 --noise 2 --set speed=5",
    ):  # fmt: skip
        assert status_of("recognise", *words.split()) == 0
    return path


@pytest.fixture
def neuro(answer, monkeypatch, made):
    """Run `neuro recognise ...` in that folder; return exit status, stdout and stderr."""
    monkeypatch.chdir(made)
    return partial(answer, "recognise")


def test_measured_on_scenes(neuro):
    code, out, _ = neuro("detect", "model.h5", "--data", "scenes", "--json")
    found = json.loads(out)
    assert (code, set(found["ap"])) == (0, {"cross", "ring"})
    expected = {"format": "neuro recognise detection 1", "method": "hats", "scenes": 3, "map": 1.0, "box_ap": 1.0}
    assert found == found | expected | {"missed": 0, "switches": 0}
    code, out, _ = neuro("detect", "model.h5", "--data", "scenes")
    assert code == 0
    assert all(word in out for word in ("mAP at IoU 0.5", "1.000"))


def test_boxes_of_a_recording_as_table_picture_and_page(neuro, made):
    code, out, _ = neuro("detect", "model.h5", "scenes/0000.npz", "--json", "--out", "boxes.csv")
    boxes = json.loads(out)["boxes"]
    assert code == 0
    rows = (made / "boxes.csv").read_text().splitlines()
    assert rows[0] == "start_us,stop_us,identity,class,score,left,top,right,bottom"
    assert len(rows) - 1 == len(boxes) >= 6
    assert {box["class"] for box in boxes} <= {"cross", "ring"}
    code, out, _ = neuro("detect", "model.h5", "scenes/0000.npz", "--out", "boxes.csv")  # a table is replaced
    assert code == 0
    assert "#0" in out
    assert neuro("detect", "model.h5", "scenes/0001.npz", "--out", "boxes.png")[0] == 0
    assert imread(made / "boxes.png").std() > 0.05
    assert neuro("detect", "model.h5", "scenes/0001.npz", "--out", "boxes.html")[0] == 0
    data, page = page_of(made / "boxes.html")
    assert (data["width"], data["height"]) == (100, 80)
    assert {round(box["start"], -1) for box in data["boxes"]} == {0.0, 100.0, 200.0}
    assert {box["kind"] for box in data["boxes"]} == {""}
    assert neuro("detect", "model.h5", "scenes/0001.npz", "--out", "boxes.html")[0] == 0
    (made / "boxes.html").write_text(page.replace("Play", "Go"))
    code, _, err = neuro("detect", "model.h5", "scenes/0001.npz", "--out", "boxes.html")
    assert code == 2
    assert "boxes.html: exists and is not a page of 'neuro recognise': expected a new name" in err
    save(Events(*np.zeros((4, 0), int), (100, 80)), made / "empty.npz")
    code, out, _ = neuro("detect", "model.h5", "empty.npz", "--out", "empty.html")
    assert (code, out) == (0, "no objects found\n")
    data, text = page_of(made / "empty.html")
    assert data["boxes"] == []
    assert "no objects found" in text


def page_of(path):
    text = path.read_text("utf-8")
    return tracks_of(text)["events"], text


def test_boxes_that_are_found_and_given_on_one_page(neuro, made):
    words = "watch", "model.h5", "scenes/0001.npz", "--boxes", "scenes/0001.csv", "--out", "both.html"
    code, out, _ = neuro(*words, "--several")
    assert code == 0
    assert re.fullmatch(r"both.html: [23] objects in \d boxes found, [23] objects in \d boxes given\n", out)
    data, _ = page_of(made / "both.html")
    found, given = ([box for box in data["boxes"] if box["kind"] == kind] for kind in ("", "given"))
    assert [box["box"] for box in given] == read_boxes(made / "scenes" / "0001.csv", ("cross", "ring")).box.tolist()
    assert sorted(box["name"] for box in found) == sorted(box["name"] for box in given)
    code, out, _ = neuro(*words)
    assert code == 0
    assert "found" not in out


def test_mistakes(neuro, messages):
    messages(mistakes_of(neuro, messages.cases))
