"""Comparison of controllers on one scenario: train and test every seed, store results in a folder, make a table."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import JobResults, make_folder, provenance, side_by_side
from neuro_drone.controllers import ERROR, kind_of
from neuro_drone.evaluate import Lap, grid, try_out
from neuro_drone.model import Model
from neuro_drone.paths import FlightCourse
from neuro_drone.scenario import Scenario
from neuro_drone.train import TrainingProgress, apply_changes, train

RESULTS = JobResults("a result of 'neuro drone compare'", "neuro drone result 1")
ROWS = ("nothing", "oracle", "centroid", "static", "static-linear", "lms", "snn-eta0", "snn-flipped", "snn")
"""Default rows: baselines without learning, the upper bound, and controls that must fail."""

SEEDLESS = ("nothing", "oracle", "centroid")
"""Deterministic controllers, which need one seed only."""


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """A row of the table.

    Attributes:
        text: the row as text: the name of a controller, then changes "name=value", all separated by spaces.
        controller: name of the controller.
        scenario: scenario with the changes.
        settings: settings of the controller.
        steps: steps of training; 0 for a controller that does not learn.
        seeds: seeds of the trainings.
    """

    text: str
    controller: str
    scenario: Scenario
    settings: Mapping[str, Any]
    steps: int
    seeds: tuple[int, ...]

    @classmethod
    def of(
        cls, text: str, scenario: str | Path, steps: int, seeds: Sequence[int], changes: Iterable[str]
    ) -> ComparisonRow:
        """Parse a row.

        Args:
            text: a controller and changes, e.g. "snn" or "dqn steps=150000 drone.v_max=0.5".
            scenario: scenario of all rows.
            steps: steps of training, unless the text has "steps=".
            seeds: seeds of the trainings.
            changes: changes "name=value" of the scenario in all rows.

        Raises:
            ModelError: a name is unknown or a value is invalid.
        """
        name, *words = text.split() or [""]
        row_changes = [word for word in words if not word.startswith("steps=")]
        for count in (word.removeprefix("steps=") for word in words if word.startswith("steps=")):
            if not count.isdecimal() or int(count) < 1:
                raise ModelError(f"row '{text}': steps = '{count}': expected a whole number >= 1")
            steps = int(count)
        world, settings = apply_changes(scenario, name, [*changes, *row_changes])
        learns = kind_of(name).learns
        return cls(
            " ".join([name, *words]),
            name,
            world,
            settings,
            steps if learns else 0,
            tuple(seeds[:1] if name in SEEDLESS else seeds),
        )


@dataclass(frozen=True, slots=True)
class RowMessage:
    """Progress of a job.

    Attributes:
        what: name of the job.
        done: completed work, in thousandths of the job.
        total: all work, in the same unit.
        text: the progress, or the result at the end.
    """

    what: str
    done: int
    total: int
    text: str


@dataclass(frozen=True, slots=True)
class ComparisonJob:
    """A training and its test.

    Attributes:
        row: row of the table.
        seed: seed of the training.
        starts: number of starts on a side of the grid.
        course: paths of the laps.
        folder: folder of the model and the result.
    """

    row: ComparisonRow
    seed: int
    starts: int
    course: FlightCourse
    folder: Path

    @property
    def file(self) -> Path:
        """The model's file; the result is stored beside it as JSON."""
        name = re.sub(r"[^\w.=-]+", "_", self.row.text)
        return self.folder / f"{name}-{self.seed}.h5"

    def run(self, report: Callable[[RowMessage], None]) -> dict[str, Any]:
        """Train and test, unless the folder has the result, and return the figures as plain data."""
        row, result = self.row, self.file.with_suffix(".json")

        def send(share: float, text: str) -> None:
            report(RowMessage(f"{row.text} seed {self.seed}", round(1000 * share), 1000, text))

        def send_training(p: TrainingProgress) -> None:
            send(0.6 * p.step / p.steps, p.text)

        steps = max(1, row.steps)
        model = train(
            row.scenario, row.controller, steps=steps, seed=self.seed, settings=row.settings, out=self.file,
            report=send_training,
        )  # fmt: skip
        test = {"grid": self.starts, "path": self.course.path, "test_seed": self.course.seed}
        key = model.training_arguments() | {"steps": model.steps} | test
        figures = RESULTS.of_job(result, key, lambda: self._test(model, send))
        send(1.0, f"{figures['error_px']:.2f} px, {figures['laps']} of {figures['starts']} laps")
        return figures

    def _test(self, model: Model, send: Callable[[float, str], None]) -> dict[str, Any]:
        """Return the figures of the test.

        A controller that the supervised error teaches is tested a second time, with learning on.
        """
        starts, laps = grid(model.scenario, self.starts, course=self.course), [0]
        also_learning = kind_of(model.controller).taught == ERROR

        def send_lap(lap: Lap) -> None:
            laps[0] += 1
            send(0.6 + 0.39 * laps[0] / (len(starts) * (1 + also_learning)), f"test, {laps[0]} laps")

        flight = try_out(model, starts=starts, report=send_lap).as_words()
        figures: dict[str, Any] = {"provenance": provenance(seed=self.seed)}
        figures |= {name: flight[name] for name in ("error_px", "laps", "starts", "signed", "absolute")}
        if also_learning:
            figures["learning_on"] = try_out(model, starts=starts, learning=True, report=send_lap).error_px
        return figures


def run(
    rows: Sequence[ComparisonRow],
    starts: int,
    course: FlightCourse,
    folder: Path,
    report: Callable[[RowMessage], None] | None = None,
) -> list[Summary]:
    """Train and test all rows on all cores. Results in the folder are reused.

    Args:
        rows: rows of the table.
        starts: number of starts on a side of the grid.
        course: paths of the laps.
        folder: folder of models and results.
        report: called with the progress of each job.

    Raises:
        ModelError: the first error of a job.
    """
    make_folder(folder)
    jobs = [ComparisonJob(row, seed, starts, course, folder) for row in rows for seed in row.seeds]
    results = side_by_side(ComparisonJob.run, jobs, report=report)
    return [Summary(row, tuple(run for job, run in zip(jobs, results, strict=True) if job.row is row)) for row in rows]


@dataclass(frozen=True, slots=True)
class Summary:
    """The results of a row.

    Attributes:
        row: row of the table.
        each: figures of each seed, in the order of `row.seeds`.
    """

    row: ComparisonRow
    each: tuple[Mapping[str, Any], ...] = field(repr=False)

    def mean(self, name: str) -> Any:
        """Return the mean of a figure over the seeds that have it; None if no seed has it."""
        values = [result[name] for result in self.each if name in result]
        return np.mean(values, axis=0).tolist() if values else None

    @property
    def course(self) -> FlightCourse:
        """Paths of the laps."""
        key = self.each[0]["of"]
        return FlightCourse(key["path"], key["test_seed"])

    @property
    def sd(self) -> float | None:
        """Standard deviation of the error over the seeds, px; None for a single seed."""
        errors = [result["error_px"] for result in self.each]
        return float(np.std(errors, ddof=1)) if len(errors) > 1 else None

    def total(self, name: str) -> int:
        """Return the sum of a figure over the seeds."""
        return int(sum(result[name] for result in self.each))

    def as_words(self) -> dict[str, Any]:
        """Return the row as plain data, for JSON."""
        row = self.row
        return {
            "row": row.text, "controller": row.controller, "steps": row.steps, "seeds": list(row.seeds),
            "error_px": self.mean("error_px"), "sd": self.sd, "laps": self.total("laps"),
            "starts": self.total("starts"), "absolute": self.mean("absolute"), "signed": self.mean("signed"),
            "learning_on": self.mean("learning_on"), "each": [dict(result) for result in self.each],
        }  # fmt: skip
