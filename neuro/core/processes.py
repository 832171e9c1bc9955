"""Worker processes of this machine, one job at a time each. A worker that dies is restarted; its job is retried once.

A worker communicates by a pipe, see `neuro.core.worker_process`. Ctrl-C is handled by the parent, and workers end
with the parent, also if it is killed. Each worker has a process group, so that processes forked by a job end with it.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import Pipe, connection, spawn
from typing import Any, TypeAlias, TypeVar

from neuro.core import inputs
from neuro.core.errors import ModelError
from neuro.core.extension import extensions
from neuro.core.system import only_on_linux, usable_cores

TRIES = 2
END_S = 5.0
"""How long a process that has closed its pipe may take to end."""

Tell: TypeAlias = Callable[[Any], None]
"""Function that takes a report of a running job."""

Work: TypeAlias = Callable[[Any, int, Tell], Any]
"""Function of a job, the number of this attempt, and a function to report with; returns the result."""


class Lost(ModelError):
    """A job that is given up: its process ended too often, or exceeded the time limit.

    Attributes:
        how: the end of the last process, in words.
        attempts: number of attempts.
        seconds: duration of the last attempt.
        timed_out: True if the last attempt exceeded the time limit.
    """

    def __init__(self, how: str, attempts: int, seconds: float, timed_out: bool = False) -> None:
        self.how, self.attempts, self.seconds, self.timed_out = how, attempts, seconds, timed_out
        message = f"a process {how}, {attempts} times: it was killed or ran out of memory"
        super().__init__(message, hint="run the same command again to resume")


def _ignore(message: Any) -> None:
    pass


class Task(Future[Any]):
    """A job with the result, the error that the job raised, or `Lost`.

    Attributes:
        job: the job.
        tell: called with each report of the job, by the process that asked.
        attempt: number of attempts so far.
    """

    def __init__(self, job: Any, tell: Tell = _ignore) -> None:
        super().__init__()
        self.job, self.tell, self.attempt = job, tell, 0


class RemoteTraceback(Exception):
    """The traceback of an error in another process, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


loading_script = False
"""Whether this process is one of them, and now runs the script of the process that asked to find what is in it."""


@dataclass(eq=False)
class _Process:
    """A worker process with its task, start and deadline.

    `end` is a descriptor that becomes readable when the process ends; the pipe may be held open by forked processes.
    """

    process: subprocess.Popen[bytes]
    pipe: connection.Connection
    end: int
    has_started: bool = False
    task: Task | None = None
    began: float = field(default_factory=time.monotonic)
    deadline: float = float("inf")


class Processes:
    """Worker processes for jobs; they start when jobs come, and stay until `close`.

    Args:
        begin: function called in each process; it returns the function that runs a job. `begin`, jobs and results
            must be picklable.
        count: largest number of processes.
        seconds: time limit of a job; None for no limit.

    Raises:
        ModelError: a script starts processes outside of its main block, or the system is not Linux.
    """

    def __init__(self, begin: Callable[[], Work], count: int, seconds: float | None = None) -> None:
        if loading_script:
            message = f"{sys.argv[0]}: starts processes wherever it is read, and they read it to find what they run"
            raise ModelError(message, hint='write the call below: if __name__ == "__main__":')
        only_on_linux("work in several processes")
        self._begin, self._count, self._seconds = begin, count, seconds
        self._waiting: deque[Task] = deque()
        self._processes: list[_Process] = []
        self._unborn = 0

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes, and what they work on."""
        for each in self._processes:
            _kill(each)
        while self._processes:
            self._terminate(self._processes[-1])
        self._waiting.clear()

    @property
    def waiting(self) -> int:
        """Number of jobs that no process has begun."""
        return len(self._waiting)

    @property
    def free(self) -> int:
        """Number of further jobs that could begin at once."""
        return self._count - sum(bool(each.task) for each in self._processes) - len(self._waiting)

    @property
    def busy(self) -> bool:
        """True if a job is waiting or running."""
        return bool(self._waiting) or any(each.task for each in self._processes)

    def put(self, job: Any, tell: Tell | None = None) -> Task:
        """Queue a job, and return its task; `tell` is called with each report."""
        task = Task(job, tell or _ignore)
        self._waiting.append(task)
        return task

    def hear(self, seconds: float | None = None) -> list[Task]:
        """Hand jobs out, wait until something is heard of one, and return the tasks that have ended.

        Args:
            seconds: to wait at most; None for as long as it takes, and not at all if there is no job.

        Raises:
            ModelError: no process can begin.
            Exception: that `begin` raises.
        """
        self._hand_out()
        ended: list[Task] = []
        ends: list[Any] = [end for each in self._processes for end in (each.pipe, each.end)]
        signalled = set(connection.wait(ends, self._patience(seconds)))
        for each in list(self._processes):
            if each.pipe in signalled:
                ended += self._receive(each)
            elif each.end in signalled:
                ended += self._receive(each) if each.pipe.poll() else self._retry(each)
        ended += self._end_overdue()
        self._hand_out()
        return ended

    def _hand_out(self) -> None:
        working = sum(bool(each.task) for each in self._processes)
        while len(self._processes) < min(self._count, len(self._waiting) + working):
            self._start()
        for each in self._processes:
            if self._waiting and each.has_started and each.task is None:
                self._ask(each, self._waiting.popleft())

    def _start(self) -> None:
        mine, its = Pipe()
        paths = [os.path.abspath(path) for path in sys.path]
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "neuro.core.worker_process", str(its.fileno())],
            stdin=subprocess.DEVNULL,
            pass_fds=[its.fileno()],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            process_group=0,
        )
        its.close()
        os.environ["NEURO_COMPILING_REPORTED"] = (
            "1"  # this process reports compilation, see `neuro.kernels.compile_report`
        )
        each = _Process(process, mine, os.pidfd_open(process.pid))
        self._processes.append(each)
        script = {word: value for word, value in spawn.get_preparation_data("").items() if word.startswith("init_main")}
        words: dict[str, Any] = {"argv": sys.argv, "paths": paths, "extensions": extensions(), "script": script}
        words |= {
            "python_path": os.environ.get("PYTHONPATH"),
            "begin": pickle.dumps(self._begin),
            "read": inputs.recorded_inputs(),
        }
        _send(each, words)

    def _ask(self, each: _Process, task: Task) -> None:
        each.task, each.began = task, time.monotonic()
        each.deadline = each.began + self._seconds if self._seconds else float("inf")
        task.attempt += 1
        _send(each, (task.attempt, task.job))

    def _receive(self, each: _Process) -> list[Task]:
        try:
            is_, what = pickle.loads(each.pipe.recv_bytes())
        except (EOFError, ConnectionResetError):
            return self._retry(each)
        if is_ in ("refused", "raised"):
            error, trace = what
            error.__cause__ = RemoteTraceback(trace)
            if is_ == "refused":
                raise error
            what = error
        if is_ == "read":
            for name in what:
                inputs.record_input(name)
        elif is_ == "ready":
            each.has_started, self._unborn = True, 0
        elif each.task is not None and is_ == "said":
            each.task.tell(what)
        elif each.task is not None:
            task, each.task, each.deadline = each.task, None, float("inf")
            task.set_result(what) if is_ == "done" else task.set_exception(what)
            return [task]
        return []

    def _retry(self, each: _Process) -> list[Task]:
        """Queue the job of a dead process again; up to `TRIES` attempts, then it is `Lost`."""
        connection.wait([each.end], END_S)  # a pipe is closed a little before
        if each.task is not None and each.task.attempt >= TRIES:
            return self._lose(each)
        how = self._terminate(each)
        if each.task is not None:
            self._waiting.appendleft(each.task)
            return []
        self._unborn += not each.has_started
        if self._unborn >= TRIES:
            raise ModelError(f"a process that should do runs {how} before its first: see above")
        return []

    def _lose(self, each: _Process, timed_out: bool = False) -> list[Task]:
        """End a process and give up its job."""
        seconds, how, task = time.monotonic() - each.began, self._terminate(each), each.task
        assert task is not None
        task.set_exception(Lost(how, task.attempt, seconds, timed_out))
        return [task]

    def _end_overdue(self) -> list[Task]:
        """End the processes whose job exceeds the time limit."""
        now = time.monotonic()
        return [task for each in list(self._processes) if each.deadline < now for task in self._lose(each, True)]

    def _patience(self, seconds: float | None) -> float | None:
        """Until when there is nothing to do but listen."""
        if not self.busy:
            return seconds or 0.0
        first = min((each.deadline for each in self._processes), default=float("inf"))
        most = float("inf") if seconds is None else seconds
        patience = min(most, max(0.0, first - time.monotonic()) + 0.001)
        return None if patience == float("inf") else patience

    def _terminate(self, each: _Process) -> str:
        """Forget a process, which ends if it has not; how it ended, in words."""
        self._processes.remove(each)
        _kill(each)
        each.pipe.close()
        os.close(each.end)
        code = each.process.wait()
        return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"


def _kill(each: _Process) -> None:
    """Kill a process with its whole group, because children may outlive the process."""
    with suppress(ProcessLookupError):
        os.killpg(each.process.pid, signal.SIGKILL)


def _send(each: _Process, what: Any) -> None:
    message = pickle.dumps(what)
    with suppress(BrokenPipeError, ConnectionResetError):  # it has ended, which is heard next
        each.pipe.send_bytes(message)


def cores(threads: int = 1) -> int:
    """Return the number of processes with so many threads for which this process has cores."""
    return max(1, usable_cores() // threads)


Job = TypeVar("Job")
Found = TypeVar("Found")
Run = Callable[[Job, Tell], Found]


def side_by_side(
    run: Run[Job, Found], jobs: Sequence[Job], processes: int | None = None, report: Tell | None = None
) -> list[Found]:
    """Run jobs in parallel on the cores of this machine; a single job runs in this process.

    If a process is killed, a new one runs the job a second time, so a job should continue from a checkpoint.
    An interrupt, or the end of this process, ends all. Files given by `--with` run in the workers, too.

    Args:
        run: function of a job and of a function to report with; a function of a module or script. Jobs, reports and
            results must be picklable.
        jobs: jobs to run.
        processes: processes at a time; by default the number of cores.
        report: called in this process with every report.

    Returns:
        results in the order of the jobs.

    Raises:
        ModelError: the process of a job was killed twice.
        Exception: the first exception of a job, once all jobs have ended.
    """
    count = min(len(jobs), processes or cores())
    if count <= 1:
        return [run(job, report or _ignore) for job in jobs]
    with Processes(partial(_work, run), count) as pool:
        tasks = [pool.put(job, report) for job in jobs]
        while pool.busy:
            pool.hear()
    return [task.result() for task in tasks]


def _work(run: Run[Any, Any]) -> Work:
    return lambda job, attempt, tell: run(job, tell)
