"""Places where runs are done: this process, processes of this machine, a Dask cluster; with a share for array jobs.

Processes are those of `neuro.core.processes`, see `neuro_sweeps.worker`. A process writes the result of a run to disk
before reporting it. So the folder always names the finished runs, whichever process is killed. A cluster returns only
how runs ended, so losing a scheduler loses no result. A worker of a cluster has a process for each of its threads, so
limits hold there as well.
"""

from __future__ import annotations

import re
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import local
from typing import Any, Protocol, TypeAlias

import neuro
from neuro import ModelError
from neuro.apps import Quantity, Unwritable, check, cores, needed, processes, provenance, shown
from neuro_sweeps import worker
from neuro_sweeps.definition import Definition
from neuro_sweeps.folder import FAILED, Claims, Folder, RunOutcome, alive, waiting
from neuro_sweeps.network import NetworkRun
from neuro_sweeps.space import RunItem
from neuro_sweeps.worker import HINT, Worker

POLL_S = 0.25
"""Interval in seconds at which a process checks runs of other processes."""

Ended: TypeAlias = Sequence[tuple[RunItem, bool | None]]
"""Runs with whether they failed; None for a run on which another process works."""


class Source(Protocol):
    """Where runs come from: those of a space, or those that a search asks for."""

    def next_runs(self, number: int) -> Sequence[RunItem]:
        """Return runs for so many free workers, or all if they are known; none if there is nothing to do now."""

    def on_run(self, key: str, failed: bool) -> None:
        """Take note of a finished run."""

    def counts(self) -> dict[str, int]:
        """Return the numbers of runs or trials by outcome, and those that are left."""

    def claims_of_others(self) -> Sequence[str]:
        """Return the claims of other processes whose end decides whether there are further runs."""

    def finished(self) -> bool:
        """Return whether there will be no further runs."""

    def close(self) -> None:
        """Release what is unfinished to other processes."""


class Pool(Protocol):
    """A place where runs are done."""

    @property
    def free(self) -> int:
        """Number of further runs that could begin at once."""

    @property
    def busy(self) -> bool:
        """True if a run is waiting or running."""

    def put(self, items: Sequence[RunItem]) -> None:
        """Runs to do."""

    def hear(self, seconds: float | None) -> Ended:
        """Wait until runs have ended, for so many seconds at most, and return them.

        Raises:
            ModelError: no process can start, a run cannot be kept, e.g. on a full disk, or the cluster has stopped.
        """

    def close(self) -> None:
        """End all runs."""


def do_all(
    pool: Pool,
    folder: Folder,
    source: Source,
    on_run: Callable[[str, bool], None],
    show_message: Callable[[str], None],
    wait: bool = True,
) -> None:
    """Do the runs of a source, and wait for runs and trials of other processes.

    Args:
        pool: place where the runs are done.
        folder: folder of the runs.
        source: the runs.
        on_run: called with the key of each finished run, and whether it failed.
        show_message: called with the processes for which this one waits while it does nothing else.
        wait: wait for runs that other processes work on, which may die.

    Raises:
        ModelError: see `Pool.hear`.
    """
    of_others: list[RunItem] = []
    while True:
        if (free := pool.free - len(of_others)) > 0 and (items := source.next_runs(free)):
            pool.put(items)
        if not pool.busy:
            if (not of_others or not wait) and source.finished():
                return
            if claims := [item.key for item in of_others] or source.claims_of_others():
                show_message(waiting(folder.claims, claims))
        for item, failed in pool.hear(None if pool.busy and not of_others else POLL_S):
            if failed is None:
                of_others.append(item)
            else:
                on_run(item.key, failed)
        if pool.free > 0:
            still_claimed = []
            for item in of_others:
                if (outcome := folder.outcome(item.key)) is not None:
                    on_run(item.key, outcome.failed)
                elif alive(folder.claims / item.key):
                    still_claimed.append(item)
                else:
                    pool.put([item])
            of_others = still_claimed


class Here:
    """This process, which does one run after the other.

    Args:
        worker: does a run.
    """

    def __init__(self, worker: Worker) -> None:
        self._worker, self._items, self.close = worker, deque[RunItem](), worker.close

    @property
    def free(self) -> int:
        """1 if there is no run to do."""
        return 1 - len(self._items)

    @property
    def busy(self) -> bool:
        """True if there is a run to do."""
        return bool(self._items)

    def put(self, items: Sequence[RunItem]) -> None:
        """Runs to do."""
        self._items += items

    def hear(self, seconds: float | None) -> Ended:
        """Do a run, or wait if there is none."""
        if not self._items:
            time.sleep(seconds or 0.0)
            return ()
        item = self._items.popleft()
        return [(item, self._worker.do(item))]


class Cores:
    """Worker processes of this machine for the runs of a sweep.

    Args:
        folder: folder of the sweep.
        count: number of processes.
    """

    def __init__(self, folder: Folder, count: int) -> None:
        content = folder.read()
        self.folder, self._inputs, self._seconds = folder, tuple(content["inputs"]), content["limits"]["seconds"]
        self._processes = processes.Processes(partial(worker.begin, folder.path.absolute()), count, self._seconds)
        self.close = self._processes.close

    @property
    def free(self) -> int:
        """Number of further runs that could begin at once."""
        return self._processes.free

    @property
    def busy(self) -> bool:
        """True if a run is waiting or running."""
        return self._processes.busy

    def put(self, items: Sequence[RunItem]) -> None:
        """Runs to do."""
        for item in items:
            self._processes.put(item)

    def hear(self, seconds: float | None) -> Ended:
        """Wait until runs have ended; see `Pool`."""
        return [(task.job, self._failed(task)) for task in self._processes.hear(seconds)]

    def _failed(self, task: processes.Task) -> bool | None:
        """Return whether a run failed. A run whose process died too often or exceeded the time limit is kept so."""
        try:
            failed: bool | None = task.result()
            return failed
        except processes.Lost as lost:
            item, claims = task.job, Claims(self.folder.claims)
            if (kept := self.folder.outcome(item.key)) is not None:
                return kept.failed
            limit = f"time: exceeds the limit of {self._seconds:g} s" if lost.timed_out else ""
            error = limit or f"its process {lost.how}, {lost.attempts} times"
            record = provenance(self._inputs, **({} if item.seed is None else {"seed": item.seed}))
            seconds = round(lost.seconds, 6)
            outcome = RunOutcome(item.key, item.point, item.seed, FAILED, {}, error, "", seconds, lost.attempts, record)
            if not claims.take(item.key):
                return None
            try:
                self.folder.keep(outcome)
            except Unwritable as unwritable:
                raise ModelError(str(unwritable), hint=HINT) from None
            finally:
                claims.give_up(item.key)
            return True


CONNECT_S = 20.0
"""Seconds to wait for a scheduler, and for a first worker."""
MOST_AT_ONCE = 50
"""Largest number of runs in a task."""

_thread = local()


class Cluster:
    """The workers of a Dask cluster.

    Args:
        where: address of the scheduler, or the file that the scheduler writes.
        folder: folder of the sweep, which all workers must see.

    Raises:
        ModelError: Dask is not installed; there is no such cluster; the cluster has no worker; a worker does not have
            this version of this package, or does not see the folder.
    """

    def __init__(self, where: str, folder: Folder) -> None:
        self._where, self._path = where, str(folder.path.absolute())
        self._client = _client(where)
        self._futures: set[Any] = set()
        self._ended: SimpleQueue[Any] = SimpleQueue()
        try:
            self._workers = max(1, _check_workers(self._client, where, folder))
        except BaseException:
            self.close()
            raise

    @property
    def free(self) -> int:
        """Number of threads without a task."""
        return self._workers - len(self._futures)

    @property
    def busy(self) -> bool:
        """True if a task has not ended."""
        return bool(self._futures)

    def put(self, items: Sequence[RunItem]) -> None:
        """Runs to do, several in a task if they are many."""
        size = max(1, min(MOST_AT_ONCE, len(items) // (4 * self._workers)))
        for k in range(0, len(items), size):
            future = self._client.submit(do, self._path, items[k : k + size], pure=False, retries=2)
            self._futures.add(future)
            future.add_done_callback(self._ended.put)

    def hear(self, seconds: float | None) -> Ended:
        """Wait until the runs of a task have ended; see `Pool`."""
        try:
            future = self._ended.get(timeout=seconds)
            self._futures.discard(future)
            if future.status != "cancelled":
                ended: Ended = future.result()
                return ended
        except Empty:
            return ()
        except ModelError:
            raise
        except Exception as error:
            kind = type(error).__name__
            gone = ("CancelledError", "FutureCancelledError", "CommClosedError", "StreamClosedError", "TimeoutError")
            if kind not in gone:
                raise ModelError(f"the cluster at {self._where}: {kind}: {error}", hint=HINT) from None
        raise ModelError(f"the cluster at {self._where} has stopped", hint=HINT)

    def close(self) -> None:
        """Leave the cluster."""
        with suppress(Exception):
            self._client.close(timeout=2)


def _client(where: str) -> Any:
    dask = needed("distributed", "dask", f"on = '{where}': the package distributed is not installed")
    if "://" not in where and not Path(where).is_file():
        expected = "cores, here, tcp://HOST:PORT, or the file of a scheduler"
        raise ModelError(f"on = '{where}': there is no such file: expected {expected}")
    words = {"address": where} if "://" in where else {"scheduler_file": where}
    try:
        return dask.Client(**words, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        text = str(error) or type(error).__name__
        raise ModelError(f"on = '{where}': no scheduler answers: {text.splitlines()[0]}") from None


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


def do(path: str, items: Sequence[RunItem]) -> Ended:
    """Do some runs on a worker of the cluster, in a process of the present thread.

    Args:
        path: path of the folder.
        items: the runs.
    """
    # A thread keeps its process for the next runs of the same folder.
    pool: Cores | None = getattr(_thread, "pool", None)
    if pool is None or str(pool.folder.path) != path:
        if pool is not None:
            pool.close()
        pool = _thread.pool = Cores(Folder(Path(path)), 1)
    ended: list[tuple[RunItem, bool | None]] = []
    try:
        pool.put(items)
        while pool.busy:
            ended += pool.hear(None)
    except BaseException:
        pool.close()
        _thread.pool = None
        raise
    return ended


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


def pool_of(runs: Definition, folder: Folder, executor: Executor) -> Pool:
    """Return the pool of an executor, which has to be closed.

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
    return Cores(folder, executor.workers or cores(threads))
