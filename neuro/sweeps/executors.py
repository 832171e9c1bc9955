"""Where runs are done: in this process, on the cores of this machine, on a Dask cluster, as a share of many."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from os import PathLike
from typing import Any, TypeAlias

from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.processes import cores
from neuro.core.quantities import Quantity
from neuro.core.values import shown
from neuro.sweeps.claims import waiting
from neuro.sweeps.cores import HINT, POLL_S, Cores, More, Say, Tell
from neuro.sweeps.definition import Definition
from neuro.sweeps.folder import Folder
from neuro.sweeps.network import NetworkRun
from neuro.sweeps.space import RunItem
from neuro.sweeps.worker import LOST, TAKEN, Worker

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
        with closing(_worker(runs, folder)) as worker:
            yield _here(worker, folder, tell, more, say, wait)
    elif place.cluster:
        from neuro.sweeps.cluster import on_cluster

        yield lambda items: on_cluster(place.on, folder, items, tell, more)
    else:
        threads = runs.run.threads if isinstance(runs.run, NetworkRun) else 1
        with Cores(folder, place.workers or cores(threads)) as pool:
            yield lambda items: pool.run(items, tell, more, say)


def _worker(runs: Definition, folder: Folder) -> Worker:
    """A worker in this process, which cannot end a run that takes too long."""
    if runs.limits.seconds is not None:
        raise ModelError("a limit of time needs a process for each run: expected on = 'cores'")
    return Worker(folder, runs.run, runs.limits, runs.inputs)


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
