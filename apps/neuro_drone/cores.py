"""Work side by side: jobs in processes of their own, whose reports come back while they run."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from typing import Any, TypeVar

__all__ = ["side_by_side"]

Job = TypeVar("Job")
Done = TypeVar("Done")
Run = Callable[[Job, Callable[[Any], None]], Done]


def side_by_side(
    run: Run[Job, Done], jobs: Sequence[Job], processes: int | None = None, report: Callable[[Any], None] | None = None
) -> list[Done]:
    """Do jobs at the same time; one alone is done in this process.

    An interruption ends all. A process whose parent was killed ends with its next report.

    Args:
        run: does a job, and tells of it by its second argument; a function of a module, as jobs and results it can be
            pickled.
        jobs: what to do.
        processes: at a time; as many as there are cores if not given.
        report: is told all reports, in this process.

    Returns:
        The results, in the order of the jobs.

    Raises:
        Exception: the first that a job raises, once all have ended.
    """
    tell = report or _ignore
    count = min(len(jobs), processes or len(os.sched_getaffinity(0)))
    if count <= 1:
        return [run(job, tell) for job in jobs]
    context = get_context("spawn")
    told = context.SimpleQueue()
    with context.Pool(count, _begin, (told, os.getpid())) as pool:
        found = pool.starmap_async(_do, [(run, job) for job in jobs], chunksize=1)
        while not (found.ready() and told.empty()):
            if told.empty():
                found.wait(0.05)
            else:
                tell(told.get())
        return found.get()


def _ignore(told: Any) -> None:
    pass


_PARENT: list[Any] = []


def _begin(told: Any, parent: int) -> None:
    """Begin a process: keep the way back, and leave Ctrl-C to the parent."""
    _PARENT[:] = told, parent
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _do(run: Run[Job, Done], job: Job) -> Done:
    return run(job, _tell)


def _tell(report: Any) -> None:
    told, parent = _PARENT
    if os.getppid() != parent:
        os._exit(1)
    told.put(report)
