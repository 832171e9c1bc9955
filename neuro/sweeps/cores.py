"""Runs in processes of this machine: one that ends is started anew and its run tried once more.

The processes hear which run to do on a pipe, see `neuro.sweeps.worker`; what comes of it is on disk before they tell.
So whatever is killed, the folder says what is done, and who goes on asks the folder.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from neuro.core.errors import ModelError
from neuro.core.outputs import Unwritable
from neuro.core.provenance import provenance
from neuro.sweeps.claims import Claims
from neuro.sweeps.definition import Item
from neuro.sweeps.folder import FAILED, Folder, Outcome
from neuro.sweeps.worker import KEPT, LOST, TAKEN

TRIES = 2
POLL_S = 0.25
Tell = Callable[[str, bool], None]
"""Is told the key of each run that is there, and whether it failed."""

More = Callable[[int], Sequence[Item]]
"""Gives up to so many runs that are next; none where there is nothing to do now."""


@dataclass
class _Process:
    """A worker, what it works on, and until when."""

    process: subprocess.Popen[str]
    ready: bool = False
    item: Item | None = None
    attempt: int = 0
    deadline: float = float("inf")
    began: float = field(default_factory=time.monotonic)


class Cores:
    """Processes that do runs of the sweep in a folder.

    Args:
        folder: of the sweep.
        count: how many processes.
    """

    def __init__(self, folder: Folder, count: int) -> None:
        told = folder.read()
        self._folder, self._count = folder, count
        self._seconds = told["limits"]["seconds"]
        self._inputs = tuple(told["inputs"])
        self._claims = Claims(folder.claims)
        self._selector = selectors.DefaultSelector()
        self._processes: list[_Process] = []
        self._unborn = 0

    def __enter__(self) -> Cores:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes, and what they work on."""
        for each in self._processes:
            each.process.kill()
        for each in self._processes:
            self._bury(each)
        self._processes = []

    def run(self, items: Iterable[Item], tell: Tell, more: More | None = None) -> None:
        """Do runs, and wait for those that others work on.

        Args:
            items: the runs.
            tell: hears of each when it is there.
            more: is asked for others whenever a process has nothing to do.

        Raises:
            Unwritable: a run cannot be kept, as on a full disk.
            ModelError: no process can begin.
        """
        waiting = deque((item, 1) for item in items)
        elsewhere: list[Item] = []
        self._add(waiting, elsewhere, more)
        while waiting or elsewhere or any(each.item for each in self._processes):
            if not waiting and elsewhere:
                elsewhere = self._look_again(elsewhere, waiting, tell)
            self._hand_out(waiting, elsewhere, tell)
            for key, _ in self._selector.select(self._patience(bool(elsewhere))):
                self._hear(key.data, waiting, elsewhere, tell)
            self._end_late(tell)
            self._add(waiting, elsewhere, more)

    def _add(self, waiting: deque[tuple[Item, int]], elsewhere: list[Item], more: More | None) -> None:
        if more is not None:
            free = self._count - sum(bool(each.item) for each in self._processes) - len(waiting) - len(elsewhere)
            waiting.extend((item, 1) for item in (more(free) if free > 0 else ()))

    def _look_again(self, elsewhere: list[Item], waiting: deque[tuple[Item, int]], tell: Tell) -> list[Item]:
        """Those that somebody else still works on; what was given up waits again."""
        still = []
        for item in elsewhere:
            if self._there(item, tell):
                continue
            if self._claims.free(item.key):
                waiting.append((item, 1))
            else:
                still.append(item)
        return still

    def _there(self, item: Item, tell: Tell) -> bool:
        outcome = self._folder.outcome(item.key) if self._folder.has(item.key) else None
        if outcome is not None:
            tell(item.key, outcome.failed)
        return outcome is not None

    def _hand_out(self, waiting: deque[tuple[Item, int]], elsewhere: list[Item], tell: Tell) -> None:
        while len(self._processes) < min(self._count, len(waiting) + sum(bool(p.item) for p in self._processes)):
            self._start()
        for each in self._processes:
            while waiting and each.ready and each.item is None:
                item, attempt = waiting.popleft()
                if self._there(item, tell):
                    continue
                if attempt == 1 and not self._claims.free(item.key):
                    elsewhere.append(item)
                    continue
                self._ask(each, item, attempt)

    def _start(self) -> None:
        code = [sys.executable, "-P", "-m", "neuro.sweeps.worker", str(self._folder.path.absolute())]
        paths = os.pathsep.join(os.path.abspath(path) for path in sys.path)
        process = subprocess.Popen(
            [*code, json.dumps(sys.argv)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
            env={**os.environ, "PYTHONPATH": paths},
        )
        each = _Process(process)
        self._processes.append(each)
        self._selector.register(process.stdout, selectors.EVENT_READ, each)  # type: ignore[arg-type]

    def _ask(self, each: _Process, item: Item, attempt: int) -> None:
        assert each.process.stdin is not None
        each.item, each.attempt, each.began = item, attempt, time.monotonic()
        each.deadline = each.began + self._seconds if self._seconds else float("inf")
        words = {"key": item.key, "point": item.point, "seed": item.seed, "attempt": attempt, "trial": item.trial}
        with suppress(BrokenPipeError):  # it has ended, which is heard next
            each.process.stdin.write(json.dumps(words) + "\n")

    def _hear(self, each: _Process, waiting: deque[tuple[Item, int]], elsewhere: list[Item], tell: Tell) -> None:
        assert each.process.stdout is not None
        line = each.process.stdout.readline()
        if not line.endswith("\n"):
            self._ended(each, waiting, tell)
            return
        told = json.loads(line)
        item, each.item, each.deadline = each.item, None, float("inf")
        if told["is"] == "ready":
            each.ready, self._unborn = True, 0
        elif told["is"] == "refused":
            raise ModelError(told["error"])
        elif told["is"] == LOST:
            raise ModelError(told["error"], hint="what was done is kept: the same command goes on")
        elif told["is"] == KEPT:
            tell(told["key"], told["failed"])
        elif item is not None:
            if told["is"] == TAKEN:
                elsewhere.append(item)
            elif not self._there(item, tell):
                waiting.append((item, 1))

    def _ended(self, each: _Process, waiting: deque[tuple[Item, int]], tell: Tell) -> None:
        """A process is gone: its run is tried once more, then kept as failed."""
        self._processes.remove(each)
        how = self._bury(each)
        if each.item is None:
            self._unborn += not each.ready
            if self._unborn >= TRIES:
                raise ModelError(f"a process that should do runs {how} before its first: see above")
        elif not self._there(each.item, tell):
            if each.attempt < TRIES:
                waiting.appendleft((each.item, each.attempt + 1))
            else:
                self._fail(each, f"its process {how}, {each.attempt} times", tell)

    def _end_late(self, tell: Tell) -> None:
        """End processes whose run takes longer than the limit."""
        now = time.monotonic()
        for each in [one for one in self._processes if one.deadline < now]:
            self._processes.remove(each)
            each.process.kill()
            self._bury(each)
            assert each.item is not None
            if not self._there(each.item, tell):
                self._fail(each, f"time: takes longer than the limit of {self._seconds:g} s", tell)

    def _fail(self, each: _Process, error: str, tell: Tell) -> None:
        item = each.item
        assert item is not None
        taken = round(time.monotonic() - each.began, 6)
        record = provenance(self._inputs, **({} if item.seed is None else {"seed": item.seed}))
        outcome = Outcome(item.key, item.point, item.seed, FAILED, {}, error, "", taken, each.attempt, record)
        if self._claims.take(item.key):
            try:
                self._folder.keep(outcome)
            except Unwritable as lost:
                raise ModelError(str(lost), hint="what was done is kept: the same command goes on") from None
            finally:
                self._claims.give_up(item.key)
        tell(item.key, True)

    def _patience(self, others: bool) -> float | None:
        """Until when there is nothing to do but listen."""
        first = min((each.deadline for each in self._processes), default=float("inf"))
        late = max(0.0, first - time.monotonic()) + 0.001
        busy = any(each.item or not each.ready for each in self._processes)
        most = POLL_S if others or not busy else 3600.0
        return min(late, most)

    def _bury(self, each: _Process) -> str:
        """Close the pipes of a process; how it ended, in words."""
        assert each.process.stdout is not None
        self._selector.unregister(each.process.stdout)
        code = each.process.wait()
        for pipe in (each.process.stdin, each.process.stdout):
            with suppress(BrokenPipeError):
                if pipe is not None:
                    pipe.close()
        return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"


def cores(threads: int = 1) -> int:
    """How many processes this one may use the cores of this machine for."""
    return max(1, len(os.sched_getaffinity(0)) // threads)
