"""Detection of several objects: scenes, places, tracks, and a detector, on recordings of drawn shapes."""

from dataclasses import replace

import numpy as np
import pytest

from flickering import FIELD, SIDE, drawn
from neuro.events import Events, recordings
from neuro_recognise import fit
from neuro_recognise.detection import Boxes, Detecting, Detector, Scenery, Scenes, compose, detector, write_scenes
from neuro_recognise.detection.boxes import iou, read_boxes, write_boxes
from neuro_recognise.detection.proposals import Proposals, Region
from neuro_recognise.detection.report import check_classes
from neuro_recognise.detection.scenes import fold_of
from refused import refusals_of, refused


@pytest.fixture(scope="module")
def folder(shapes_folder):
    return shapes_folder


@pytest.fixture(scope="module")
def recogniser(folder, tmp_path_factory):
    return fit(recordings(folder), "hats", cache=tmp_path_factory.mktemp("cache"))


def scene(seed=0, n=3, **values):
    labels = [(seed + k) % 2 for k in range(n)]
    found = [drawn(("cross", "ring")[label], 100 + seed * 10 + k) for k, label in enumerate(labels)]
    return compose("a scene", found, labels, Scenery().changed(values), np.random.default_rng(seed))


def gap(a, b):
    return max(a[0] - b[2], b[0] - a[2], a[1] - b[3], b[1] - a[3])


@pytest.mark.parametrize("seed", range(3))
def test_true_boxes_span_the_objects(seed):
    made = scene(seed, speed=0.0)
    assert made.boxes.spans().tolist() == [[0, 100_000], [100_000, 200_000], [200_000, 300_000]]
    assert sorted(made.boxes.identity.tolist()) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    sides = made.boxes.box[:, 2:] - made.boxes.box[:, :2]
    assert abs(sides - SIDE).max() <= 3  # few events of a ring are at its very edge
    assert (made.boxes.box >= -1).all()
    assert (made.boxes.box[:, 2:] <= np.array([101, 81])).all()


def test_scenes_move_have_noise_and_touch():
    for seed in range(3):
        apart, touching = scene(seed), scene(seed, touching=True)
        for start, _ in apart.boxes.spans():
            box = apart.boxes.box[apart.boxes.start == start]
            assert min(gap(box[i], box[j]) for i in range(3) for j in range(i)) >= 4.0
            box = touching.boxes.box[touching.boxes.start == start]
            nearest = [min(gap(box[i], box[j]) for j in range(3) if j != i) for i in range(3)]
            assert max(nearest) <= 3.0
    made = scene(1, n=1, speed=20.0, length=1000.0)
    assert made.events.t[-1] > 980_000
    middle = (made.boxes.box[:, :2] + made.boxes.box[:, 2:]) / 2
    assert np.linalg.norm(middle[-1] - middle[0]) == pytest.approx(20.0 * 0.9, abs=2.0)
    quiet, loud = scene(2, noise=0.0), scene(2, noise=10.0)
    assert len(loud.events) - len(quiet.events) == pytest.approx(10.0 * 100 * 80 * 0.3, rel=0.05)
    np.testing.assert_array_equal(loud.boxes.box, quiet.boxes.box)
    wholes = 0
    for seed in range(5):
        made = scene(seed, n=2, touching=True)
        there = made.boxes.box[made.boxes.start == 0]
        found = np.array([region.box for region in regions(made, Proposals())])
        assert len(found) == 2
        assert (iou(there, found).max(axis=1) > 0.5).all()
        wholes += len(regions(made, Proposals(cut=1e9, more=1e9))) == 1
    assert wholes >= 3  # it is the cut that tells them apart
    made = scene(0, n=1)
    left, _, right, _ = made.boxes.box[0]
    middle = (left + right) / 2
    broken = regions(replace(made, events=made.events[abs(made.events.x - middle) > 2.0]), Proposals())
    assert len(broken) == 1
    assert iou(made.boxes.box[:1], broken[0].box[None])[0, 0] > 0.7


def test_what_cannot_be(tmp_path, folder, messages):
    head, wrong = "start_us,stop_us,identity,class,score,left,top,right,bottom", []
    for k, text in enumerate(("a,b\n", f"{head}\n0,1,0,ring,1,0,0,1\n", f"{head}\n0,1,0,star,1,0,0,1,1\n")):
        wrong.append(tmp_path / f"{k}.csv")
        wrong[k].write_text(text)
    empty, data = Events([5], [1], [1], [0], (FIELD, FIELD)), recordings(folder)
    messages(refusals_of(messages.cases, globals() | locals(), tmp_path=tmp_path, folder=folder))


def test_a_folder_of_scenes_is_made_in_several_goes(folder, tmp_path):
    data = recordings(folder)
    whole = write_scenes(tmp_path / "whole", data, Scenery(), 3, seed=4)

    def killed(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_scenes(tmp_path / "two", data, Scenery(), 3, seed=4, report=killed)
    missing = f"{tmp_path / 'two'}: 1 of 3 scenes are missing, the first is 0002\n"
    assert refused(Scenes, tmp_path / "two").startswith(missing)
    (tmp_path / "two" / "0001.csv").unlink()  # as of a kill between the events and the boxes
    again = write_scenes(tmp_path / "two", data, Scenery(), 3, seed=4)
    assert (again.classes, again.scenery) == (("cross", "ring"), Scenery())
    for one, other in zip(whole, again, strict=True):
        assert one.events == other.events
        for name in ("box", "label"):
            np.testing.assert_array_equal(getattr(one.boxes, name), getattr(other.boxes, name))


def test_scenes_of_a_folder(folder, tmp_path):
    data, there = recordings(folder), tmp_path / "s"
    scenes = write_scenes(there, data, Scenery(), 1)
    check_classes(("cross", "ring"), scenes)
    told = "the scenes have classes cross, ring, expected those of the recogniser: ring, star"
    assert refused(check_classes, ("ring", "star"), scenes) == told
    other = refused(write_scenes, there, data, Scenery(noise=2.0), 1)
    assert other.startswith(f"{there}: has scenes with another scenery\n")
    grown = write_scenes(there, data, Scenery(), 2)  # more are added to those that are there
    assert (len(grown), grown[0].events) == (2, scenes[0].events)
    assert refused(write_scenes, there, data, Scenery(), 1).startswith(f"{there}: has scenes with another count\n")
    scenes = write_scenes(tmp_path / "s", recordings(folder), Scenery(), 4)
    there = sum(len(np.unique(one.boxes.identity)) for one in scenes)
    assert detector.write_crops(tmp_path / "crops", scenes, Detecting()) == there
    data = recordings(tmp_path / "crops")
    assert (data.classes, len(data), data[0].load().sensor_size) == (("cross", "ring"), there, (34, 34))
    assert detector.try_out(Detector(fit(data, "hats")), scenes).precision.mean == 1.0
    data = recordings(folder)
    assert fold_of(data, 1, 0).tolist() == list(range(16))
    found = [fold_of(data, 5, k) for k in range(5)]
    assert [fold.tolist() for fold in found] == [test.tolist() for _, test in data.folds(5, seed=0)]


def test_a_table_of_boxes_comes_back(tmp_path):
    boxes = Boxes.of([(0, 10, 3, 1, 0.5, (1, 2, 3.25, 4)), (10, 20, 4, -1, 0.0, (0, 0, 1, 1))])
    write_boxes(tmp_path / "b.csv", boxes, ("cross", "ring"))
    again = read_boxes(tmp_path / "b.csv", ("cross", "ring"))
    for name in ("start", "stop", "identity", "label", "score", "box"):
        np.testing.assert_array_equal(getattr(again, name), getattr(boxes, name))


def regions(made, proposals, start=0):
    segment = made.events.between(start, start + 100_000)
    counts = np.zeros(segment.sensor_size[::-1])
    np.add.at(counts, (segment.y, segment.x), 1)
    return proposals.regions(segment, counts)


@pytest.mark.parametrize("noise", [0.0, 1.0, 10.0])
@pytest.mark.parametrize("seed", range(3))
def test_places_are_found_whatever_the_background(seed, noise):
    made = scene(seed, noise=noise)
    found = np.array([region.box for region in regions(made, Proposals())])
    there = made.boxes.box[made.boxes.start == 0]
    assert len(found) == len(there)
    assert (iou(there, found).max(axis=1) > 0.7).all()


def place(x, y, side=20):
    """A region that only has a box."""
    box = np.array([x, y, x + side, y + side], float)
    return Region(Events([], [], [], [], (200, 200)), box, (box[:2] + box[2:]) / 2)


def test_tracks():
    tracks = detector.Tracks(detector.Tracking(reach=30.0))
    first = tracks.follow([place(0, 0), place(6, 0)], 0)
    second = tracks.follow([place(15, 0), place(5, 0)], 100_000)  # alone, the one at 5 would go to the one at 6
    assert [track.number for track in second] == [first[1].number, first[0].number]
    for seen_again, same in ((200_000, True), (400_000, False)):
        tracks = detector.Tracks(detector.Tracking(patience=250.0))
        (one,) = tracks.follow([place(0, 0)], 0)
        assert tracks.follow([], 100_000) == []
        (other,) = tracks.follow([place(2, 0)], seen_again)
        assert (one is other) is same
    tracks = detector.Tracks(detector.Tracking(reach=10.0))
    (one,) = tracks.follow([place(0, 0)], 0)
    (other,) = tracks.follow([place(11, 0)], 1000)
    assert one.number != other.number
    tracks = detector.Tracks(detector.Tracking(reach=10.0, gain=1.0))
    numbers = [tracks.follow([place(8 * k, 0)], 100_000 * k)[0].number for k in (0, 1, 3)]  # 16 px while out of sight
    assert len(set(numbers)) == 1


def test_a_crop_has_the_object_in_the_middle():
    (piece,) = detector.pieces(scene(3, n=1, noise=0.0).events, Detecting())
    shown = detector.crop(piece.regions, (35, 35))
    assert (shown.sensor_size, shown.x.mean()) == ((35, 35), pytest.approx(17, abs=0.5))
    assert shown.y.mean() == pytest.approx(17, abs=0.5)
    half = detector.crop(piece.regions, (35, 35), scale=2.0)
    assert len(half) == pytest.approx(len(shown) / 4, abs=1)
    assert np.ptp(half.x) == pytest.approx(np.ptp(shown.x) / 2, abs=1.5)


def test_objects_are_found_named_and_followed(recogniser):
    found = detector.try_out(Detector(recogniser), [scene(seed, length=600.0) for seed in range(2)])
    assert found.precision.box == 1.0
    assert found.precision.mean > 0.9
    assert (found.switches.switches, found.switches.missed, found.scenes) == (0, 0, 2)
    assert found.as_words(("cross", "ring"))["objects"] == 6
    stream, first, second = Detector(recogniser), scene(0, n=1).events, scene(1, n=1).events
    stream.feed(first)
    later = Events(second.t + 2_000_000, second.x, second.y, second.p, second.sensor_size)
    assert (len(np.unique(stream.feed(later).identity)), len(stream._known)) == (2, 1)
    stream = Detector(recogniser)
    stream.feed(scene(0, n=1).events)
    assert refused(stream.feed, drawn("ring", 0)) == "events of a sensor of 34x34 px after those of 100x80 px"
    assert len(Detector(recogniser).detect(Events([], [], [], [], (100, 80)))) == 0
    rng = np.random.default_rng(0)
    noise = Events(np.sort(rng.integers(300_000, size=2400)), rng.integers(100, size=2400),
                   rng.integers(80, size=2400), rng.integers(2, size=2400), (100, 80))  # fmt: skip
    assert len(Detector(recogniser).detect(noise)) == 0
    made, rng = scene(6, n=2, sensor=[70, 40], speed=0.0, noise=0.0), np.random.default_rng(0)
    four = np.repeat(np.arange(len(made.events)), 4)  # every pixel becomes 2x2, each with its own events
    x, y = (2 * values[four].astype(int) + rng.integers(2, size=len(four)) for values in (made.events.x, made.events.y))
    larger = Events(made.events.t[four], x, y, made.events.p[four], (140, 80))
    there = Boxes(*(getattr(made.boxes, n) for n in ("start", "stop", "identity", "label", "score")),
                  2 * made.boxes.box)  # fmt: skip
    settings, twice = Detecting().changed({"scales": [1.0, 2.0]}), replace(made, events=larger, boxes=there)
    for start, found in detector.in_pictures(twice, Detector(recogniser, settings).detect(larger)):
        assert len(found) == 2
        assert (iou(start.box, found.box).max(axis=1) > 0.6).all()
        assert found.label[iou(start.box, found.box).argmax(axis=1)].tolist() == start.label.tolist()


@pytest.mark.parametrize("settings", [{}, {"segmenter": "counts", "count": 3000}, {"segmenter": "msd", "leak": 50.0,
                                       "threshold": 300.0, "fewest": 20}])  # fmt: skip
def test_a_stream_gives_what_the_recording_gives(recogniser, settings):
    made, chosen = scene(5, length=500.0), Detecting().changed(settings)
    whole = Detector(recogniser, chosen).detect(made.events)
    assert len(whole) >= 6
    stream = Detector(recogniser, chosen)
    parts = [stream.feed(made.events[k : k + 1111]) for k in range(0, len(made.events), 1111)]
    parts.append(stream.finish())
    for name in ("start", "stop", "identity", "box"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))
    last, expected = ({int(who): (int(label), pytest.approx(float(score))) for one in of
                       for who, label, score in zip(one.identity, one.label, one.score, strict=True)}
                      for of in (parts, [whole]))  # fmt: skip
    assert last.keys() == expected.keys()
    assert all((last[who][0], last[who][1].expected) == (label, score) for who, (label, score) in expected.items())
    assert len(stream.finish()) == 0


def test_a_view_cuts_as_its_segmenter_does():
    made, view = scene(7), detector.WindowView(Detecting(), (100, 80))
    segments = [*view.segments(made.events[:5000]), *view.segments(made.events[5000:]), *view.rest()]
    bounds = Detecting().segmenter.bounds(made.events.t)
    assert [len(segment) for segment in segments[:-1]] == np.diff(bounds).tolist()
    assert sum(map(len, segments)) == len(made.events)
