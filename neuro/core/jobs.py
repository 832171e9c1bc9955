"""Jobs side by side: in processes of their own, whose reports come back while they run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

from neuro.core.errors import ModelError
from neuro.core.processes import Done, JobMessage, Processes, Raised, Work, cores

__all__ = ["side_by_side"]

Job = TypeVar("Job")
Found = TypeVar("Found")
Run = Callable[[Job, Callable[[Any], None]], Found]


def side_by_side(
    run: Run[Job, Found], jobs: Sequence[Job], processes: int | None = None, report: Callable[[Any], None] | None = None
) -> list[Found]:
    """Do jobs at the same time on the cores of this machine; one alone is done in this process.

    A process that is killed is started anew and its job tried once more, so a job should go on where it was. An
    interruption ends all, and so does the end of this process, whatever ended it. What was run with `--with` is run in
    the processes, too.

    Args:
        run: does a job, and tells of it by its second argument; a function of a module or of a script, as jobs,
            reports and results it can be pickled.
        jobs: what to do.
        processes: at a time; as many as there are cores if not given.
        report: is told all reports, in this process.

    Returns:
        The results, in the order of the jobs.

    Raises:
        ModelError: a job's process was killed twice.
        Exception: the first that a job raises, once all have ended.
    """
    tell = report or _ignore
    count = min(len(jobs), processes or cores())
    if count <= 1:
        return [run(job, tell) for job in jobs]
    found: dict[int, Found] = {}
    failed: dict[int, BaseException] = {}
    with Processes(partial(_work, run), count) as pool:
        for numbered in enumerate(jobs):
            pool.put(numbered)
        while pool.busy:
            for event in pool.hear():
                number = event.job[0]
                if isinstance(event, JobMessage):
                    tell(event.what)
                elif isinstance(event, Done):
                    found[number] = event.found
                elif isinstance(event, Raised):
                    failed[number] = event.error
                else:
                    message = f"a process {event.how}, {event.attempts} times: it was killed or ran out of memory"
                    failed[number] = ModelError(message, hint="the same command goes on where it was")
    if failed:
        raise failed[min(failed)]
    return [found[number] for number in range(len(jobs))]


def _ignore(told: Any) -> None:
    pass


def _work(run: Run[Any, Any]) -> Work:
    def work(numbered: tuple[int, Any], attempt: int, tell: Callable[[Any], None]) -> Any:
        return run(numbered[1], tell)

    return work
