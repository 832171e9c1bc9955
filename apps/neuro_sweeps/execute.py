"""Execution of sweeps and searches, and their calls in Python: `sweep`, `tune` and `tuned`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, nullcontext
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from neuro import ModelError
from neuro.apps import Bar, Processes, Quantity, check, file_path, provenance
from neuro_sweeps.definition import Limits, Runs, limits_of, search_of
from neuro_sweeps.executors import HERE, MOST_AT_ONCE, Cluster, Executor, Here, ends_of, executor_of, pool_of
from neuro_sweeps.folder import TUNING, Folder, alive, claimed, locked, waiting
from neuro_sweeps.function import function_run
from neuro_sweeps.journal import journal_of, optuna, trials_of
from neuro_sweeps.plan import SearchPlan, plan_of
from neuro_sweeps.space import RunItem, SearchSpace, space_of
from neuro_sweeps.table import SweepTable, as_text, table_of
from neuro_sweeps.trials import Asker, TuneTable, point_of, tune_table_of

POLL_S = 0.25
"""Interval in seconds at which a process checks runs of other processes."""

OnRun = Callable[[str, bool], None]
"""Function that is called with the key of each finished run, and whether it failed."""

OnKept = Callable[[str], None]
"""Function that is called with the key of each kept run."""


class KnownRuns:
    """Source of runs for `execute`: the runs of a known list that the folder lacks.

    Args:
        items: the runs.
        folder: folder of the runs.
        retry: repeat failed runs.
    """

    def __init__(self, items: Sequence[RunItem], folder: Folder, retry: bool = False) -> None:
        outcomes = folder.outcomes(item.key for item in items)
        for key in [key for key, outcome in outcomes.items() if retry and outcome.failed]:
            folder.remove(key)
            del outcomes[key]
        self._missing = [item for item in items if item.key not in outcomes]
        failed = sum(outcome.failed for outcome in outcomes.values())
        self._counts = {"done": len(outcomes) - failed, "failed": failed, "left": len(self._missing)}

    def next_runs(self, number: int) -> Sequence[RunItem]:
        """Return all missing runs in the first call, and none in later calls."""
        items, self._missing = self._missing, []
        return items

    def on_run(self, key: str, failed: bool) -> None:
        """Count a finished run."""
        self._counts["failed" if failed else "done"] += 1
        self._counts["left"] -= 1

    def counts(self) -> dict[str, int]:
        """Return the numbers of runs that are done, failed and left."""
        return self._counts

    def claims_of_others(self) -> Sequence[str]:
        """Return no claims: only trials of a search have claims of other processes, and all these runs are known."""
        return ()

    def finished(self) -> bool:
        """Return True: there are no further runs."""
        return True

    def close(self) -> None:
        """Do nothing, because this source holds no claims: the process that does a run claims it."""


def execute(
    runs: Runs,
    folder: Folder,
    executor: Executor,
    *,
    retry: bool = False,
    bar: Bar | None = None,
    on_kept: OnKept | None = None,
) -> dict[str, int]:
    """Do all missing runs of a sweep, or ask for trials of a search and do the runs of each trial.

    Args:
        runs: the sweep, or the search, whose number of trials may differ from that in the folder.
        folder: folder of the runs, and of the journal of a search; a missing folder is created.
        executor: place where the runs are done. With a share, only the runs or trials of the share are done; a search
            does not wait for other processes then.
        retry: repeat failed runs, or trials with a failed run; not with a share of a search.
        bar: progress bar.
        on_kept: called with the key of each kept run.

    Returns:
        For a sweep, the numbers of runs that are done, failed and left. For a search, these numbers of trials, and the
        number of pruned trials.

    Raises:
        ModelError: the folder belongs to another sweep or search, or cannot be written; there are no such workers; the
            journal is damaged; Optuna is not installed; runs of a search lack a metric of the objectives.
    """
    share, points = executor.share, runs.points
    if not isinstance(points, SearchPlan):
        _begin(runs, folder)
        items = [item for k, item in enumerate(runs.items, 1) if share is None or k % share[1] == share[0]]
        return _do(runs, folder, executor, KnownRuns(items, folder, retry), bar, on_kept)
    optuna()  # raises an error if Optuna is missing, before the folder is created
    if retry and share is not None:
        message = "retry_failed repeats the failed runs of all shares: expected no share"
        raise ModelError(message, hint="retry without a share first, then run the shares")
    _begin(runs, folder)
    if retry:
        _retry_failed(points, runs.key_prefix, folder)
    trials = None if share is None else points.most // share[1] + (0 < share[0] <= points.most % share[1])
    return _do(runs, folder, executor, Asker(points, runs.key_prefix, folder, trials), bar, on_kept)


def hold_out(table: TuneTable, executor: Executor, bar: Bar) -> None:
    """Run the best points of a search on the data that is held out from all folds.

    Args:
        table: table of the search.
        executor: place where the runs are done.
        bar: progress bar.

    Raises:
        ModelError: see `search_of` and `execute`.
    """
    folder = Folder(table.path, TUNING)
    runs = search_of(folder)
    _begin(runs, folder)
    tests = (item for trial in table.best() for item in table.plan.tests(runs.key_prefix, trial.point))
    _do(runs, folder, executor, KnownRuns(list({item.key: item for item in tests}.values()), folder), bar)


def _do(
    runs: Runs,
    folder: Folder,
    executor: Executor,
    source: KnownRuns | Asker,
    bar: Bar | None,
    on_kept: OnKept | None = None,
) -> dict[str, int]:
    """Do the runs of a source, show the progress, and return the final numbers."""

    def on_run(key: str, failed: bool) -> None:
        source.on_run(key, failed)
        if bar is not None:
            counts = source.counts()
            total = sum(counts.values())
            bar.show(total - counts["left"], total, as_text(counts))
        if on_kept is not None:
            on_kept(key)

    with closing(source):
        counts = source.counts()
        if bar is not None:
            bar.begin(sum(counts.values()) - counts["left"])
            bar.say(as_text(counts))
        if counts["left"]:
            with closing(pool_of(runs, folder, executor)) as pool:
                _do_all(pool, folder, source, on_run, bar)
            folder.tidy()
        return source.counts()


def _do_all(
    pool: Processes | Here | Cluster, folder: Folder, source: KnownRuns | Asker, on_run: OnRun, bar: Bar | None
) -> None:
    """Do the runs of a source, and wait for runs and trials of other processes.

    If the pool has nothing to do, the progress bar names the other processes. If the pool is `Here` and the source is
    `KnownRuns`, it does not wait.
    """
    foreign_items: list[RunItem] = []
    while True:
        if (n_free := pool.free - len(foreign_items)) > 0 and (items := source.next_runs(n_free)):
            size = max(1, min(MOST_AT_ONCE, len(items) // (4 * n_free))) if isinstance(pool, Cluster) else 1
            for k in range(0, len(items), size):
                pool.put(items[k : k + size])
        if not pool.busy:
            if (not foreign_items or (isinstance(pool, Here) and isinstance(source, KnownRuns))) and source.finished():
                return
            if bar is not None and (claims := [item.key for item in foreign_items] or source.claims_of_others()):
                bar.say(waiting(folder.claims, claims))
        for task in pool.hear(None if pool.busy and not foreign_items else POLL_S):
            for item, failed in zip(task.job, ends_of(folder, task), strict=True):
                if failed is None:
                    foreign_items.append(item)
                else:
                    on_run(item.key, failed)
        if pool.free > 0:
            still_claimed = []
            for item in foreign_items:
                if (outcome := folder.outcome(item.key)) is not None:
                    on_run(item.key, outcome.failed)
                elif alive(folder.claims / item.key):
                    still_claimed.append(item)
                else:
                    pool.put([item])
            foreign_items = still_claimed


def _begin(runs: Runs, folder: Folder) -> None:
    """Create the folder, or continue in it. The number of trials of a search may differ."""
    folder.begin(runs.as_dict() | {"inputs": list(runs.inputs), "provenance": provenance(runs.inputs)})


def _retry_failed(plan: SearchPlan, key_prefix: str, folder: Folder) -> None:
    """Reopen trials with a failed run, so that the next asker takes them over as unfinished.

    Raises:
        ModelError: other processes work in the folder, or the journal is damaged.
    """
    with locked(folder.claims / ".ask"):
        if claims := claimed(folder.claims):
            message = f"{folder.path}: other processes work on {len(claims)} runs or trials"
            raise ModelError(message, hint="retry when no other process works in the folder")
        state = optuna().trial.TrialState.FAIL
        trials = [trial for trial in trials_of(folder) if trial.state == state]
        items = {trial._trial_id: plan.items(key_prefix, point_of(plan, trial.params)) for trial in trials}
        outcomes = folder.outcomes({item.key: None for trial_items in items.values() for item in trial_items})
        failed = {key for key, outcome in outcomes.items() if outcome.failed}
        reopened = {number for number, trial_items in items.items() if any(item.key in failed for item in trial_items)}
        journal_of(folder).remove_ends(reopened, state.value)
        for key in failed:
            folder.remove(key)


_FLAG = Quantity(kind="boolean")
T = TypeVar("T", SweepTable, TuneTable)


def sweep(
    function: Callable[..., Any] | str,
    space: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    out: str | PathLike[str],
    sampling: str = "grid",
    runs: int | None = None,
    seeds: int | Sequence[int] | None = None,
    draw: int = 0,
    set: Mapping[str, Any] | None = None,
    on: str | PathLike[str] = "cores",
    workers: int | None = None,
    share: str | None = None,
    time_limit: float | str | None = None,
    memory_limit: str | None = None,
    retry_failed: bool = False,
    progress: bool = True,
    each: Callable[[SweepTable], None] | None = None,
) -> SweepTable:
    """Call a function at all points of a space, and keep the results.

    Each run is kept in a folder when the run ends. Kept runs are not repeated, so the same call continues an
    interrupted sweep. A run that raises an error is kept with the error, and the sweep continues.

    Args:
        function: function of the values of a point by name, and of `seed` if there are seeds, that returns a number, or
            numbers and texts by name. Or the name of a registered study.
        space: lists of values or ranges by name, or a list of points. A range is
            `{"from": 0, "to": 1, "number": 5}`, optionally with `"scale": "log"` and `"whole": True`.
        out: folder of the sweep.
        sampling: "grid", "random" or "latin_hypercube"; only grids have a `number`.
        runs: number of points to draw, for "random" and "latin_hypercube".
        seeds: number of seeds, which are 0, 1, ..., or a list of seeds; each point is run with each seed.
        draw: seed of the drawn points.
        set: values that are the same in all runs.
        on: "cores" for processes of this machine; "here" for this process; "tcp://host:8786" or the file of a scheduler
            for a Dask cluster, whose workers use the same folder.
        workers: number of processes of this machine; default: the number of cores.
        share: "I/N" to do one of N shares of the runs, for array jobs.
        time_limit: time limit of a run, in s or with a unit.
        memory_limit: memory limit of a run, such as "500 MB" or "2 GB".
        retry_failed: repeat failed runs.
        progress: show the numbers of runs and the remaining time on stderr.
        each: called with the table after each run.

    Returns:
        The table. `neuro_sweeps.table.table_of(out)` returns the table of a running sweep, also in another process.

    Raises:
        ModelError: the function lacks a parameter of the space; the space is empty or too large; the folder
            belongs to another sweep or cannot be written.
    """
    points, limits = space_of(space, sampling, runs, seeds, draw), limits_of(time_limit, memory_limit)
    return _call(function, points, limits, set, table_of, out, on, workers, share, retry_failed, progress, each)


def tune(
    function: Callable[..., Any] | str,
    space: Mapping[str, Any],
    *,
    objectives: Mapping[str, str],
    trials: int,
    out: str | PathLike[str],
    sampler: str | None = None,
    draw: int = 0,
    seeds: int | Sequence[int] | None = None,
    folds: int | None = None,
    prune: str | Mapping[str, Any] | None = None,
    set: Mapping[str, Any] | None = None,
    on: str | PathLike[str] = "cores",
    workers: int | None = None,
    share: str | None = None,
    time_limit: float | str | None = None,
    memory_limit: str | None = None,
    retry_failed: bool = False,
    progress: bool = True,
    each: Callable[[TuneTable], None] | None = None,
) -> TuneTable:
    """Search for the best points of a space with Optuna; needs the extra `tune`.

    A trial is a point with one run, or with a run for each seed and fold. The objectives are means over these runs.
    Each run is kept in its own folder, whose name is a hash of the arguments. So no point is run twice, and the same
    call continues an interrupted search, also with more trials.

    Args:
        function: function of the values of a point by name, of `seed` if there are seeds, and of `fold` and `folds` if
            there are folds. It returns a number, which is named "value", or numbers and texts by name. Or the name of a
            registered study. Other processes must be able to import the function, unless `on` is "here".
        space: by name, a list of values or a range `{"from": 0.01, "to": 1}`, optionally with `"scale": "log"` and
            `"whole": True`.
        objectives: "maximise" or "minimise" by name of a metric. Several objectives have a Pareto front.
        trials: number of trials, including those of earlier calls.
        out: folder of the search.
        sampler: "tpe" (default for one objective), "nsga2" (default for several; below some 60 trials "tpe" finds
            better points), "random", or "grid", whose ranges need `"number"`.
        draw: seed of the sampler. With one worker, the same seed gives the same trials.
        seeds: number of seeds, which are 0, 1, ..., or a list of seeds.
        folds: number of folds, at least 2. The function divides its data, trains on all folds but `fold` (0, 1, ...),
            and returns its metrics on `fold`. Only `neuro tune test` calls it with `fold` None, for the test data that
            no fold contains.
        prune: "median" or "hyperband", or a mapping with "by" and settings of the pruner: end a trial early if other
            trials were better at the same step. The function calls `neuro.report_step(value, step)`. A trial of several
            runs is compared by its means so far.
        set: values that are the same in all runs.
        on: "cores" for processes of this machine; "here" for this process; "tcp://host:8786" or the file of a scheduler
            for a Dask cluster, whose workers use the same folder.
        workers: number of processes of this machine; default: the number of cores.
        share: "I/N" to do one of N shares of the trials, for array jobs with a common journal.
        time_limit: time limit of a run, in s or with a unit.
        memory_limit: memory limit of a run, such as "500 MB" or "2 GB".
        retry_failed: repeat trials with a failed run.
        progress: show the numbers of trials and the remaining time on stderr.
        each: called with the table after each run.

    Returns:
        The table, with a row per trial. `table.best()` has the best trials, each with its `point` and its `values` in
        the order of the objectives. `neuro.tuned(out)` returns the table of a running search, also in another process.

    Raises:
        ModelError: Optuna is not installed; the function lacks a parameter of the space or returns no objective;
            the space is empty; the folder belongs to another search, is damaged or cannot be written.
    """
    plan = plan_of(space, objectives, trials, sampler, draw, seeds, folds, prune)
    limits = limits_of(time_limit, memory_limit)
    return _call(function, plan, limits, set, tune_table_of, out, on, workers, share, retry_failed, progress, each)


def _call(
    function: Any,
    points: SearchSpace | SearchPlan,
    limits: Limits,
    set: Mapping[str, Any] | None,
    table_of: Callable[[Path], T],
    out: str | PathLike[str],
    on: str | PathLike[str],
    workers: int | None,
    share: str | None,
    retry: bool,
    progress: bool,
    each: Callable[[T], None] | None,
) -> T:
    """Do all runs of a function with an optional progress bar, and return the table."""
    executor = executor_of(on, workers, share)
    run = function_run(function, set, executor.on == HERE)
    runs = Runs(run.name, run, limits, points)
    runs.check()
    folder = Folder(file_path(out, "out"), runs.kind)
    retry = check(_FLAG, retry, "retry_failed")
    on_kept = None if each is None else lambda key: each(table_of(folder.path))
    with Bar() if check(_FLAG, progress, "progress") else nullcontext() as bar:
        execute(runs, folder, executor, retry=retry, bar=bar, on_kept=on_kept)
    return table_of(folder.path)


def tuned(path: str | PathLike[str]) -> TuneTable:
    """Return the table of the search in a folder of `neuro.tune` or `neuro tune run`.

    Raises:
        ModelError: the folder has no search.
    """
    return tune_table_of(path)
