"""Controllers side by side on one scenario: every seed trained and tested, kept in a folder, and shown as a table."""

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
from neuro_drone.train import TrainingProgress, chosen, train

RESULTS = JobResults("a result of 'neuro drone compare'", "neuro drone result 1")
ROWS = ("nothing", "oracle", "centroid", "static", "static-linear", "lms", "snn-eta0", "snn-flipped", "snn")
"""What is always compared: what a world gives for free, what the best can reach, and what must fail."""

SEEDLESS = ("nothing", "oracle", "centroid")
"""Controllers in which nothing is random: one seed says all."""


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """One line of the table.

    Attributes:
        text: as the user said it: a controller, and changes as "name=value" after spaces.
        controller: its name.
        scenario: with the changes.
        settings: of the controller.
        steps: of training; 0 of one that does not learn.
        seeds: of the trainings.
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
        """A row from what the user says.

        Args:
            text: "snn", or with changes "dqn steps=150000 drone.v_max=0.5".
            scenario: of all rows.
            steps: of training, unless the text says others.
            seeds: of the trainings.
            changes: of the scenario in all rows, as texts.

        Raises:
            ModelError: a name is unknown or a value cannot be.
        """
        name, *more = text.split() or [""]
        own = [word for word in more if not word.startswith("steps=")]
        for count in (word.removeprefix("steps=") for word in more if word.startswith("steps=")):
            if not count.isdecimal() or int(count) < 1:
                raise ModelError(f"row '{text}': steps = '{count}': expected a whole number >= 1")
            steps = int(count)
        world, settings = chosen(scenario, name, [*changes, *own])
        learns = kind_of(name).learns
        return cls(
            " ".join([name, *more]),
            name,
            world,
            settings,
            steps if learns else 0,
            tuple(seeds[:1] if name in SEEDLESS else seeds),
        )


@dataclass(frozen=True, slots=True)
class RowMessage:
    """How far a job is: what it is, how much of how much is done, and in words; of one that is done its result."""

    what: str
    done: int
    total: int
    told: str


@dataclass(frozen=True, slots=True)
class ComparisonJob:
    """A training and its test.

    Attributes:
        row: of the table.
        seed: of the training.
        starts: on a side of the grid.
        course: of the laps.
        folder: where the model and the result are kept.
    """

    row: ComparisonRow
    seed: int
    starts: int
    course: FlightCourse
    folder: Path

    @property
    def file(self) -> Path:
        """Of the model; the result lies beside it as JSON."""
        name = re.sub(r"[^\w.=-]+", "_", self.row.text)
        return self.folder / f"{name}-{self.seed}.h5"

    def run(self, report: Callable[[RowMessage], None]) -> dict[str, Any]:
        """Train and test, unless the result is there; gives the figures as plain data."""
        row, result = self.row, self.file.with_suffix(".json")

        def say(share: float, message: str) -> None:
            report(RowMessage(f"{row.text} seed {self.seed}", round(1000 * share), 1000, message))

        def learns(p: TrainingProgress) -> None:
            say(0.6 * p.step / p.steps, p.text)

        steps = max(1, row.steps)
        model = train(
            row.scenario, row.controller, steps=steps, seed=self.seed, settings=row.settings, out=self.file,
            report=learns,
        )  # fmt: skip
        flown = {"grid": self.starts, "path": self.course.path, "test_seed": self.course.seed}
        of = model.told() | {"steps": model.steps} | flown
        kept = RESULTS.of_job(result, of, lambda: self._tried(model, say))
        say(1.0, f"{kept['error_px']:.2f} px, {kept['laps']} of {kept['starts']} laps")
        return kept

    def _tried(self, model: Model, say: Callable[[float, str], None]) -> dict[str, Any]:
        """Figures of the test and, of what is steered by the supervised error, with learning on."""
        places, flown = grid(model.scenario, self.starts, course=self.course), [0]
        both = kind_of(model.controller).taught == ERROR

        def tell(lap: Lap) -> None:
            flown[0] += 1
            say(0.6 + 0.39 * flown[0] / (len(places) * (1 + both)), f"test, {flown[0]} laps")

        flight = try_out(model, starts=places, report=tell).as_words()
        figures: dict[str, Any] = {"provenance": provenance(seed=self.seed)}
        figures |= {name: flight[name] for name in ("error_px", "laps", "starts", "signed", "absolute")}
        if both:
            figures["learning_on"] = try_out(model, starts=places, learning=True, report=tell).error_px
        return figures


def run(
    rows: Sequence[ComparisonRow],
    starts: int,
    course: FlightCourse,
    folder: Path,
    report: Callable[[RowMessage], None] | None = None,
) -> list[Summary]:
    """Train and test all, on all cores; what is in the folder already is not done again.

    Args:
        rows: of the table.
        starts: on a side of the grid of starts.
        course: of the laps.
        folder: where models and results are kept.
        report: called with the progress of each job.

    Raises:
        ModelError: of the first job that raises one.
    """
    make_folder(folder)
    jobs = [ComparisonJob(row, seed, starts, course, folder) for row in rows for seed in row.seeds]
    found = side_by_side(ComparisonJob.run, jobs, report=report)
    return [Summary(row, tuple(one for job, one in zip(jobs, found, strict=True) if job.row is row)) for row in rows]


@dataclass(frozen=True, slots=True)
class Summary:
    """What came of a row.

    Attributes:
        row: of the table.
        each: figures of each seed.
    """

    row: ComparisonRow
    each: tuple[Mapping[str, Any], ...] = field(repr=False)

    def mean(self, name: str) -> Any:
        """Mean of a figure over the seeds; None where there is none."""
        found = [one[name] for one in self.each if name in one]
        return np.mean(found, axis=0).tolist() if found else None

    @property
    def course(self) -> FlightCourse:
        """Of the laps."""
        of = self.each[0]["of"]
        return FlightCourse(of["path"], of["test_seed"])

    @property
    def sd(self) -> float | None:
        """Standard deviation of the error between the seeds; None of a single one."""
        errors = [one["error_px"] for one in self.each]
        return float(np.std(errors, ddof=1)) if len(errors) > 1 else None

    def total(self, name: str) -> int:
        """Sum of a figure over the seeds."""
        return int(sum(one[name] for one in self.each))

    def as_words(self) -> dict[str, Any]:
        """As plain data, for JSON."""
        row = self.row
        return {
            "row": row.text, "controller": row.controller, "steps": row.steps, "seeds": list(row.seeds),
            "error_px": self.mean("error_px"), "sd": self.sd, "laps": self.total("laps"),
            "starts": self.total("starts"), "absolute": self.mean("absolute"), "signed": self.mean("signed"),
            "learning_on": self.mean("learning_on"), "each": [dict(one) for one in self.each],
        }  # fmt: skip
