"""The worker of a sweep or a tuning: claims a run, keeps its limits, and writes its outcome before reporting it."""

from __future__ import annotations

import contextlib
import io
import os
import re
import resource
import signal
import time
import traceback
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import Unwritable, digest_of, processes, provenance, run_extensions
from neuro_sweeps.definition import Limits, Run, run_from_dict
from neuro_sweeps.folder import DONE, FAILED, PRUNED, Claims, Folder, RunOutcome
from neuro_sweeps.function import IsWorse, Pruned, gather_steps
from neuro_sweeps.space import RunItem
from neuro_sweeps.trials import Pruner

HINT = "finished runs are kept: run the same command again to continue"

MOST_PRINTED = 1_000_000
"""Largest number of characters that are kept of a run's printed text."""


class Worker:
    """A worker that does runs of a sweep in this process.

    Args:
        folder: folder of the sweep.
        run: the function or network to run.
        limits: limits of a run. Only the memory limit applies here; a time limit needs a worker process.
        inputs: input files of the runs.
    """

    def __init__(self, folder: Folder, run: Run, limits: Limits, inputs: tuple[str, ...]) -> None:
        self._folder, self._run, self._limits, self._inputs = folder, run, limits, inputs
        self._claims = Claims(folder.claims)
        self._claims.beat()
        self._pruner: Pruner | None = None

    def close(self) -> None:
        """Remove all claims."""
        self._claims.close()

    def do(self, item: RunItem, attempt: int = 1) -> bool | None:
        """Do a missing run, and return whether the run failed; None if another process works on the run.

        Raises:
            ModelError: the run cannot be kept, e.g. on a full disk.
        """
        outcome = self._folder.outcome(item.key)
        try:
            if outcome is None:
                if not self._claims.take(item.key):
                    return None
                try:
                    outcome = self._folder.outcome(item.key) or self._keep(item, attempt)
                finally:
                    self._claims.give_up(item.key)
        except Unwritable as error:
            raise ModelError(str(error), hint=HINT) from None
        return outcome.failed

    def _keep(self, item: RunItem, attempt: int) -> RunOutcome:
        printed, process = Printed(), os.getpid()
        start = time.perf_counter()
        metrics, fill, entries = dict[str, Any](), None, dict[str, Any]()
        error = trace = ""
        pruned = False
        is_worse = self._pruner_of(item)
        with _capture(printed), gather_steps(is_worse) as reported, _memory(self._limits.bytes):
            try:
                metrics, fill, entries = self._run(item.point, item.seed)
            except Pruned:
                pruned = True
            except MemoryError as memory_error:
                limit = self._limits.bytes
                reason = f"exceeds the limit of {limit / 1e6:,.0f} MB" if limit else "not enough on this machine"
                error = f"memory: {reason}: {memory_error}".removesuffix(": ")
            except ModelError as mistake:
                error = str(mistake)
            except BaseException as bug:
                if isinstance(bug, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
                    raise  # the user interrupts this process
                error, trace = f"{type(bug).__name__}: {bug}".removesuffix(": "), traceback.format_exc()
        if os.getpid() != process:
            os._exit(1)  # a forked child of the run, which returned here as well
        outcome = RunOutcome(
            item.key,
            item.point,
            item.seed,
            FAILED if error else PRUNED if pruned else DONE,
            metrics,
            error,
            trace,
            round(time.perf_counter() - start, 6),
            attempt,
            provenance(self._inputs, **entries),
            reported.steps,
        )

        def fill_folder(folder: Path) -> None:
            if text := str(printed):
                (folder / "output.txt").write_text(text, "utf-8", "replace")
            if fill is not None:
                fill(folder)

        self._folder.keep(outcome, fill_folder)
        return outcome

    def _pruner_of(self, item: RunItem) -> IsWorse | None:
        """Return the function that decides whether a run of a tuning ends early, or None."""
        if item.trial is None:
            return None
        if self._pruner is None:
            self._pruner = Pruner(self._folder)
        return self._pruner.for_trial(item.trial)


class Printed(io.StringIO):
    """The printed text of a run, up to `MOST_PRINTED` characters."""

    _is_cut = False

    def write(self, text: str) -> int:
        """Keep a text, or the beginning that fits."""
        beginning = text[: MOST_PRINTED - self.tell()]
        super().write(beginning)
        self._is_cut |= len(beginning) < len(text)
        return len(text)

    def close(self) -> None:
        """Do nothing, so that a run may close its output."""

    def __str__(self) -> str:
        return self.getvalue() + "\n(the rest is not kept)\n" * self._is_cut


@contextlib.contextmanager
def _capture(printed: Printed) -> Iterator[None]:
    """Collect printed text and all warnings, including repeated ones."""

    def write_warning(message: Warning | str, *place: Any, **words: Any) -> None:
        printed.write(f"warning: {message}\n")

    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed), warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = write_warning
        yield


@contextlib.contextmanager
def _memory(limit: int | None) -> Iterator[None]:
    """Let allocations fail that exceed the present memory of the process by more than the limit.

    Source: getrlimit(2), RLIMIT_DATA, which counts private anonymous memory since Linux 4.7
    """
    if limit is None:
        yield
        return
    old_limits = resource.getrlimit(resource.RLIMIT_DATA)
    match = re.search(r"VmData:\s*(\d+) kB", Path("/proc/self/status").read_text())
    used_bytes = int(match[1]) * 1024 if match else 0
    resource.setrlimit(resource.RLIMIT_DATA, (used_bytes + limit, old_limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, old_limits)


def worker_of(folder: Folder, content: Mapping[str, Any]) -> Worker:
    """Return a worker in this process, after a check that all inputs are unchanged.

    Raises:
        ModelError: a file is missing, or was edited.
    """
    for name, digest in content["with"].items():
        if digest_of(name) != digest:
            raise ModelError(f"{name}: missing, or edited since the sweep began: expected the unchanged file")
    run_extensions(tuple(content["with"]))
    run = run_from_dict(content["what"])
    run.check_inputs()
    return Worker(folder, run, Limits(**content["limits"]), tuple(content["inputs"]))


def begin(folder: Path) -> processes.Work:
    """Return the function that does runs in a worker process.

    Args:
        folder: folder of the sweep.

    Raises:
        ModelError: a file is missing, or was edited.
    """
    os.dup2(2, 1)  # text that C libraries print must not mix with the output of the sweep
    warnings.simplefilter("default")
    sweep_folder = Folder(folder)
    worker = worker_of(sweep_folder, sweep_folder.read())

    return lambda items, attempt, tell: [worker.do(item, attempt) for item in items]
