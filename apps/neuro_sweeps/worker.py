"""One run of a sweep or a tuning after the other: claimed, within its limits, kept before its outcome is reported."""

from __future__ import annotations

import contextlib
import io
import os
import resource
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import Unwritable, digest_of, processes, provenance, run_extensions
from neuro_sweeps.definition import Limits, Run, run_of
from neuro_sweeps.folder import DONE, FAILED, PRUNED, Claims, Folder, RunOutcome
from neuro_sweeps.function import IsWorse, Pruned, gathering_steps
from neuro_sweeps.space import RunItem
from neuro_sweeps.trials import Pruner

TAKEN, THERE, KEPT, LOST = "taken", "there", "kept", "unwritable"
"""How a run ended for the process that asked: another process works on it, it was there, it is kept, it cannot be."""

MOST_PRINTED = 1_000_000


class Worker:
    """Does runs in a folder.

    Args:
        folder: of the sweep.
        run: what is run.
        limits: of one run; of time only its process can be given one.
        inputs: the files that runs are made of.
    """

    def __init__(self, folder: Folder, run: Run, limits: Limits, inputs: tuple[str, ...]) -> None:
        self._folder, self._run, self._limits, self._inputs = folder, run, limits, inputs
        self._claims = Claims(folder.claims)
        self._claims.beat()
        self._pruner: Pruner | None = None

    def close(self) -> None:
        """No more runs are wanted."""
        self._claims.close()

    def do(self, item: RunItem, attempt: int = 1) -> dict[str, Any]:
        """One run, unless it is there or another process works on it: how it ended, as plain data."""
        if self._folder.has(item.key) and self._folder.outcome(item.key) is not None:
            return {"key": item.key, "is": THERE}
        try:
            if not self._claims.take(item.key):
                return {"key": item.key, "is": TAKEN}
        except Unwritable as error:
            return {"key": item.key, "is": LOST, "error": str(error)}
        try:
            if self._folder.outcome(item.key) is not None:
                return {"key": item.key, "is": THERE}
            outcome = self._keep(item, attempt)
            return {"key": item.key, "is": KEPT, "failed": outcome.failed}
        except Unwritable as error:
            return {"key": item.key, "is": LOST, "error": str(error)}
        finally:
            self._claims.give_up(item.key)

    def _keep(self, item: RunItem, attempt: int) -> RunOutcome:
        printed, process = Printed(), os.getpid()
        began = time.perf_counter()
        found, fill, about = dict[str, Any](), None, dict[str, Any]()
        error = trace = ""
        pruned = False
        worse = self._worse(item)
        with _written_to(printed), gathering_steps(worse) as heard, _memory(self._limits.bytes):
            try:
                found, fill, about = self._run(item.point, item.seed)
            except Pruned:
                pruned = True
            except MemoryError as lack:
                error = _lack(self._limits.bytes, lack)
            except ModelError as mistake:
                error = str(mistake)
            except BaseException as bug:
                if isinstance(bug, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
                    raise  # it is this process that is interrupted, not a run that raises this
                error, trace = f"{type(bug).__name__}: {bug}".removesuffix(": "), traceback.format_exc()
        if os.getpid() != process:
            os._exit(1)  # a child that the run has forked, which has come back as if it were the run
        outcome = RunOutcome(
            item.key,
            item.point,
            item.seed,
            FAILED if error else PRUNED if pruned else DONE,
            found,
            error,
            trace,
            round(time.perf_counter() - began, 6),
            attempt,
            provenance(self._inputs, **about),
            heard.steps,
        )
        self._folder.keep(outcome, _filling(fill, str(printed)))
        return outcome

    def _worse(self, item: RunItem) -> IsWorse | None:
        """What prunes a run of a tuning."""
        if item.trial is None:
            return None
        if self._pruner is None:
            self._pruner = Pruner(self._folder)
        return self._pruner.of(item.trial)


class Printed(io.TextIOBase):
    """What a run prints, as much of it as is kept."""

    def __init__(self) -> None:
        self._parts: list[str] = []
        self._left = MOST_PRINTED
        self._more = False

    def writable(self) -> bool:
        """It can be written to."""
        return True

    def write(self, text: str) -> int:
        """Keep a text, or its beginning."""
        if kept := text[: self._left]:
            self._parts.append(kept)
            self._left -= len(kept)
        self._more |= len(kept) < len(text)
        return len(text)

    def close(self) -> None:
        """Stays open: a run that closes what it prints to closes nothing of ours."""

    def __str__(self) -> str:
        return "".join(self._parts) + "\nand more, which is not kept\n" * self._more


@contextlib.contextmanager
def _written_to(printed: Printed) -> Iterator[None]:
    """Gather what is printed, and all warnings, also repeated ones."""

    def tell(message: Warning | str, *place: Any, **words: Any) -> None:
        printed.write(f"warning: {message}\n")

    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed), warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = tell
        yield


def _filling(fill: Callable[[Path], None] | None, printed: str) -> Callable[[Path], None]:
    def both(folder: Path) -> None:
        if printed:
            (folder / "output.txt").write_text(printed, "utf-8", "replace")
        if fill is not None:
            fill(folder)

    return both


def _lack(limit: int | None, error: MemoryError) -> str:
    message = f": {error}" if str(error) else ""
    return (
        f"memory: needs more than the limit of {limit / 1e6:,.0f} MB{message}"
        if limit
        else f"memory: not enough{message}"
    )


@contextlib.contextmanager
def _memory(limit: int | None) -> Iterator[None]:
    """Let allocations fail that go beyond what the process has now and the limit.

    Source: getrlimit(2), RLIMIT_DATA, which counts private anonymous memory since Linux 4.7
    """
    if limit is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (_data() + limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmData:"):
            return int(line.split()[1]) * 1024
    return 0


def worker_of(folder: Folder, content: Mapping[str, Any]) -> Worker:
    """A worker in this process, once all is what it was when the sweep began.

    Raises:
        ModelError: a file is gone, or was edited.
    """
    for name, digest in content["with"].items():
        if digest_of(name) != digest:
            raise ModelError(f"{name}: was edited since the sweep began, or is gone: expected the file that it was")
    run_extensions(tuple(content["with"]))
    run = run_of(content["what"])
    run.check_inputs()
    return Worker(folder, run, Limits(**content["limits"]), tuple(content["inputs"]))


def begin(folder: Path) -> processes.Work:
    """What does runs in a process of its own.

    Args:
        folder: of the sweep.

    Raises:
        ModelError: a file is gone, or was edited.
    """
    os.dup2(2, 1)  # what a run prints by itself is none of what the sweep tells
    warnings.simplefilter("default")
    kept = Folder(folder)
    worker = worker_of(kept, kept.read())

    def work(item: RunItem, attempt: int, tell: Callable[[Any], None]) -> dict[str, Any]:
        return worker.do(item, attempt)

    return work
