"""Places where runs are done: this process, processes of this machine, or a Dask cluster; and shares for array jobs.

Processes are those of `neuro.core.processes`, see `neuro_sweeps.worker`. A process writes the result of a run to disk
before reporting it. So the folder always names the finished runs, whichever process is killed. A cluster only returns
whether runs failed, so no result is lost with a scheduler. A worker of a cluster has a process for each of its threads,
so limits hold there as well.
"""

from __future__ import annotations

import re
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import local
from typing import Any

import neuro
from neuro import ModelError
from neuro.apps import Quantity, Unwritable, check, cores, needed, processes, provenance, shown
from neuro_sweeps import worker
from neuro_sweeps.definition import Runs
from neuro_sweeps.folder import FAILED, Claims, Folder, RunOutcome
from neuro_sweeps.network import NetworkRun
from neuro_sweeps.space import RunItem
from neuro_sweeps.worker import HINT, Worker


def ends_of(folder: Folder, task: processes.Task) -> list[bool | None]:
    """Return for each run of a task whether it failed, or None if another process works on the run.

    A run whose process died too often or exceeded the time limit is saved as failed.

    Raises:
        ModelError: a run cannot be kept, e.g. on a full disk.
    """
    try:
        ends: list[bool | None] = task.result()
        return ends
    except processes.Lost as lost:
        (item,), claims, content = task.job, Claims(folder.claims), folder.read()
        if (outcome := folder.outcome(item.key)) is not None:
            return [outcome.failed]
        if not claims.take(item.key):
            return [None]
        limit = f"time: exceeds the limit of {content['limits']['seconds']:g} s" if lost.timed_out else ""
        error = limit or f"its process {lost.how}, {lost.attempts} times"
        record = provenance(content["inputs"], **({} if item.seed is None else {"seed": item.seed}))
        figures: Any = (FAILED, {}, error, "", round(lost.seconds, 6), lost.attempts, record)
        try:
            folder.keep(RunOutcome(item.key, item.point, item.seed, *figures))
        except Unwritable as unwritable:
            raise ModelError(str(unwritable), hint=HINT) from None
        finally:
            claims.give_up(item.key)
        return [True]


class Here:
    """This process as the place of runs, with the methods of `Processes`. Jobs are done one after the other.

    Args:
        worker: worker that does the runs.
    """

    def __init__(self, worker: Worker) -> None:
        self._worker, self._tasks, self.close = worker, deque[processes.Task](), worker.close

    @property
    def free(self) -> int:
        """1 if there is no job to do."""
        return 1 - len(self._tasks)

    @property
    def busy(self) -> bool:
        """True if there is a job to do."""
        return bool(self._tasks)

    def put(self, job: Sequence[RunItem]) -> None:
        """Add a job: runs to do."""
        self._tasks.append(processes.Task(job))

    def hear(self, seconds: float | None) -> list[processes.Task]:
        """Do a job, or wait if there is none."""
        if not self._tasks:
            time.sleep(seconds or 0.0)
            return []
        task = self._tasks.popleft()
        task.set_result([self._worker.do(item) for item in task.job])
        return [task]


CONNECT_S = 20.0
"""Seconds to wait for a scheduler, and for a first worker."""
MOST_AT_ONCE = 50
"""Largest number of runs in a job of a cluster."""

# Names of the errors of Dask for a cluster that has stopped.
_STOPPED = ("CancelledError", "FutureCancelledError", "CommClosedError", "StreamClosedError", "TimeoutError")
_thread = local()


class Cluster:
    """The workers of a Dask cluster as the place of runs, with the methods of `Processes`.

    Args:
        address: address of the scheduler, or the file that the scheduler writes.
        folder: folder of the sweep, which all workers must see.

    Raises:
        ModelError: Dask is not installed; there is no such cluster; the cluster has no worker; a worker does not have
            this version of this package, or does not see the folder.
    """

    def __init__(self, address: str, folder: Folder) -> None:
        self._where, self._path = address, str(folder.path.absolute())
        self._client = _client(address)
        self._jobs: dict[Any, Sequence[RunItem]] = {}
        self._ended: SimpleQueue[Any] = SimpleQueue()
        try:
            self._workers = max(1, _check_workers(self._client, address, folder))
        except BaseException:
            self.close()
            raise

    @property
    def free(self) -> int:
        """Number of threads without a job."""
        return self._workers - len(self._jobs)

    @property
    def busy(self) -> bool:
        """True if a job has not ended."""
        return bool(self._jobs)

    def put(self, job: Sequence[RunItem]) -> None:
        """Submit a job: runs that a worker does one after the other."""
        future = self._client.submit(do, self._path, job, pure=False, retries=2)
        self._jobs[future] = job
        future.add_done_callback(self._ended.put)

    def hear(self, seconds: float | None) -> list[processes.Task]:
        """Wait until a job has ended.

        Raises:
            ModelError: the cluster has stopped, or a run cannot be kept.
        """
        try:
            future = self._ended.get(timeout=seconds)
            task = processes.Task(self._jobs.pop(future))
            if future.status != "cancelled":
                task.set_result(future.result())
                return [task]
        except Empty:
            return []
        except ModelError:
            raise
        except Exception as error:
            kind = type(error).__name__
            if kind not in _STOPPED:
                raise ModelError(f"the cluster at {self._where}: {kind}: {error}", hint=HINT) from None
        raise ModelError(f"the cluster at {self._where} has stopped", hint=HINT)

    def close(self) -> None:
        """Leave the cluster."""
        with suppress(Exception):
            self._client.close(timeout=2)


def _client(address: str) -> Any:
    dask = needed("distributed", "dask", f"on = '{address}': the package distributed is not installed")
    if "://" not in address and not Path(address).is_file():
        expected = "cores, here, tcp://HOST:PORT, or the file of a scheduler"
        raise ModelError(f"on = '{address}': there is no such file: expected {expected}")
    arguments = {"address": address} if "://" in address else {"scheduler_file": address}
    try:
        return dask.Client(**arguments, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        text = str(error) or type(error).__name__
        raise ModelError(f"on = '{address}': no scheduler answers: {text.splitlines()[0]}") from None


def _check_workers(client: Any, where: str, folder: Folder) -> int:
    """Check that all workers can do runs, and return the number of their threads."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise ModelError(f"on = '{where}': the cluster has no worker") from None
    path, file = str(folder.path.absolute()), folder.kind.file

    def look() -> tuple[str, str, bool]:  # nested, so Dask sends its code: workers may lack this module
        import os

        try:
            import neuro
        except ImportError as error:
            return "", f"{error} ({sys.executable})", False
        try:
            import neuro_sweeps.executors  # noqa: F401
        except ImportError:
            return neuro.__version__, "", False
        return neuro.__version__, "", os.path.isfile(os.path.join(path, file))

    for address, (version, error, sees_folder) in sorted(client.run(look).items()):
        if error:
            hint = f"install neuro {neuro.__version__} where the workers run"
            raise ModelError(f"the worker {address} has no neuro: {error}", hint=hint)
        if version != neuro.__version__:
            raise ModelError(f"the worker {address} has neuro {version}: expected {neuro.__version__}, as here")
        if not sees_folder:
            message = f"the worker {address} does not see {path}"
            raise ModelError(message, hint="runs are kept in the folder: choose a folder that all machines share")
    return sum(client.nthreads().values())


def do(path: str, items: Sequence[RunItem]) -> list[bool | None]:
    """Do some runs on a worker of the cluster, in a process of the present thread; see `ends_of`."""
    # A thread keeps its process for the next runs of the same folder.
    folder, (kept_path, pool) = Folder(Path(path)), getattr(_thread, "pool", ("", None))
    if pool is None or kept_path != path:
        if pool is not None:
            pool.close()
        pool = processes_of(folder, 1)
        _thread.pool = path, pool
    try:
        tasks = [pool.put([item]) for item in items]
        while pool.busy:
            pool.hear()
        return [end for task in tasks for end in ends_of(folder, task)]
    except BaseException:
        pool.close()
        del _thread.pool
        raise


def processes_of(folder: Folder, count: int) -> processes.Processes:
    """Return worker processes of this machine for the runs of a folder."""
    seconds = folder.read()["limits"]["seconds"]
    return processes.Processes(partial(worker.begin, folder.path.absolute()), count, seconds)


CORES, HERE = "cores", "here"
_PART = re.compile(r"(\d{1,9})/(\d{1,9})")
_WORKERS = Quantity(kind="integer", at_least=1, optional=True)


@dataclass(frozen=True, slots=True)
class Executor:
    """The place where runs are done.

    Attributes:
        on: "cores", "here", the address of a Dask scheduler, or the file of one.
        workers: number of processes; None for the number of cores.
        share: (i, n): do only the i-th of every n runs; None for all runs.
    """

    on: str = CORES
    workers: int | None = None
    share: tuple[int, int] | None = None


def executor_of(on: str | PathLike[str], workers: int | None = None, share: str | None = None) -> Executor:
    """Return the executor for the arguments of a call or a command.

    Args:
        on: "cores", "here", the address of a Dask scheduler, or the file of one.
        workers: number of processes, at least 1; None for the number of cores.
        share: "3/100" for the third of every hundred runs; "0/100" and "100/100" for the last.

    Raises:
        ModelError: an argument is invalid.
    """
    return Executor(str(on), check(_WORKERS, workers, "workers"), None if share is None else _share_of(share))


def _share_of(text: Any) -> tuple[int, int]:
    match = _PART.fullmatch(text) if isinstance(text, str) else None
    if match is None or not int(match[2]) or int(match[1]) > int(match[2]):
        raise ModelError(f"share = {shown(text)}: expected I/N, with I from 0 to N, such as 3/100")
    return int(match[1]) % int(match[2]), int(match[2])


def pool_of(runs: Runs, folder: Folder, executor: Executor) -> processes.Processes | Here | Cluster:
    """Return the pool that does the runs at the executor's place. The caller closes it.

    Args:
        runs: the sweep or search, with the limits of a run.
        folder: folder of the runs.
        executor: place where the runs are done.

    Raises:
        ModelError: there are no such workers.
    """
    if executor.on == HERE:
        if runs.limits.seconds is not None:  # this process cannot end its own run
            raise ModelError("a time limit needs worker processes: expected on = 'cores'")
        return Here(Worker(folder, runs.run, runs.limits, runs.inputs))
    if executor.on != CORES:
        return Cluster(executor.on, folder)
    threads = runs.run.threads if isinstance(runs.run, NetworkRun) else 1
    return processes_of(folder, executor.workers or cores(threads))
