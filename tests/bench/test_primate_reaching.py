"""Files of the data set's format, made here: a cursor, and spikes of units that prefer directions of its velocity."""

from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from neuro_bench import Recording, report
from neuro_bench.primate_reaching import PrimateReaching, read
from neuro_bench.regression import Windows, stretches
from refused import refusals_of


def test_sessions(tmp_path, write_reaching, reaching):
    file = write_reaching(tmp_path / "indy_3.mat", steps=200, targets=4)
    with h5py.File(file, "r+") as opened:
        opened["#refs#/edge"] = np.array([[100.0]])
        for unit, times in enumerate(([100.0005, 100.0015, 100.0205], [99.997, 100.0210, 100.9])):
            opened[f"#refs#/own{unit}"] = np.array(times)[:, None]
            opened["spikes"][unit, 0] = opened[f"#refs#/own{unit}"].ref
            opened["spikes"][unit, 1] = opened["#refs#/edge"].ref
    recording, _ = read(file)
    # step k hears the 4 ms that end as step k - 1 begins; what is after the last is dropped
    assert np.flatnonzero(recording.spikes[:, 0]).tolist() == [1, 2, 7]
    assert np.flatnonzero(recording.spikes[:, 1]).tolist() == [2]
    x = np.array([0.0, 1.0, 4.0, 9.0, 9.0, 9.0, 9.0, 9.0])
    target = np.stack((np.repeat([1.0, 1.0, 2.0, 2.0], 2), np.repeat([0.0, 3.0, 3.0, 5.0], 2)))
    file = write_reaching(tmp_path / "indy_3.mat", steps=8, cursor_pos=np.stack((x, -x)), target_pos=target)
    recording, segments = read(file)
    assert recording.targets[:, 0].tolist() == [1.0, 2.0, 4.0, 2.5, 0.0, 0.0, 0.0, 0.0]
    assert np.array_equal(recording.targets[:, 1], -recording.targets[:, 0])
    assert segments.tolist() == [[0, 1], [1, 3], [3, 5], [5, 8]]
    fold = PrimateReaching(file).folds()[0]
    assert [len(part) for part in (fold.train, fold.validation, fold.both, fold.test)] == [3, 2, 5, 3]
    lengths = [100, 2000, 1999, 50, 2500, 60]
    target = np.repeat(np.arange(6.0), lengths)
    write_reaching(tmp_path / "a.mat", steps=sum(lengths), target_pos=np.stack((target, target)))
    whole, active = (PrimateReaching(tmp_path, split).folds()[0] for split in ("official", "active"))
    sizes = [[len(part) for part in (fold.train, fold.validation, fold.test)] for fold in (whole, active)]
    assert sizes[0] == [4098, 50, 2561]  # a target moves one step after the last of its segment
    assert sizes[1] == [2098, 50, 61]
    assert np.array_equal(active.test.targets, whole.test.targets[-61:])
    task = PrimateReaching(reaching)
    fold = task.folds()[1]
    assert fold.name == "loco_2"
    wanted = fold.test.targets.astype(np.float64)
    assert task.score(wanted, fold.test) == 1.0
    half = np.stack((wanted[:, 0], np.full(len(wanted), wanted[:, 1].mean())), axis=1)
    assert task.score(half, fold.test) == pytest.approx(0.5)


def test_windows_and_stretches():
    spikes = np.random.default_rng(0).random((30, 3)) < 0.5
    found = Windows(Recording(spikes, np.zeros((30, 2), np.float32), 4.0), width=4, lags=2).at(np.array([2, 9, 29]))
    parts = (spikes[max(end - 4, 0) : max(end, 0)] for k in (2, 9, 29) for end in (k + 1, k - 3))
    assert np.array_equal(found, np.reshape([part.sum(axis=0) for part in parts], (3, 6)))
    pytest.importorskip("torch", reason="the extra torch is not installed")
    spikes, targets = np.eye(10, dtype=bool), np.arange(10, dtype=np.float32)[:, None]
    found = stretches(Recording(spikes, targets, 4.0), steps=4, before=3)
    asked = ~np.isnan(found.labels)
    assert found.labels[asked].tolist() == list(range(10))
    assert asked[:, :, 0].tolist() == [[False] * 3 + [True] * 4] * 2 + [[False] * 3 + [True] * 2 + [False] * 2]
    train = found.events.trains["input"].of([1])
    assert (train.neuron - train.step).tolist() == [1] * 7  # channel k spikes in step k: 1 to 7 are heard


@pytest.mark.filterwarnings("ignore:backend 'loihi':")
def test_the_spiking_network_and_its_opponents_say_where_the_cursor_goes(bench, reaching):
    """They learn from three quarters of two sessions of 20 s, and are tested on the rest."""
    pytest.importorskip("torch", reason="the extra torch is not installed")
    changes = {"wiener": (), "mlp": ("epochs=3",), "lif-readout": ("epochs=20", "batch=4", "hidden=32")}
    files = []
    for method, words in changes.items():
        sets = [word for one in words for word in ("--set", one)]
        status, _, err = bench("run", "primate-reaching", "--method", method, "--data", reaching, *sets)
        assert status == 0, err
        files.append(f"primate-reaching-official-{method}.json")
    found = {file: report.read(Path(file)) for file in files}
    means = [one["mean"] for one in found.values()]
    assert all(mean > 0.3 for mean in means), means
    spiking = found[files[2]]["costs"]
    assert spiking["effective_macs"] == 0.0
    assert spiking["host"]["macs"] == 2, "a product with a sum for each of two values in a step"
    assert 0.0 < spiking["effective_acs"] < spiking["dense"] == 24 * 32 + 32 * 2
    assert found[files[0]]["costs"]["dense"] == 24 * 10 * 2
    status, out, err = bench("compare", *files)
    assert (status, err) == (0, "")
    assert f"{max(means):.3f} [" in out


def test_another_file_is_refused(tmp_path, write_reaching, messages):
    def folds(**changes):
        return PrimateReaching(write_reaching(tmp_path / "indy_3.mat", **changes)).folds()

    (tmp_path / "empty").mkdir()
    messages(refusals_of(messages.cases, globals() | locals(), folder=tmp_path))


def test_a_damaged_file_is_refused_or_read(tmp_path, reaching):
    whole, rng = (reaching / "indy_1.mat").read_bytes(), np.random.default_rng(3)
    file, refused = tmp_path / "indy_1.mat", 0
    for k in range(30):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 200):
            data[at] = rng.integers(256)
        file.write_bytes(data if k % 3 else data[: int(rng.integers(len(data)))])
        try:
            PrimateReaching(file).folds()
        except neuro.ModelError as error:
            refused += str(file) in str(error)
    assert refused >= 15
