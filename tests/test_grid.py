"""A grid of jobs: what is done is not done again, what failed is tried again, and edited files stay."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from neuro import ModelError
from neuro.apps import JobResults, Unwritable, grid

RESULTS = JobResults("a result of a test", "test result 1")


@dataclass(frozen=True)
class Job:
    """A job that notes in a file that it was done."""

    folder: Path
    number: int
    setting: float = 1.0

    @property
    def file(self):
        return self.folder / f"{self.number}.json"

    @property
    def of(self):
        return {"number": self.number, "setting": self.setting, "shape": (2, 3)}

    def work(self, report):
        with (self.folder / "done").open("a") as file:
            file.write(f"{self.number}\n")
        report(f"job {self.number}")
        if self.number == 3:
            raise KeyboardInterrupt
        return {"refused": "no"} if self.number == 2 else {"square": self.number**2}


def done(folder):
    """Numbers of the jobs that were done since the last call."""
    file = folder / "done"
    numbers = sorted(map(int, file.read_text().split())) if file.exists() else []
    file.unlink(missing_ok=True)
    return numbers


@pytest.mark.parametrize("processes", [1, 2])
def test_a_job_is_done_once(tmp_path, processes):
    jobs, told = [Job(tmp_path, number) for number in (0, 1, 4)], []
    first = grid(RESULTS, jobs, processes, told.append)
    assert [result["square"] for result in first] == [0, 1, 16]
    assert (done(tmp_path), sorted(told)) == ([0, 1, 4], ["job 0", "job 1", "job 4"])
    (tmp_path / "1.json").unlink()
    told.clear()
    assert (grid(RESULTS, jobs, processes, told.append), done(tmp_path), told) == (first, [1], [None, None, "job 1"])


def test_another_description_or_format_is_another_job(tmp_path):
    (first,) = grid(RESULTS, [Job(tmp_path, 1)])
    assert (done(tmp_path), RESULTS.read(tmp_path / "1.json", Job(tmp_path, 1).of)) == ([1], first)
    assert RESULTS.read(tmp_path / "1.json", Job(tmp_path, 1, 2.0).of) == {}
    assert JobResults("a result of a test", "test result 2").read(tmp_path / "1.json", Job(tmp_path, 1).of) == {}
    grid(RESULTS, [Job(tmp_path, 1, 2.0)])
    assert done(tmp_path) == [1]


def test_a_refused_job_is_tried_again(tmp_path):
    assert all((grid(RESULTS, [Job(tmp_path, 2)]), done(tmp_path)) == ([{"refused": "no"}], [2]) for _ in range(2))
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_grid_goes_on(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        grid(RESULTS, [Job(tmp_path, number) for number in (0, 3, 1)], 1)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["0.json", "done"]
    done(tmp_path)
    grid(RESULTS, [Job(tmp_path, number) for number in (0, 1)], 1)
    assert done(tmp_path) == [1]


def test_a_file_that_was_edited_is_not_replaced(tmp_path):
    grid(RESULTS, [Job(tmp_path, 1)])
    file = tmp_path / "1.json"
    edited = file.read_text().replace('"setting": 1.0', '"setting": 5.0')
    file.write_text(edited)
    done(tmp_path)
    with pytest.raises(Unwritable, match="exists and is not a result of a test: expected a new name"):
        grid(RESULTS, [Job(tmp_path, 1)])
    assert (done(tmp_path), file.read_text()) == ([], edited)
    assert issubclass(Unwritable, ModelError)
