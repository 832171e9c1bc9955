"""Where runs are done: in this process, on the cores of this machine, on a Dask cluster, as a share of many.

Processes are those of `neuro.core.processes`, see `neuro_sweeps.worker`. The result of a run is on disk before its
process reports it. So whatever is killed, the folder says what is done, and a process that goes on asks the folder.
What comes back from a cluster only says how runs ended, so a scheduler that is lost loses nothing. A worker of a
cluster does its runs in a process of its own for each of its threads, so limits hold there, too.
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
HINT = "what was done is kept: the same command goes on"
Tell = Callable[[str, bool], None]
"""Gets the key of each run that is there, and whether it failed."""

Say = Callable[[str], None]
"""Hears what is going on."""

More = Callable[[int], Sequence[RunItem]]
"""Gives up to so many runs that are next; none where there is nothing to do now."""


class Cores:
    """Processes that do runs of the sweep in a folder.

    Args:
        folder: of the sweep.
        count: how many processes.
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
        """End all processes, and what they work on."""
        self._processes.close()

    def run(self, items: Iterable[RunItem], tell: Tell, more: More | None = None, say: Say | None = None) -> None:
        """Do runs, and wait for those that others work on.

        Args:
            items: the runs.
            tell: hears of each when it is there.
            more: is asked for others whenever a process has nothing to do.
            say: hears for whom it waits while nothing else is done.

        Raises:
            ModelError: no process can begin, or a run cannot be kept, as on a full disk.
        """
        pool = self._processes
        for item in items:
            pool.put(item)
        elsewhere: list[RunItem] = []
        self._add(elsewhere, more)
        while pool.busy or elsewhere:
            if elsewhere and not pool.waiting:
                elsewhere = self._look_again(elsewhere, tell)
                if elsewhere and say is not None and not pool.busy:
                    say(waiting(self._folder.claims, [item.key for item in elsewhere]))
            for event in pool.hear(POLL_S if elsewhere else None):
                self._heard(event, elsewhere, tell)
            self._add(elsewhere, more)

    def _add(self, elsewhere: list[RunItem], more: More | None) -> None:
        free = self._processes.free - len(elsewhere)
        for item in more(free) if more is not None and free > 0 else ():
            self._processes.put(item)

    def _look_again(self, elsewhere: list[RunItem], tell: Tell) -> list[RunItem]:
        """Those that another process still works on; what was given up waits again."""
        still = []
        for item in elsewhere:
            if self._there(item, tell):
                continue
            if self._claims.free(item.key):
                self._processes.put(item)
            else:
                still.append(item)
        return still

    def _there(self, item: RunItem, tell: Tell) -> bool:
        outcome = self._folder.outcome(item.key) if self._folder.has(item.key) else None
        if outcome is not None:
            tell(item.key, outcome.failed)
        return outcome is not None

    def _heard(self, event: processes.Event, elsewhere: list[RunItem], tell: Tell) -> None:
        item: RunItem = event.job
        if isinstance(event, processes.Raised):
            raise event.error
        if isinstance(event, processes.Lost):
            if not self._there(item, tell):
                self._fail(event, tell)
        elif isinstance(event, processes.Done):
            message: dict[str, Any] = event.result
            if message["is"] == LOST:
                raise ModelError(message["error"], hint=HINT)
            if message["is"] == KEPT:
                tell(item.key, message["failed"])
            elif message["is"] == TAKEN:
                elsewhere.append(item)
            elif not self._there(item, tell):
                self._processes.put(item)

    def _fail(self, lost: processes.Lost, tell: Tell) -> None:
        """Keep a run as failed whose process has ended too often, or was ended."""
        item: RunItem = lost.job
        limit = f"time: takes longer than the limit of {self._seconds:g} s" if lost.late else ""
        error = limit or f"its process {lost.how}, {lost.attempts} times"
        record = provenance(self._inputs, **({} if item.seed is None else {"seed": item.seed}))
        taken = round(lost.seconds, 6)
        outcome = RunOutcome(item.key, item.point, item.seed, FAILED, {}, error, "", taken, lost.attempts, record)
        if self._claims.take(item.key):
            try:
                self._folder.keep(outcome)
            except Unwritable as full:
                raise ModelError(str(full), hint=HINT) from None
            finally:
                self._claims.give_up(item.key)
        tell(item.key, True)


CONNECT_S = 20.0
MOST_AT_ONCE = 50
"""Runs of one task."""

_GONE = "the cluster at {} is gone"
_mine = local()


def on_cluster(where: str, folder: Folder, items: Sequence[RunItem], tell: Tell, more: More | None = None) -> None:
    """Do runs on the workers of a cluster.

    Args:
        where: the address of its scheduler, or the file that the scheduler writes.
        folder: of the sweep, which all workers must see.
        items: the runs.
        tell: hears of each when it is there.
        more: is asked for others whenever a worker has nothing to do.

    Raises:
        ModelError: Dask is not installed, there is no such cluster, it has no worker, or its workers have not this
            package in this version, or do not see the folder.
    """
    client = _client(where)
    try:
        workers = _checked(client, where, folder)
        size = max(1, min(MOST_AT_ONCE, len(items) // (4 * max(1, workers))))
        chunks = [list(items[k : k + size]) for k in range(0, len(items), size)]
        if more is not None:
            chunks += [[item] for item in more(max(1, workers))]
        _gather(client, where, folder, chunks, tell, more)
    finally:
        with suppress(Exception):
            client.close(timeout=2)


def _client(where: str) -> Any:
    dask = needed("distributed", "dask", f"on = '{where}': the package distributed is not installed")
    if "://" not in where and not Path(where).is_file():
        known = "cores, here, tcp://HOST:PORT, or the file of a scheduler"
        raise ModelError(f"on = '{where}': there is no such file: expected {known}")
    words = {"address": where} if "://" in where else {"scheduler_file": where}
    try:
        return dask.Client(**words, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        text = str(error) or type(error).__name__
        raise ModelError(f"on = '{where}': no scheduler answers: {text.splitlines()[0]}") from None


def _checked(client: Any, where: str, folder: Folder) -> int:
    """How many threads all workers have, once they are known to be able to do runs."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise ModelError(f"on = '{where}': the cluster has no worker") from None
    path, file = str(folder.path.absolute()), folder.holding.file

    def look() -> tuple[str, str, bool]:  # nested, so that it is sent by value: workers may not have this module
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

    for address, (version, error, seen) in sorted(client.run(look).items()):
        if error:
            hint = "install this package where the workers run, in the version that is here"
            raise ModelError(f"the worker {address} has no neuro: {error}", hint=hint)
        if version != neuro.__version__:
            raise ModelError(f"the worker {address} has neuro {version}: expected {neuro.__version__}, as here")
        if not seen:
            message = f"the worker {address} does not see {path}"
            raise ModelError(message, hint="runs are kept in the folder: expected one that all machines share")
    return sum(client.nthreads().values())


def _gather(
    client: Any, where: str, folder: Folder, chunks: Sequence[list[RunItem]], tell: Tell, more: More | None
) -> None:
    dask, path = import_module("distributed"), str(folder.path.absolute())

    def submitted(chunk: Sequence[RunItem]) -> Any:
        plain = [(item.key, item.point, item.seed, item.trial) for item in chunk]
        return client.submit(do, path, plain, pure=False, retries=2)

    try:
        under_way = dask.as_completed([submitted(chunk) for chunk in chunks], loop=client.loop)
        for done in under_way:
            if done.status == "cancelled":
                raise ModelError(_GONE.format(where), hint=HINT)
            for key, failed in done.result():
                tell(key, failed)
            for item in more(1) if more is not None else ():
                under_way.add(submitted([item]))
    except ModelError:
        raise
    except Exception as error:
        kind = type(error).__name__
        if kind in ("CancelledError", "FutureCancelledError", "CommClosedError", "StreamClosedError", "TimeoutError"):
            raise ModelError(_GONE.format(where), hint=HINT) from None
        raise ModelError(f"the cluster at {where}: {kind}: {error}", hint=HINT) from None


def do(path: str, chunk: Sequence[tuple[str, dict[str, Any], int | None, int | None]]) -> list[tuple[str, bool]]:
    """What a worker of the cluster does: some runs, in a process of its own.

    Args:
        path: of the folder.
        chunk: hash, point, seed and trial of each run.

    Returns:
        The hash of each and whether it failed.
    """
    done: list[tuple[str, bool]] = []
    # The process of this thread for a folder.
    held: Any = getattr(_mine, "pool", None)
    if held is None or _mine.path != path:
        if held is not None:
            held.close()
        _mine.pool, _mine.path = Cores(Folder(Path(path)), 1), path
    pool: Cores = _mine.pool
    try:
        pool.run([RunItem(*each) for each in chunk], lambda key, failed: done.append((key, failed)))
    except BaseException:
        pool.close()
        _mine.pool = None
        raise
    return done


CORES, HERE = "cores", "here"
_PART = re.compile(r"(\d{1,9})/(\d{1,9})")
_WORKERS = Quantity(kind="integer", at_least=1, optional=True)

Do: TypeAlias = Callable[[Sequence[RunItem]], None]
"""Does runs."""


@dataclass(frozen=True, slots=True)
class Executor:
    """Where runs are done.

    Attributes:
        on: "cores", "here", the address of a Dask scheduler, or the file that names one.
        workers: how many processes; as many as there are cores if None.
        share: (i, n): only the runs that are the i-th of each n.
    """

    on: str = CORES
    workers: int | None = None
    share: tuple[int, int] | None = None

    @property
    def cluster(self) -> bool:
        """Whether it is a Dask cluster."""
        return self.on not in (CORES, HERE)


def place_of(on: str | PathLike[str], workers: int | None = None, share: str | None = None) -> Executor:
    """Where runs are done, from what a call or a command says.

    Args:
        on: "cores", "here", the address of a Dask scheduler, or the file that names one.
        workers: how many processes, at least 1; as many as there are cores if None.
        share: `3/100` is the third of each hundred runs, `0/100` and `100/100` the last.

    Raises:
        ModelError: there can be no such workers, or it says no share.
    """
    return Executor(str(on), check(_WORKERS, workers, "workers"), None if share is None else _share_of(share))


def _share_of(text: Any) -> tuple[int, int]:
    found = _PART.fullmatch(text) if isinstance(text, str) else None
    if found is None or not int(found[2]) or int(found[1]) > int(found[2]):
        raise ModelError(f"share = {shown(text)}: expected I/N, with I from 0 to N, such as 3/100")
    return int(found[1]) % int(found[2]), int(found[2])


@contextmanager
def doing(
    runs: Definition,
    folder: Folder,
    place: Executor,
    tell: Tell,
    more: More | None = None,
    *,
    say: Say | None = None,
    wait: bool = True,
) -> Iterator[Do]:
    """What does runs at a place: those that it is given, and more as long as there are any.

    Args:
        runs: what is run, with which limits.
        folder: where runs are kept.
        place: where they are done.
        tell: hears of each when it is there.
        more: is asked for others whenever there is nothing to do.
        say: hears for whom it waits; not from a cluster.
        wait: whether this process, where it is the place, waits for runs that others work on, as all other places do.

    Raises:
        ModelError: there are no such workers, or a run cannot be kept.
    """
    if place.on == HERE:
        # A worker in this process, which cannot end a run that takes too long.
        if runs.limits.seconds is not None:
            raise ModelError("a limit of time needs a process for each run: expected on = 'cores'")
        with closing(Worker(folder, runs.run, runs.limits, runs.inputs)) as worker:
            yield _here(worker, folder, tell, more, say, wait)
    elif place.cluster:
        from neuro_sweeps.executors import on_cluster

        yield lambda items: on_cluster(place.on, folder, items, tell, more)
    else:
        threads = runs.run.threads if isinstance(runs.run, NetworkRun) else 1
        with Cores(folder, place.workers or cores(threads)) as pool:
            yield lambda items: pool.run(items, tell, more, say)


def _here(worker: Worker, folder: Folder, tell: Tell, more: More | None, say: Say | None, wait: bool) -> Do:
    """One after the other in this process."""

    def next_ones() -> Sequence[RunItem]:
        return more(1) if more is not None else ()

    def do(items: Sequence[RunItem]) -> None:
        items = items or next_ones()
        while items:
            for item in items:
                while (message := worker.do(item))["is"] == TAKEN and wait:
                    if say is not None:
                        say(waiting(folder.claims, [item.key]))
                    time.sleep(POLL_S)
                if message["is"] == LOST:
                    raise ModelError(message["error"], hint=HINT)
                if message["is"] != TAKEN:
                    outcome = folder.outcome(item.key)
                    tell(item.key, outcome is None or outcome.failed)
            items = next_ones()

    return do
