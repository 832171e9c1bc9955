"""How figures of `benchmarks/few_recordings.py` are taken: draws, equal work, and what a kill leaves."""

import json

import numpy as np
import pytest

from benchmark_scripts import BENCHMARKS, script

pytest.importorskip("torch", reason="PyTorch is not installed")

from neuro.events import Events, recordings, save


@pytest.fixture(scope="module")
def few():
    return script("few_recordings")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Twenty recordings of two classes."""
    folder = tmp_path_factory.mktemp("data")
    for k in range(20):
        file = folder / "ab"[k % 2] / f"{k:02d}.npz"
        file.parent.mkdir(exist_ok=True)
        save(Events([0, 10 + k], [1, 2], [3, k % 4], [0, 1], (8, 8)), file)
    return recordings(folder)


def test_a_draw_holds_the_same_back_for_all_sizes(few, data):
    for draw in range(3):
        sets = [few.split(data, size, draw) for size in (1, 3, few.ALL)]
        for (rows, held), size in zip(sets, (1, 3, 8), strict=True):
            np.testing.assert_array_equal(held, sets[0][1])
            assert not set(rows) & set(held)
            assert np.bincount(data.labels[rows]).tolist() == [size, size]
        assert set(sets[0][0]) < set(sets[1][0]) < set(sets[2][0])
        assert len(sets[2][0]) + len(held) == len(data)
    assert set(few.split(data, 1, 0)[0]) != set(few.split(data, 1, 1)[0])


def test_ways_to_learn_do_equal_work_whatever_the_number_of_recordings(few):
    for number, epochs in ((10, 1200), (50, 400), (100, 240), (300, 80), (800, 30)):
        plan = few.plan_of(number, 3)
        assert (plan.epochs, plan.seed, plan.bits) == (epochs, 3, None)
        assert plan.epochs * -(-number // plan.batch) == few.STEPS
    assert few.plan_of(100, 3, bits=8).bits == 8
    assert [few.showings_epochs(n) * n for n in (10, 50, 100)] == [few.SHOWINGS] * 3
    assert few.showings_epochs(10 * few.SHOWINGS) == 1


def test_what_is_measured_is_not_measured_again(few, data, tmp_path, monkeypatch):
    asked = list(few.jobs(2, tuple(few.WAYS)))
    assert len(set(asked)) == len(asked) == 2 * (3 * len(few.SIZES) + len(few.LONG))
    sizes = [size for size, _, _ in asked]
    assert (few.ALL not in sizes[: -2 * 3], set(sizes[-2 * 3 :])) == (True, {few.ALL}), "all recordings come last"

    class Counted(few.Bench):
        asked = 0

        def learnt(self, way, rows, held, seed):
            self.asked += 1
            return few.Learnt(np.arange(len(held)) < 3, 1.0)

    monkeypatch.setattr(few, "SIZES", (1, few.ALL))
    bench, file = Counted(data), tmp_path / "accuracy.jsonl"
    found = few.measured(bench, file, 2, ("hats", "remus"))
    assert bench.asked == len(found) == 8
    assert {(one["right"], one["tested"]) for one in found} == {(3, 4)}
    file.write_text(file.read_text()[:-20])  # a kill while the last line was written
    assert len(few.lines(file)) == 7
    assert all((few.measured(bench, file, 2, ("hats", "remus")), bench.asked) == (found, 9) for _ in range(2))


def test_points_have_the_mean_and_the_ends_of_the_draws(few):
    line = {"way": "hats", "per_class": 5, "recordings": 50, "tested": 200}
    found = [line | {"draw": k, "right": right, "cpu_s": 1.0 + k} for k, right in enumerate((100, 130, 160))]
    assert list(few.points(found, "hats")) == [(5, pytest.approx(0.65), 0.5, 0.8, 2.0)]
    assert list(few.points(found, "remus")) == []
    kept = few.lines(BENCHMARKS / "measured" / "few_recordings.jsonl")  # figures of docs/how-to/local-or-gradients.md
    assert len({(one["per_class"], one["draw"], one["way"]) for one in kept}) == len(kept)
    assert all(0 <= one["right"] <= one["tested"] == 200 for one in kept)
    assert json.loads((BENCHMARKS / "measured" / "few_recordings_joules.json").read_text()).keys() == {"remus", "drone"}
