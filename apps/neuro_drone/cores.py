"""Work side by side: jobs in processes of their own, whose reports come back while they run."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

from neuro import ModelError
from neuro.apps import extensions, run_extensions

__all__ = ["side_by_side"]

Job = TypeVar("Job")
Done = TypeVar("Done")
Run = Callable[[Job, Callable[[Any], None]], Done]


def side_by_side(
    run: Run[Job, Done], jobs: Sequence[Job], processes: int | None = None, report: Callable[[Any], None] | None = None
) -> list[Done]:
    """Do jobs at the same time; one alone is done in this process.

    An interruption ends all, and so does the end of this process, whatever ended it.

    Args:
        run: does a job, and tells of it by its second argument; a function of a module, as jobs and results it can be
            pickled.
        jobs: what to do.
        processes: at a time; as many as there are cores if not given.
        report: is told all reports, in this process.

    Returns:
        The results, in the order of the jobs.

    Raises:
        ModelError: a process was killed.
        Exception: the first that a job raises, once all have ended.
    """
    tell = report or _ignore
    count = min(len(jobs), processes or len(os.sched_getaffinity(0)))
    if count <= 1:
        return [run(job, tell) for job in jobs]
    context = get_context("spawn")
    told = context.SimpleQueue()
    others = active_children()
    with ProcessPoolExecutor(count, context, _begin, (told, extensions())) as pool:
        try:
            found = [pool.submit(run, job, _tell) for job in jobs]
            while not (told.empty() and all(one.done() for one in found)):
                if told.empty():
                    wait(found, 0.05)
                else:
                    tell(told.get())
            return [one.result() for one in found]
        except BrokenProcessPool:
            raise ModelError(
                "a process was killed or ran out of memory, so the others were ended",
                hint="the same command goes on where it was",
            ) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                if process not in others:
                    process.terminate()
            raise


def _ignore(told: Any) -> None:
    pass


_TOLD: list[Any] = []


def _begin(told: Any, files: tuple[str, ...]) -> None:
    """Begin a process: keep the way back, leave Ctrl-C to the parent, and end when the parent does."""
    _TOLD[:] = [told]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()
    run_extensions(files)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _tell(report: Any) -> None:
    _TOLD[0].put(report)
