"""The page of a recording: what it holds, and what a browser makes of it."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.ndimage import gaussian_filter

from neuro.apps import Evaluation
from neuro.events import Events, recordings, save
from neuro_recognise.detection.boxes import Boxes
from neuro_recognise.detection.report import page as boxes_page
from neuro_recognise.early import learn_early
from neuro_recognise.method import Course, Pictures, TrialView
from neuro_recognise.methods.descriptor import Hats
from neuro_recognise.observations import observed
from neuro_recognise.parts.banks import gabor_bank
from neuro_recognise.parts.frames import Latency, LogLatency
from neuro_recognise.recogniser import fit, method_of
from neuro_recognise.telling.pictures import accuracies, boxes_on_frames, confusion, images, prototypes, reconstructed
from neuro_recognise.telling.report import predict_files
from neuro_recognise.telling.watch import decisions, page, watch
from players import tracks_of
from refused import refused


def bar(label, seed, n=400):
    rng = np.random.default_rng([seed, label])
    t, along, across = np.sort(rng.integers(1000, 41_000, n)), rng.integers(0, 34, n), 15 + rng.integers(0, 4, n)
    x, y = (across, along) if label else (along, across)
    return Events(t, x, y, t % 2, (34, 34))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recogniser that knows when it may stop."""
    folder = tmp_path_factory.mktemp("bars")
    for label, name in enumerate(("lying", "<standing>")):
        (folder / name).mkdir()
        for seed in range(6):
            save(bar(label, seed), folder / name / f"{seed}.bin")
    data, method = recordings(folder), method_of("hats", values={"readout": "ridge", "penalty": 10.0})
    return learn_early(fit(data, method, cache=tmp_path_factory.mktemp("cache")), data, every_ms=5.0, folds=2)


@pytest.fixture(scope="module")
def events():
    return bar(1, 50)


def trials():
    return TrialView("Its spikes", np.array([10.0, 30.0]), 64.0, 8, np.array([0, 3, 5]),
                  np.array([0.0, 10.0, 60.0, 5.0, 6.0]), np.array([0, 7, 3, 1, 2]), ("first", "second"))  # fmt: skip


@pytest.fixture(scope="module")
def text(made, events):
    views = [*made.method.views(events, made.learnt, made.classes), trials()]
    return page(made, "1.bin", events, decisions(made, events, 0.3, "event"), views, 0.3)


def test_the_page_holds_it(made, events, text):
    data = tracks_of(text)
    seen, bars, curve = data["events"], data["bars"], data["curve"]
    assert np.array_equal(seen["place"], 2 * (34 * events.y.astype(int) + events.x) + events.p)
    assert np.array_equal(seen["t"], events.t - events.t[0])
    at, length = curve["lanes"][0]["lines"][0]["x"], (events.t[-1] - events.t[0]) / 1000
    assert at == pytest.approx([5, 10, 15, 20, 25, 30, 35, length])
    expected = made.scores_at(events, at.astype(float))
    assert bars["values"].reshape(-1, 2) == pytest.approx(expected - expected.mean(axis=1, keepdims=True), rel=1e-5)
    assert bars["lit"].reshape(-1, 2).argmax(1).tolist() == expected.argmax(1).tolist()
    stop = next(one for one in decisions(made, events, 0.3, "event") if one.settled)
    assert (curve["stop"]["at"], bars["labels"]) == (stop.after_ms, list(made.classes))
    seen, spikes = data["view0"], data["view1"]
    assert seen["rows"] == seen["columns"] == 5 * 7
    assert seen["at"].tolist() == [10, 20, 30, 40]
    assert seen["values"].reshape(4, -1).max(axis=1)[-1] > 0
    assert spikes["ends"].tolist() == [0, 3, 5]
    assert spikes["notes"] == ["none yet", "1 of 2, from 10 ms · first", "2 of 2, from 30 ms · second"]
    assert f"&lt;standing&gt;, settled after {stop.after_ms:.0f} of {length:.0f} ms for an error of 30.0%" in text
    assert "http" not in text.replace("http-equiv", "")
    assert "<standing>" not in text


def test_a_page_without_a_rule_of_many_events_and_of_none(made, events, monkeypatch, tmp_path):
    plain = replace(made, early=None)
    said = decisions(plain, events, None, "event")
    assert len(said) in (60, 61)
    text = page(plain, "1.bin", events, said)
    assert "stop" not in tracks_of(text)["curve"]
    assert "&lt;standing&gt;, unchanged since" in text
    monkeypatch.setattr("neuro_recognise.telling.watch.MOST", 101)
    text = page(made, "1.bin", events, decisions(made, events, None, "event"))
    assert np.array_equal((tracks_of(text)["events"]["place"] >> 1) % 34, events.x[::4])
    assert "one of every 4 events is shown" in text
    empty = tmp_path / "none.bin"
    save(bar(0, 0)[:0], empty)
    for name, message in (
        ("page.txt", "what is watched is a page for a browser: expected a name that ends in .html"),
        ("page.html", "the recording has no events: nothing to watch"),
    ):
        assert message in refused(watch, made, empty, tmp_path / name)
    assert [one.name for one in tmp_path.iterdir()] == ["none.bin"]
    method = Hats(size=(34, 34), cell=17, radius=1)
    (seen,) = method.views(events, {}, made.classes)
    whole = method.describe(events).reshape(2, 2, 2, 3, 3).sum(axis=2)
    assert seen.images[-1][3:, :3] == pytest.approx(whole[1, 0], rel=1e-6)
    sizes, orientations = (3, 5), (0.0, 22.5)
    assert LogLatency().bands(sizes, orientations) == ("0°", "22.5°")
    assert Latency().bands(sizes, orientations) == ("3 px 0°", "3 px 22.5°", "5 px 0°", "5 px 22.5°")


@pytest.mark.parametrize(
    ("name", "values"), [("boe", {"threshold": 30.0}), ("remus", {"threshold": 40.0, "epochs": 1})]
)
def test_what_other_methods_see(name, values, events, made):
    method = method_of(name, values=values).fitting((34, 34))
    shown = observed(method, [bar(k % 2, k) for k in range(4)], ("lying", "<standing>"))
    learnt = method.fit(replace(shown, labels=np.arange(4) % 2), Course(0))
    views = method.views(events, learnt, made.classes)
    first = views[0]
    assert isinstance(first, Pictures)
    ends = (np.cumsum(first.images.sum(axis=(1, 2))) - 1).astype(int)
    assert first.at_ms == pytest.approx((events.t[ends] - events.t[0]) / 1000)
    if name == "remus":
        spikes = views[1]
        assert len(spikes.at_ms) == len(spikes.captions) == len(spikes.offsets) - 1
        assert spikes.ids.max() < spikes.size
        assert spikes.times.max() < spikes.length_ms


@pytest.fixture
def chromium(chromium):
    return partial(chromium, "--window-size=1280,1100", "--blink-settings=preferredColorScheme=1")


STEPS = Path(__file__).with_name("steps.html").read_text("utf-8")


def test_a_browser_draws_it_moves_in_time_and_plays(text, events, tmp_path, chromium):
    file = tmp_path / "page.html"
    file.write_text(text.replace("</body>", STEPS), "utf-8")
    told = re.search("<title>(.*?)</title>", chromium("--dump-dom", f"file://{file}"))[1].split("|")
    end = f"{(events.t[-1] - events.t[0]) / 1000:.1f}"
    assert told[:4] == [f"22.0 of {end} ms", f"25.0 of {end} ms", f"20.0 of {end} ms", "1 of 2, from 10 ms · first"]
    assert (told[4:6], told[6:8]) == ([f"{end} of {end} ms", "2 of 2, from 30 ms · second"], ["Pause", "Play"])
    assert told[8:13] == [f"{name} drawn" for name in ("events", "view0", "view1", "bars", "curve")]
    assert told[13:] == [f"0.0 of {end} ms", "nothing decided yet"]


SCENE = Path(__file__).with_name("scene.html").read_text("utf-8")


def test_a_browser_draws_boxes(events, tmp_path, chromium):
    file, first = tmp_path / "page.html", int(events.t[0])
    found = [(first, first + 10_000, 0, 1, 0.5, (1, 2, 3, 4)), (first + 10_500, first + 20_000, 1, -1, 0, (5, 6, 7, 8))]
    given = [(first, first + 60_000, 2, 0, 1.0, (9, 9, 12, 12))]
    text = boxes_page(events, Boxes.of(found), ("lying", "<standing>"), "1.bin", Boxes.of(given))
    file.write_text(text.replace("</body>", SCENE), "utf-8")
    told = re.search("<title>(.*?)</title>", chromium("--dump-dom", f"file://{file}"))[1].split("|")
    always = "given #2 lying  9.0, 9.0, 12.0, 12.0"
    assert told == [
        f" #0 &lt;standing&gt; 0.5 1.0, 2.0, 3.0, 4.0 &amp; {always}",
        f" #1 ? 0 5.0, 6.0, 7.0, 8.0 &amp; {always}",
        always,
        always,
        "0 0",
    ]


def test_a_command_writes_it(made, events, tmp_path, chromium):
    save(events, tmp_path / "1.bin")
    told = watch(made, tmp_path / "1.bin", tmp_path / "page.html", 0.3)
    assert re.fullmatch(r"<standing>, settled after \d+ of 4\d ms for an error of 30.0%", told)
    for learnt in (made, replace(made, early=None)):
        (predicted,), _ = predict_files(learnt, [tmp_path / "1.bin"])
        told = watch(learnt, tmp_path / "1.bin", tmp_path / "page.html")
        assert told == f"<standing>, unchanged since {predicted.decided_ms:.0f} of {predicted.length_ms:.0f} ms"
    chromium(f"--screenshot={tmp_path / 'page.png'}", f"file://{tmp_path / 'page.html'}")
    pixels = imread(tmp_path / "page.png")[..., :3]
    teal = (pixels[..., 1] > pixels[..., 0] + 0.2) & (pixels[..., 2] > pixels[..., 0] + 0.2)
    assert 500 < teal.sum() < 200_000


def test_pictures_of_templates_and_weights():
    """In the middle of its cell, as strong as it is, and nothing of a negative weight."""
    filters, kernels = gabor_bank((5,), (2.0,), (2.5,), 0.3, (0.0, 45.0))[0], np.zeros((2, 2, 6, 7))
    kernels[0, 1, 2, 3], kernels[1, 0, 4, 4] = 0.5, -1.0
    found = reconstructed(kernels, filters, 2)
    assert found.shape == (2, 12, 14)
    alone = np.zeros((12, 14))
    alone[5 - 2 : 5 + 3, 7 - 2 : 7 + 3] = 0.5 * filters[1]
    np.testing.assert_allclose(found[0], gaussian_filter(np.maximum(alone, 0.0), 1.0, mode="constant"), atol=1e-12)
    assert not found[1].any()
    method, templates = method_of("hfirst", "", {"size": [16, 16], "orientations": 4}), np.full((3, 4 * 16), -1.0)
    templates[1, 2 * 16 + 4 * 1 + 2] = 100.0
    figure = method.pictures({"templates": templates}, ("a", "b", "c"))["templates"]
    images = images_of(figure)
    assert np.unravel_index(images[1].argmax(), (16, 16)) == (6, 10)
    assert not images[0].any()


def images_of(figure):
    return [np.asarray(axis.images[0].get_array()) for axis in figure.axes if axis.images]


@pytest.mark.parametrize("name", ["hats", "tar_hats"])
def test_averages_of_classes(name, learning):
    """Each picture is the sum over polarities of the mean of what recordings of a class show."""
    made = fit(learning, method_of(name, "", {"cell": 17, "radius": 2}))
    figure, shown = made.method.pictures(made.learnt, made.classes)["averages"], made.shown(learning)
    assert [axis.get_title() for axis in figure.axes] == list(made.classes)
    for k, image in enumerate(images_of(figure)):
        vectors = shown.take(np.flatnonzero(shown.labels == k)).stacked("vector")
        cells = vectors.mean(axis=0).reshape(2, 2, 2, 5, 5).sum(axis=2)
        np.testing.assert_allclose(image[5:, :5], cells[1, 0], rtol=1e-5, atol=1e-7)


def test_prototypes_of_each_layer(learning):
    made = fit(learning.take(range(0, 24, 3)), method_of("hots", "", {"layers": 2, "readout": "nearest"}))
    drawn = made.method.pictures(made.learnt, made.classes)
    assert list(drawn) == ["layer-1", "layer-2"]
    first, second = (images_of(figure) for figure in drawn.values())
    centres = made.learnt["centres_0"]
    np.testing.assert_array_equal(first[2], centres[:, :, 1, 2] - centres[:, :, 0, 2])
    assert (len(first), len(second), second[0].shape) == (4, 8, (9, 9))


def test_names_of_classes_are_no_formulas(tmp_path):
    names = ("$\\x_{^%$", "$${")
    table = Evaluation(names, np.array([[3, 1, 0], [1, 2, 1]]))
    events = Events(np.array([1, 2]), np.array([1, 2]), np.array([3, 4]), np.array([1, 0]), (8, 8))
    box = Boxes.of([(0, 10, 0, 0, 1.0, (1.0, 1.0, 3.0, 3.0))])
    for figure in (
        confusion(table, names[0]), accuracies([(names[0], [table]), (names[1], [table])]),
        prototypes(np.ones((2, 1, 3, 3)), names, [0.0]), images(np.ones((2, 3, 3)), names, *names),
        boxes_on_frames(events, box, names, names[0]),
    ):  # fmt: skip
        figure.savefig(tmp_path / "a.png", dpi=20)
