"""Executors of runs: this process, processes on the cores of this machine, a Dask cluster; with a share for array jobs.

Processes are those of `neuro.core.processes`, see `neuro_sweeps.worker`. A process writes the result of a run to disk
before reporting it. So the folder always names the finished runs, whichever process is killed. A cluster returns only
how runs ended, so losing a scheduler loses no result. A worker of a cluster has a process for each of its threads, so
limits hold there as well.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from os import PathLike
from pathlib import Path
from threading import local
from typing import Any, TypeAlias

import neuro
from neuro import ModelError
from neuro.apps import Quantity, Unwritable, check, cores, needed, processes, provenance, shown
from neuro_sweeps import worker
from neuro_sweeps.definition import Definition
from neuro_sweeps.folder import FAILED, Claims, Folder, RunOutcome, waiting
from neuro_sweeps.network import NetworkRun
from neuro_sweeps.space import RunItem
from neuro_sweeps.worker import KEPT, LOST, TAKEN, Worker

POLL_S = 0.25
"""Interval in seconds at which a process checks runs of other processes."""
HINT = "finished runs are kept: run the same command again to continue"
OnRun = Callable[[str, bool], None]
"""Function that is called with the key of each finished run, and whether it failed."""

ShowMessage = Callable[[str], None]
"""Function that shows a message on the progress bar."""

NextRuns = Callable[[int], Sequence[RunItem]]
"""Function that returns the next runs, up to a number; none if there is nothing to do now."""


class Cores:
    """Worker processes of this machine for the runs of a sweep.

    Args:
        folder: folder of the sweep.
        count: number of processes.
    """

    def __init__(self, folder: Folder, count: int) -> None:
        content = folder.read()
        self._folder = folder
        self._seconds = content["limits"]["seconds"]
        self._inputs = tuple(content["inputs"])
        self._claims = Claims(folder.claims)
        self._processes = processes.Processes(partial(worker.begin, folder.path.absolute()), count, self._seconds)

    def __enter__(self) -> Cores:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes and their runs."""
        self._processes.close()

    def run(
        self,
        items: Iterable[RunItem],
        on_run: OnRun,
        next_runs: NextRuns | None = None,
        show_message: ShowMessage | None = None,
    ) -> None:
        """Do runs, and wait for runs that other processes work on.

        Args:
            items: the runs.
            on_run: called for each finished run.
            next_runs: called for further runs whenever a process is free.
            show_message: called with the processes for which this one waits while it does nothing else.

        Raises:
            ModelError: no process can start, or a run cannot be kept, e.g. on a full disk.
        """
        pool = self._processes
        for item in items:
            pool.put(item)
        waiting_for: list[RunItem] = []
        self._request(waiting_for, next_runs)
        while pool.busy or waiting_for:
            if waiting_for and not pool.waiting:
                waiting_for = self._check_again(waiting_for, on_run)
                if waiting_for and show_message is not None and not pool.busy:
                    show_message(waiting(self._folder.claims, [item.key for item in waiting_for]))
            for event in pool.hear(POLL_S if waiting_for else None):
                self._handle(event, waiting_for, on_run)
            self._request(waiting_for, next_runs)

    def _request(self, waiting_for: list[RunItem], next_runs: NextRuns | None) -> None:
        free = self._processes.free - len(waiting_for)
        for item in next_runs(free) if next_runs is not None and free > 0 else ():
            self._processes.put(item)

    def _check_again(self, waiting_for: list[RunItem], on_run: OnRun) -> list[RunItem]:
        """Return the runs that other processes still work on. Runs that they gave up are queued again."""
        still_claimed = []
        for item in waiting_for:
            if self._report_if_kept(item, on_run):
                continue
            if self._claims.free(item.key):
                self._processes.put(item)
            else:
                still_claimed.append(item)
        return still_claimed

    def _report_if_kept(self, item: RunItem, on_run: OnRun) -> bool:
        outcome = self._folder.outcome(item.key) if self._folder.has(item.key) else None
        if outcome is not None:
            on_run(item.key, outcome.failed)
        return outcome is not None

    def _handle(self, event: processes.Event, waiting_for: list[RunItem], on_run: OnRun) -> None:
        item: RunItem = event.job
        if isinstance(event, processes.Raised):
            raise event.error
        if isinstance(event, processes.Lost):
            if not self._report_if_kept(item, on_run):
                self._fail(event, on_run)
        elif isinstance(event, processes.Done):
            message: dict[str, Any] = event.result
            if message["is"] == LOST:
                raise ModelError(message["error"], hint=HINT)
            if message["is"] == KEPT:
                on_run(item.key, message["failed"])
            elif message["is"] == TAKEN:
                waiting_for.append(item)
            elif not self._report_if_kept(item, on_run):
                self._processes.put(item)

    def _fail(self, lost: processes.Lost, on_run: OnRun) -> None:
        """Keep a run as failed, since its process died too often or exceeded the time limit."""
        item: RunItem = lost.job
        limit = f"time: exceeds the limit of {self._seconds:g} s" if lost.timed_out else ""
        error = limit or f"its process {lost.how}, {lost.attempts} times"
        record = provenance(self._inputs, **({} if item.seed is None else {"seed": item.seed}))
        seconds = round(lost.seconds, 6)
        outcome = RunOutcome(item.key, item.point, item.seed, FAILED, {}, error, "", seconds, lost.attempts, record)
        if self._claims.take(item.key):
            try:
                self._folder.keep(outcome)
            except Unwritable as unwritable:
                raise ModelError(str(unwritable), hint=HINT) from None
            finally:
                self._claims.give_up(item.key)
        on_run(item.key, True)


CONNECT_S = 20.0
"""Seconds to wait for a scheduler, and for a first worker."""
MOST_AT_ONCE = 50
"""Largest number of runs in a task."""

_GONE = "the cluster at {} has stopped"
_thread = local()


def on_cluster(
    where: str, folder: Folder, items: Sequence[RunItem], on_run: OnRun, next_runs: NextRuns | None = None
) -> None:
    """Do runs on the workers of a Dask cluster.

    Args:
        where: address of the scheduler, or the file that the scheduler writes.
        folder: folder of the sweep, which all workers must see.
        items: the runs.
        on_run: called for each finished run.
        next_runs: called for further runs whenever a worker is free.

    Raises:
        ModelError: Dask is not installed; there is no such cluster; the cluster has no worker; a worker does not have
            this version of this package, or does not see the folder.
    """
    client = _client(where)
    try:
        workers = _check_workers(client, where, folder)
        size = max(1, min(MOST_AT_ONCE, len(items) // (4 * max(1, workers))))
        chunks = [list(items[k : k + size]) for k in range(0, len(items), size)]
        if next_runs is not None:
            chunks += [[item] for item in next_runs(max(1, workers))]
        _gather(client, where, folder, chunks, on_run, next_runs)
    finally:
        with suppress(Exception):
            client.close(timeout=2)


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


def _gather(
    client: Any, where: str, folder: Folder, chunks: Sequence[list[RunItem]], on_run: OnRun, next_runs: NextRuns | None
) -> None:
    dask, path = import_module("distributed"), str(folder.path.absolute())

    def submit(chunk: Sequence[RunItem]) -> Any:
        plain = [(item.key, item.point, item.seed, item.trial) for item in chunk]
        return client.submit(do, path, plain, pure=False, retries=2)

    try:
        futures = dask.as_completed([submit(chunk) for chunk in chunks], loop=client.loop)
        for future in futures:
            if future.status == "cancelled":
                raise ModelError(_GONE.format(where), hint=HINT)
            for key, failed in future.result():
                on_run(key, failed)
            for item in next_runs(1) if next_runs is not None else ():
                futures.add(submit([item]))
    except ModelError:
        raise
    except Exception as error:
        kind = type(error).__name__
        if kind in ("CancelledError", "FutureCancelledError", "CommClosedError", "StreamClosedError", "TimeoutError"):
            raise ModelError(_GONE.format(where), hint=HINT) from None
        raise ModelError(f"the cluster at {where}: {kind}: {error}", hint=HINT) from None


def do(path: str, chunk: Sequence[tuple[str, dict[str, Any], int | None, int | None]]) -> list[tuple[str, bool]]:
    """Do some runs on a worker of the cluster, in a process of the present thread.

    Args:
        path: path of the folder.
        chunk: hash, point, seed and trial of each run.

    Returns:
        The hash of each run, and whether it failed.
    """
    finished: list[tuple[str, bool]] = []
    # A thread keeps its process for the next runs of the same folder.
    present: Any = getattr(_thread, "pool", None)
    if present is None or _thread.path != path:
        if present is not None:
            present.close()
        _thread.pool, _thread.path = Cores(Folder(Path(path)), 1), path
    pool: Cores = _thread.pool
    try:
        pool.run([RunItem(*each) for each in chunk], lambda key, failed: finished.append((key, failed)))
    except BaseException:
        pool.close()
        _thread.pool = None
        raise
    return finished


CORES, HERE = "cores", "here"
_PART = re.compile(r"(\d{1,9})/(\d{1,9})")
_WORKERS = Quantity(kind="integer", at_least=1, optional=True)

RunAll: TypeAlias = Callable[[Sequence[RunItem]], None]
"""Function that does runs."""


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

    @property
    def cluster(self) -> bool:
        """True for a Dask cluster."""
        return self.on not in (CORES, HERE)


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


@contextmanager
def runner(
    runs: Definition,
    folder: Folder,
    executor: Executor,
    on_run: OnRun,
    next_runs: NextRuns | None = None,
    *,
    show_message: ShowMessage | None = None,
    wait: bool = True,
) -> Iterator[RunAll]:
    """Yield a function that does given runs, and further ones as long as `next_runs` returns any.

    Args:
        runs: the sweep or search, with the limits of a run.
        folder: folder of the runs.
        executor: place where the runs are done.
        on_run: called for each finished run.
        next_runs: called for further runs whenever a worker is free.
        show_message: called with the processes for which this one waits; not for a cluster.
        wait: for "here": wait for runs that other processes work on, as all other executors do.

    Raises:
        ModelError: there are no such workers, or a run cannot be kept.
    """
    if executor.on == HERE:
        if runs.limits.seconds is not None:  # this process cannot end its own run
            raise ModelError("a time limit needs worker processes: expected on = 'cores'")
        with closing(Worker(folder, runs.run, runs.limits, runs.inputs)) as worker:
            yield _here(worker, folder, on_run, next_runs, show_message, wait)
    elif executor.cluster:
        from neuro_sweeps.executors import on_cluster

        yield lambda items: on_cluster(executor.on, folder, items, on_run, next_runs)
    else:
        threads = runs.run.threads if isinstance(runs.run, NetworkRun) else 1
        with Cores(folder, executor.workers or cores(threads)) as pool:
            yield lambda items: pool.run(items, on_run, next_runs, show_message)


def _here(
    worker: Worker,
    folder: Folder,
    on_run: OnRun,
    next_runs: NextRuns | None,
    show_message: ShowMessage | None,
    wait: bool,
) -> RunAll:
    """Return a function that does runs one after the other in this process."""

    def request() -> Sequence[RunItem]:
        return next_runs(1) if next_runs is not None else ()

    def do(items: Sequence[RunItem]) -> None:
        items = items or request()
        while items:
            for item in items:
                while (message := worker.do(item))["is"] == TAKEN and wait:
                    if show_message is not None:
                        show_message(waiting(folder.claims, [item.key]))
                    time.sleep(POLL_S)
                if message["is"] == LOST:
                    raise ModelError(message["error"], hint=HINT)
                if message["is"] != TAKEN:
                    outcome = folder.outcome(item.key)
                    on_run(item.key, outcome is None or outcome.failed)
            items = request()

    return do
