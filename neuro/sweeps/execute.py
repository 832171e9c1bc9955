"""A sweep done, wherever it runs: in this process, on the cores of this machine, on a Dask cluster, as part of many."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.processes import cores
from neuro.core.progress import Bar
from neuro.core.provenance import provenance
from neuro.core.values import shown
from neuro.sweeps.cores import Cores
from neuro.sweeps.definition import Item, Sweep
from neuro.sweeps.folder import Folder
from neuro.sweeps.network import NetworkRun
from neuro.sweeps.worker import LOST, TAKEN, Worker

CORES, HERE = "cores", "here"
_PART = re.compile(r"(\d{1,9})/(\d{1,9})")


@dataclass(frozen=True, slots=True)
class Place:
    """Where runs are done.

    Attributes:
        on: "cores", "here", the address of a Dask scheduler, or the file that names one.
        workers: how many processes; as many as there are cores if None.
        part: (i, n): only the runs that are the i-th of each n.
    """

    on: str = CORES
    workers: int | None = None
    part: tuple[int, int] | None = None

    @property
    def cluster(self) -> bool:
        """Whether it is a Dask cluster."""
        return self.on not in (CORES, HERE)


@dataclass
class Count:
    """How far a sweep is.

    Attributes:
        total, done, failed: runs.
    """

    total: int
    done: int = 0
    failed: int = 0

    @property
    def left(self) -> int:
        """Runs that are not there yet."""
        return self.total - self.done - self.failed

    def __str__(self) -> str:
        return f"{self.done:,} done, {self.failed:,} failed, {self.left:,} left"


def execute(
    sweep: Sweep,
    folder: Folder,
    place: Place = Place(),
    *,
    retry: bool = False,
    bar: Bar | None = None,
    hear: Callable[[str], None] | None = None,
) -> Count:
    """Do all runs of a sweep that its folder does not have.

    Args:
        sweep: the sweep.
        folder: where runs are kept; made if it is not there.
        place: where they are done.
        retry: whether to do those again that failed.
        bar: shows how far it is.
        hear: is told the key of each run when it is there.

    Raises:
        ModelError: the folder is another's, cannot be written, or there are no such workers.
    """
    told = sweep.told()
    told |= {"inputs": list(sweep.inputs), "provenance": provenance(sweep.inputs)}
    folder.begin(told, "digest_of_runs", "same")
    items = _of_part(sweep.items, place.part)
    there = folder.outcomes(item.key for item in items)
    if retry:
        for key in [key for key, outcome in there.items() if outcome.failed]:
            folder.forget(key)
            del there[key]
    count = Count(len(items), sum(not o.failed for o in there.values()), sum(o.failed for o in there.values()))
    left = [item for item in items if item.key not in there]
    before = count.done + count.failed

    def tell(key: str, failed: bool) -> None:
        count.failed += failed
        count.done += not failed
        if bar is not None:
            bar.show(count.done + count.failed - before, count.total - before, str(count))
        if hear is not None:
            hear(key)

    if bar is not None:
        bar.say(str(count))
    if left:
        _do(sweep, folder, place, left, tell)
    return count


def _do(sweep: Sweep, folder: Folder, place: Place, left: Sequence[Item], tell: Callable[[str, bool], None]) -> None:
    if place.on == HERE:
        _here(sweep, folder, left, tell)
    elif place.cluster:
        from neuro.sweeps.cluster import on_cluster

        on_cluster(place.on, folder, left, tell)
    else:
        threads = sweep.run.threads if isinstance(sweep.run, NetworkRun) else 1
        with Cores(folder, place.workers or cores(threads)) as pool:
            pool.run(left, tell)


def _here(sweep: Sweep, folder: Folder, items: Sequence[Item], tell: Callable[[str, bool], None]) -> None:
    """One after the other in this process, which cannot end a run that takes too long."""
    if sweep.limits.seconds is not None:
        raise ModelError("a limit of time needs a process for each run: expected on = 'cores'")
    with closing(Worker(folder, sweep.run, sweep.limits, sweep.inputs)) as worker:
        for item in items:
            told = worker.do(item)
            if told["is"] == LOST:
                raise ModelError(told["error"], hint="what was done is kept: the same command goes on")
            if told["is"] != TAKEN:
                outcome = folder.outcome(item.key)
                tell(item.key, outcome is None or outcome.failed)


def part_of(text: Any) -> tuple[int, int]:
    """The part that a text says: `3/100` is the third of each hundred runs, `0/100` and `100/100` the last.

    Raises:
        ModelError: it says none.
    """
    found = _PART.fullmatch(text) if isinstance(text, str) else None
    if found is None or not int(found[2]) or int(found[1]) > int(found[2]):
        raise ModelError(f"part = {shown(text)}: expected I/N, with I from 0 to N, such as 3/100")
    return int(found[1]) % int(found[2]), int(found[2])


def _of_part(items: Sequence[Item], part: tuple[int, int] | None) -> Sequence[Item]:
    return items if part is None else [item for k, item in enumerate(items, 1) if k % part[1] == part[0]]


__all__ = ["CORES", "HERE", "Count", "Place", "execute", "part_of"]
