"""A grid of jobs. Each job has a file of results, which ends with a digest. A job with a finished file is skipped."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from neuro.core.outputs import Kind, check_output, kept_json, sealed, write_text
from neuro.core.processes import side_by_side

Result = dict[str, Any]
"""Figures of a job by name, as plain data. The key `of` has all inputs that decide the figures."""


@dataclass(frozen=True, slots=True)
class JobResults:
    """JSON files with the results of jobs.

    A file appears when it is complete. A file that a person edited is never replaced. A job is identified by `of`,
    plain data with all inputs that decide the result: a file with another `of` belongs to another job.

    Attributes:
        what: noun for messages, e.g. "a result of 'neuro drone compare'".
        format: name and version of the content; files of another format are ignored.
    """

    what: str
    format: str

    @property
    def kind(self) -> Kind:
        """Kind of these files, for `check_output`."""
        return sealed(self.what, f'"format": "{self.format}"', ', "digest": "{}"')

    def read(self, path: Path, of: Mapping[str, Any]) -> Result:
        """Return the result of a job; {} if the file is missing, damaged, or belongs to another job or format."""
        result, identity = kept_json(path), {"format": self.format, "of": json.loads(json.dumps(of))}
        result.pop("digest", None)
        return result if result | identity == result else {}

    def write(self, path: Path, of: Mapping[str, Any], figures: Mapping[str, Any]) -> Result:
        """Write the result of a job, and return the result as `read` would; see `neuro.apps.write_text` for errors."""
        text = json.dumps({"format": self.format, "of": dict(of), **figures}, indent=1)
        write_text(path, text, self.kind)
        result: Result = json.loads(text)
        return result

    def of_job(self, path: Path, of: Mapping[str, Any], work: Callable[[], Mapping[str, Any]]) -> Result:
        """Return the result of a job from its file. Without a file, run the job and write the file."""
        if result := self.read(path, of):
            return result
        check_output(path, self.kind)
        return self.write(path, of, work())


class GridJob(Protocol):
    """A job of a grid, which can be pickled."""

    @property
    def file(self) -> Path:
        """Return the file of its result."""

    @property
    def of(self) -> Mapping[str, Any]:
        """Return all inputs that determine the result, as plain data."""

    def work(self, report: Callable[[Any], None]) -> Mapping[str, Any]:
        """Run the job and return its figures by name. With a figure `refused`, no file is written."""


def grid(
    results: JobResults,
    jobs: Sequence[GridJob],
    processes: int | None = None,
    report: Callable[[Any], None] | None = None,
) -> list[Result]:
    """Run the jobs of a grid in parallel, except those with a finished file.

    Args:
        results: files of the results.
        jobs: jobs to run. After a kill, the next call runs only the unfinished jobs.
        processes: number of parallel processes, see `neuro.apps.side_by_side`.
        report: function called with each report of a job, and with None for each existing result.

    Returns:
        Results in the order of the jobs.

    Raises:
        Unwritable: a file cannot be written, or a file of another kind has its name.
        Exception: the errors of `neuro.apps.side_by_side`.
    """
    existing = [results.read(job.file, job.of) for job in jobs]
    for result in existing:
        if result and report:
            report(None)
    to_run = [job for job, result in zip(jobs, existing, strict=True) if not result]
    new_results = iter(side_by_side(partial(_run_job, results), to_run, processes, report))
    return [result or next(new_results) for result in existing]


def _run_job(results: JobResults, job: GridJob, report: Callable[[Any], None]) -> Result:
    check_output(job.file, results.kind)
    figures = job.work(report)
    return dict(figures) if "refused" in figures else results.write(job.file, job.of, figures)
