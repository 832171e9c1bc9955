"""Worker processes of this machine, one job at a time each. A worker that dies is restarted; its job is retried once.

A worker communicates by a pipe, see `neuro.core.worker_process`. The parent handles Ctrl-C. Workers end with the
parent, even if the parent is killed. Each worker leads a process group, so that processes forked by a job end too.
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
"""Largest number of attempts of a job, and of failed starts of processes in a row."""
END_S = 5.0
"""Seconds that a process may take to end after its pipe is closed."""

Tell: TypeAlias = Callable[[Any], None]
"""Function that takes a report of a running job."""

Work: TypeAlias = Callable[[Any, int, Tell], Any]
"""Function of a job, the number of the attempt, and a function that sends reports; returns the result."""


class Lost(ModelError):
    """Error of a job that is not tried again: its process ended too often, or exceeded the time limit.

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
        tell: function called in the parent process with each report of the job.
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
"""Whether this process is a worker that runs the parent's script to load the functions defined there."""


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
    """Worker processes for jobs. A process starts when a job needs it, and stays until `close`.

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
            message = f"{sys.argv[0]}: starts processes when it is imported: expected the call in the main block"
            raise ModelError(message, hint='put the call below: if __name__ == "__main__":')
        only_on_linux("work in several processes")
        self._begin, self._count, self._seconds = begin, count, seconds
        self._waiting: deque[Task] = deque()
        self._processes: list[_Process] = []
        self._failed_starts = 0

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes and their jobs."""
        for worker in self._processes:
            _kill(worker)
        while self._processes:
            self._terminate(self._processes[-1])
        self._waiting.clear()

    @property
    def waiting(self) -> int:
        """Number of jobs in the queue."""
        return len(self._waiting)

    @property
    def free(self) -> int:
        """Number of further jobs that could start immediately."""
        return self._count - sum(bool(worker.task) for worker in self._processes) - len(self._waiting)

    @property
    def busy(self) -> bool:
        """True if a job is waiting or running."""
        return bool(self._waiting) or any(worker.task for worker in self._processes)

    def put(self, job: Any, tell: Tell | None = None) -> Task:
        """Queue a job, and return its task; `tell` is called with each report."""
        task = Task(job, tell or _ignore)
        self._waiting.append(task)
        return task

    def hear(self, seconds: float | None = None) -> list[Task]:
        """Assign waiting jobs, wait for the next message of a process, and return the tasks that have ended.

        Args:
            seconds: longest time to wait; None for no limit. Without jobs the call returns at once.

        Raises:
            ModelError: no process can start.
            Exception: the error of `begin`, if it raised one.
        """
        self._hand_out()
        finished: list[Task] = []
        handles: list[Any] = [end for worker in self._processes for end in (worker.pipe, worker.end)]
        ready_handles = set(connection.wait(handles, self._wait_s(seconds)))
        for worker in list(self._processes):
            if worker.pipe in ready_handles:
                finished += self._receive(worker)
            elif worker.end in ready_handles:
                finished += self._receive(worker) if worker.pipe.poll() else self._retry(worker)
        finished += self._end_overdue()
        self._hand_out()
        return finished

    def _hand_out(self) -> None:
        """Start missing processes, and send waiting jobs to idle processes."""
        working = sum(bool(worker.task) for worker in self._processes)
        while len(self._processes) < min(self._count, len(self._waiting) + working):
            self._start()
        for worker in self._processes:
            if self._waiting and worker.has_started and worker.task is None:
                self._ask(worker, self._waiting.popleft())

    def _start(self) -> None:
        own_end, worker_end = Pipe()
        paths = [os.path.abspath(path) for path in sys.path]
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "neuro.core.worker_process", str(worker_end.fileno())],
            stdin=subprocess.DEVNULL,
            pass_fds=[worker_end.fileno()],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            process_group=0,
        )
        worker_end.close()
        # This process reports compilation for all, see `neuro.kernels.compile_report`.
        os.environ["NEURO_COMPILING_REPORTED"] = "1"
        worker = _Process(process, own_end, os.pidfd_open(process.pid))
        self._processes.append(worker)
        script = {word: value for word, value in spawn.get_preparation_data("").items() if word.startswith("init_main")}
        settings: dict[str, Any] = {"argv": sys.argv, "paths": paths, "extensions": extensions(), "script": script}
        settings |= {
            "python_path": os.environ.get("PYTHONPATH"),
            "begin": pickle.dumps(self._begin),
            "read": inputs.recorded_inputs(),
        }
        _send(worker, settings)

    def _ask(self, worker: _Process, task: Task) -> None:
        """Send the job of a task to a process."""
        worker.task, worker.began = task, time.monotonic()
        worker.deadline = worker.began + self._seconds if self._seconds else float("inf")
        task.attempt += 1
        _send(worker, (task.attempt, task.job))

    def _receive(self, worker: _Process) -> list[Task]:
        """Handle the next message of a process. Return its task if the task has ended."""
        try:
            kind, content = pickle.loads(worker.pipe.recv_bytes())
        except (EOFError, ConnectionResetError):
            return self._retry(worker)
        if kind in ("refused", "raised"):
            error, trace = content
            error.__cause__ = RemoteTraceback(trace)
            if kind == "refused":
                raise error
            content = error
        if kind == "read":
            for name in content:
                inputs.record_input(name)
        elif kind == "ready":
            worker.has_started, self._failed_starts = True, 0
        elif worker.task is not None and kind == "said":
            worker.task.tell(content)
        elif worker.task is not None:
            task, worker.task, worker.deadline = worker.task, None, float("inf")
            task.set_result(content) if kind == "done" else task.set_exception(content)
            return [task]
        return []

    def _retry(self, worker: _Process) -> list[Task]:
        """Queue the job of a dead process again. After `TRIES` attempts the job is `Lost`."""
        connection.wait([worker.end], END_S)  # the pipe closes shortly before the process ends
        if worker.task is not None and worker.task.attempt >= TRIES:
            return self._lose(worker)
        outcome = self._terminate(worker)
        if worker.task is not None:
            self._waiting.appendleft(worker.task)
            return []
        self._failed_starts += not worker.has_started
        if self._failed_starts >= TRIES:
            raise ModelError(f"a worker process {outcome} before its first job: see its output above")
        return []

    def _lose(self, worker: _Process, timed_out: bool = False) -> list[Task]:
        """End a process and give up its job."""
        seconds, outcome, task = time.monotonic() - worker.began, self._terminate(worker), worker.task
        assert task is not None
        task.set_exception(Lost(outcome, task.attempt, seconds, timed_out))
        return [task]

    def _end_overdue(self) -> list[Task]:
        """End the processes whose job exceeds the time limit."""
        now = time.monotonic()
        return [task for worker in list(self._processes) if worker.deadline < now for task in self._lose(worker, True)]

    def _wait_s(self, seconds: float | None) -> float | None:
        """Return the time to wait for a message: until `seconds` or the next deadline; None for no limit."""
        if not self.busy:
            return seconds or 0.0
        next_deadline = min((worker.deadline for worker in self._processes), default=float("inf"))
        limit_s = float("inf") if seconds is None else seconds
        wait_s = min(limit_s, max(0.0, next_deadline - time.monotonic()) + 0.001)
        return None if wait_s == float("inf") else wait_s

    def _terminate(self, worker: _Process) -> str:
        """Kill and remove a process. Return the way it ended, in words."""
        self._processes.remove(worker)
        _kill(worker)
        worker.pipe.close()
        os.close(worker.end)
        code = worker.process.wait()
        return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"


def _kill(worker: _Process) -> None:
    """Kill a process with its whole group, because children may outlive the process."""
    with suppress(ProcessLookupError):
        os.killpg(worker.process.pid, signal.SIGKILL)


def _send(worker: _Process, content: Any) -> None:
    message = pickle.dumps(content)
    with suppress(BrokenPipeError, ConnectionResetError):  # the process has ended; `hear` notices next
        worker.pipe.send_bytes(message)


def cores(threads: int = 1) -> int:
    """Return the number of processes that the usable cores can run, at `threads` threads a process."""
    return max(1, usable_cores() // threads)


Job = TypeVar("Job")
Found = TypeVar("Found")
Run = Callable[[Job, Tell], Found]


def side_by_side(
    run: Run[Job, Found], jobs: Sequence[Job], processes: int | None = None, report: Tell | None = None
) -> list[Found]:
    """Run jobs in parallel on the cores of this machine; a single job runs in this process.

    If a process is killed, a new one runs the job a second time, so a job should continue from a checkpoint.
    An interrupt, or the end of this process, ends all workers. Files given by `--with` run in the workers, too.

    Args:
        run: function of a job and of a function that sends reports, defined in a module or script. Jobs, reports and
            results must be picklable.
        jobs: jobs to run.
        processes: largest number of processes; by default the number of cores.
        report: function called in this process with every report.

    Returns:
        Results in the order of the jobs.

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
