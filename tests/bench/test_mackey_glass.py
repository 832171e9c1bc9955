"""The series obeys its equation, and folds are NeuroBench's."""

import numpy as np
import pytest

from neuro_bench.mackey_glass import PARAMETERS, POINTS, MackeyGlass, solution
from refused import refused


def test_the_series():
    lyapunov, past = PARAMETERS[17]
    t = np.arange(6) * lyapunov / POINTS
    fixed = 0.2 * past / (1 + past**10) / 0.1  # for t < tau the delayed value is constant
    assert solution(17, 6) == pytest.approx(fixed + (past - fixed) * np.exp(-0.1 * t), abs=1e-10)
    true = solution(23, 60, 64)
    coarse, fine = (np.abs(solution(23, 60, n) - true).max() for n in (2, 4))
    assert 10.0 < coarse / fine < 30.0


def test_folds(tmp_path):
    first, second, *rest = MackeyGlass().folds()
    assert (len(first.both), len(first.test), len(rest), second.both[0]) == (750, 750, 3, first.both[37])
    assert len(MackeyGlass(split="all").splits) == 15
    first, *_, last = MackeyGlass().folds()
    assert first.validation is last.validation
    assert [len(each) for each in (*first.train, *first.validation)] == [750] * 6
    whole = solution(17, 64 * 75)
    for k in range(3):
        begin = (24 + 10 * k) * 75
        assert np.array_equal(np.concatenate((first.train[k], first.validation[k])), whole[begin : begin + 1500])
    assert not np.isin(last.test, np.concatenate((*first.train, *first.validation))).any()
    np.save(tmp_path / "mg_17.npy", np.arange(2000.0))
    assert MackeyGlass(tmp_path).folds()[0].test[0] == 750.0
    assert "mg_18.npy: cannot be read" in refused(MackeyGlass(tmp_path, "tau18").folds)
    task = MackeyGlass()
    assert task.score(np.array([1.0, 3.0]), np.array([1.0, 1.0])) == 50.0
    assert task.score(np.array([np.nan, 1.0]), np.array([1.0, 1.0])) == 200.0
