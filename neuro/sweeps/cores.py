"""Runs in processes of this machine, see `neuro.core.processes` and `neuro.sweeps.worker`.

What comes of a run is on disk before its process tells that it is. So whatever is killed, the folder says what is done,
and a process that goes on asks the folder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.outputs import Unwritable
from neuro.core.processes import Done, Event, Lost, Processes, Raised
from neuro.core.provenance import provenance
from neuro.sweeps import worker
from neuro.sweeps.claims import Claims, waiting
from neuro.sweeps.folder import FAILED, Folder, RunOutcome
from neuro.sweeps.space import RunItem
from neuro.sweeps.worker import KEPT, LOST, TAKEN

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
        self._processes = Processes(partial(worker.begin, folder.path.absolute()), count, self._seconds)

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

    def _heard(self, event: Event, elsewhere: list[RunItem], tell: Tell) -> None:
        item: RunItem = event.job
        if isinstance(event, Raised):
            raise event.error
        if isinstance(event, Lost):
            if not self._there(item, tell):
                self._fail(event, tell)
        elif isinstance(event, Done):
            message: dict[str, Any] = event.found
            if message["is"] == LOST:
                raise ModelError(message["error"], hint=HINT)
            if message["is"] == KEPT:
                tell(item.key, message["failed"])
            elif message["is"] == TAKEN:
                elsewhere.append(item)
            elif not self._there(item, tell):
                self._processes.put(item)

    def _fail(self, lost: Lost, tell: Tell) -> None:
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
