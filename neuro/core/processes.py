"""Worker processes of this machine, one job at a time each. A worker that dies is restarted; its job is retried once.

They read and write on a pipe of their own, see `neuro.core.worker_process`, leave Ctrl-C to the process that asked, and
end when that does, whatever ended it. Each has a process group of its own, so that what a job forks ends with it.
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

Work: TypeAlias = Callable[[Any, int, Callable[[Any], None]], Any]
"""Does a job: it, the number of this attempt, and what to tell of it meanwhile; gives what comes of it."""


@dataclass(frozen=True, slots=True)
class JobMessage:
    """A job tells something while it is done."""

    job: Any
    what: Any


@dataclass(frozen=True, slots=True)
class Done:
    """A job is done, and this has come of it."""

    job: Any
    found: Any


@dataclass(frozen=True, slots=True)
class Raised:
    """A job has raised an error."""

    job: Any
    error: BaseException


@dataclass(frozen=True, slots=True)
class Lost:
    """A job is given up: its process has ended too often, or it takes longer than it may.

    Attributes:
        job: the job.
        how: its last process ended, in words.
        attempts: how often it was begun.
        seconds: that the last attempt took.
        late: whether it was ended since it took too long.
    """

    job: Any
    how: str
    attempts: int
    seconds: float
    late: bool


Event: TypeAlias = JobMessage | Done | Raised | Lost


class Elsewhere(Exception):
    """Where an error was raised in another process, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


loading_script = False
"""Whether this process is one of them, and now runs the script of the process that asked to find what is in it."""


@dataclass
class _Task:
    """A job, and how often it was begun."""

    job: Any
    attempt: int = 0


@dataclass(eq=False)
class _Process:
    """A process, what it works on, since when and until when.

    Its end is waited for by `end`, a descriptor of it: the pipe may be held open by what it has forked.
    """

    process: subprocess.Popen[bytes]
    pipe: connection.Connection
    end: int
    ready: bool = False
    task: _Task | None = None
    began: float = field(default_factory=time.monotonic)
    deadline: float = float("inf")


class Processes:
    """Processes that do jobs; they are started when there are jobs for them, and stay until this is closed.

    Args:
        begin: is called in each process and gives what does a job there; can be pickled, as jobs and what comes of
            them can.
        count: how many processes at most.
        seconds: that a job may take; None for as long as it likes.

    Raises:
        ModelError: a script asks for them where other processes would do so, too; the system is not Linux.
    """

    def __init__(self, begin: Callable[[], Work], count: int, seconds: float | None = None) -> None:
        if loading_script:
            message = f"{sys.argv[0]}: starts processes wherever it is read, and they read it to find what they run"
            raise ModelError(message, hint='write the call below: if __name__ == "__main__":')
        only_on_linux("work in several processes")
        self._begin, self._count, self._seconds = begin, count, seconds
        self._waiting: deque[_Task] = deque()
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
        """How many jobs no process has begun."""
        return len(self._waiting)

    @property
    def free(self) -> int:
        """How many more jobs could be begun at once."""
        return self._count - sum(bool(each.task) for each in self._processes) - len(self._waiting)

    @property
    def busy(self) -> bool:
        """Whether there is a job that is not done."""
        return bool(self._waiting) or any(each.task for each in self._processes)

    def put(self, job: Any) -> None:
        """A job to do."""
        self._waiting.append(_Task(job))

    def hear(self, seconds: float | None = None) -> list[Event]:
        """Hand jobs out, and wait until something is heard of one.

        Args:
            seconds: to wait at most; None for as long as it takes, and not at all if there is no job.

        Raises:
            ModelError: no process can begin.
            Exception: that `begin` raises.
        """
        self._hand_out()
        events: list[Event] = []
        ends: list[Any] = [end for each in self._processes for end in (each.pipe, each.end)]
        ready = set(connection.wait(ends, self._patience(seconds)))
        for each in list(self._processes):
            if each.pipe in ready:
                events += self._heard(each)
            elif each.end in ready:
                events += self._heard(each) if each.pipe.poll() else self._ended(each)
        events += self._late()
        self._hand_out()
        return events

    def _hand_out(self) -> None:
        working = sum(bool(each.task) for each in self._processes)
        while len(self._processes) < min(self._count, len(self._waiting) + working):
            self._start()
        for each in self._processes:
            if self._waiting and each.ready and each.task is None:
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
        os.environ["NEURO_COMPILING_REPORTED"] = "1"  # one process reports it, see `neuro.kernels.compile_report`
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

    def _ask(self, each: _Process, task: _Task) -> None:
        each.task, each.began = task, time.monotonic()
        each.deadline = each.began + self._seconds if self._seconds else float("inf")
        task.attempt += 1
        _send(each, (task.attempt, task.job))

    def _heard(self, each: _Process) -> list[Event]:
        try:
            is_, what = pickle.loads(each.pipe.recv_bytes())
        except (EOFError, ConnectionResetError):
            return self._ended(each)
        if is_ in ("refused", "raised"):
            error, trace = what
            error.__cause__ = Elsewhere(trace)
            if is_ == "refused":
                raise error
            what = error
        if is_ == "read":
            for name in what:
                inputs.record_input(name)
            return []
        if is_ == "ready":
            each.ready, self._unborn = True, 0
            return []
        assert each.task is not None
        job = each.task.job
        if is_ == "said":
            return [JobMessage(job, what)]
        each.task, each.deadline = None, float("inf")
        return [Done(job, what) if is_ == "done" else Raised(job, what)]

    def _ended(self, each: _Process) -> list[Event]:
        """A process is gone: its job waits again, unless it was tried often enough."""
        connection.wait([each.end], END_S)  # a pipe is closed a little before
        how, task = self._terminate(each), each.task
        if task is None:
            self._unborn += not each.ready
            if self._unborn >= TRIES:
                raise ModelError(f"a process that should do runs {how} before its first: see above")
        elif task.attempt < TRIES:
            self._waiting.appendleft(task)
        else:
            return [Lost(task.job, how, task.attempt, time.monotonic() - each.began, False)]
        return []

    def _late(self) -> list[Event]:
        """End processes whose job takes longer than it may."""
        now, events = time.monotonic(), list[Event]()
        for each in [one for one in self._processes if one.deadline < now]:
            how, task = self._terminate(each), each.task
            assert task is not None
            events.append(Lost(task.job, how, task.attempt, now - each.began, True))
        return events

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
    """End a process and all of its group, which may outlive it."""
    with suppress(ProcessLookupError):
        os.killpg(each.process.pid, signal.SIGKILL)


def _send(each: _Process, what: Any) -> None:
    message = pickle.dumps(what)
    with suppress(BrokenPipeError, ConnectionResetError):  # it has ended, which is heard next
        each.pipe.send_bytes(message)


def cores(threads: int = 1) -> int:
    """How many processes of so many threads the cores are enough for that this one may use."""
    return max(1, usable_cores() // threads)


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
        report: is called with every report, in this process.

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


def _ignore(message: Any) -> None:
    pass


def _work(run: Run[Any, Any]) -> Work:
    def work(numbered: tuple[int, Any], attempt: int, tell: Callable[[Any], None]) -> Any:
        return run(numbered[1], tell)

    return work
