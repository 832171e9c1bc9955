"""A sweep done: all runs that its folder does not have, and how far it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from neuro.core.progress import Bar
from neuro.core.provenance import provenance
from neuro.sweeps.definition import RunItem, Sweep
from neuro.sweeps.executors import Executor, doing
from neuro.sweeps.folder import Folder


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
    place: Executor,
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
        with doing(sweep, folder, place, tell, say=None if bar is None else bar.say, wait=False) as do:
            do(left)
    return count


def _of_part(items: Sequence[RunItem], part: tuple[int, int] | None) -> Sequence[RunItem]:
    return items if part is None else [item for k, item in enumerate(items, 1) if k % part[1] == part[0]]


__all__ = ["Count", "execute"]
