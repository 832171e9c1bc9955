"""`neuro.sweep`, a function over a space, and `neuro.tune`, the best points of one for a function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from os import PathLike
from typing import Any, TypeVar

from neuro.core.checks import check
from neuro.core.paths import file_path
from neuro.core.progress import Bar
from neuro.core.quantities import Quantity
from neuro.sweeps.definition import limits_of, python_search, python_sweep
from neuro.sweeps.execute import execute, execute_search
from neuro.sweeps.executors import HERE, place_of
from neuro.sweeps.folder import SWEEP, TUNING, Folder
from neuro.sweeps.plan import plan_of
from neuro.sweeps.space import space_of
from neuro.sweeps.table import SweepTable, table_of
from neuro.sweeps.trials import TuneTable, tune_table_of

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
    """Call a function at all points of a space, and keep what it returns.

    Each run is kept in a folder of its own as soon as it has ended. What is there is not done again, so the same call
    goes on after whatever has ended it. A run that raises is kept with its error, and the others go on.

    Args:
        function: takes the values of a point by name, and `seed` if there are seeds; returns a number, or numbers and
            texts by name. Or the name of a registered study.
        space: by name a list of values, or a range `{"from": 0, "to": 1, "number": 5}`, also with `"scale": "log"` and
            `"whole": True`; or a list of points.
        out: the folder.
        sampling: "grid", "random" or "latin_hypercube"; the last two need no `number`.
        runs: how many points are drawn.
        seeds: a number of them, 0, 1, ..., or a list; each point is run with each.
        draw: the seed with which points are drawn.
        set: values that are the same in all runs.
        on: "cores", processes of this machine; "here", this process; "tcp://host:8786" or the file of a Dask
            scheduler, which all work in the same folder.
        workers: how many processes of this machine; as many as there are cores if not given.
        share: "I/N" for one of N shares of the runs, for array jobs.
        time_limit: of a run, in s or with its unit.
        memory_limit: of a run, as "500 MB" or "2 GB".
        retry_failed: whether to do again what failed.
        progress: whether to tell on stderr how many are done, failed and left, and how long it will take.
        each: is called with the table after each run.

    Returns:
        The table; `neuro.sweeps.table.table_of(out)` gives it while it fills, also in another process.

    Raises:
        ModelError: the function does not take the space, the space is empty or too large, the folder is of another
            sweep, or cannot be written.
    """
    points = space_of(space, sampling, runs, seeds, draw)
    limits, place = limits_of(time_limit, memory_limit), place_of(on, workers, share)
    made = python_sweep(function, points, limits, set, place.on == HERE)
    folder = Folder(file_path(out, "out"), SWEEP)
    do, table = partial(execute, made, folder, place), partial(table_of, folder.path)
    return _done(do, table, retry_failed, progress, each)


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
    """Look for the points of a space at which a function is best, by Optuna; needs the extra `tune`.

    A trial is a point, run once, or once for each seed and fold; its objectives are the means over its runs. Each run
    is kept in a folder of its own, named by its arguments, so the same point is not run twice, and the same call
    goes on after whatever has ended it, also with more trials.

    Args:
        function: takes the values of a point by name, `seed` if there are seeds, `fold` and `folds` if there are
            folds; returns a number, whose name is "value", or numbers and texts by name. Or the name of a registered
            study. Other processes must find it, unless `on` is "here".
        space: by name a list of values to choose from, or a range `{"from": 0.01, "to": 1}`, also with
            `"scale": "log"` and `"whole": True`.
        objectives: by the name of what the function returns "maximise" or "minimise"; of several there is a front.
        trials: how many points, those of before included.
        out: the folder.
        sampler: "tpe", which one objective has if not given; "nsga2", which several have (under some 60 trials "tpe"
            finds more); "random"; or "grid", whose ranges need `"number"`.
        draw: the seed of the sampler: with one worker the same trials each time.
        seeds: a number of them, 0, 1, ..., or a list.
        folds: in how many parts the function divides its data, at least 2: it is called with `fold` 0, 1, ..., and
            tells how good it is on that part when learnt from the others. With `fold` None, on the data that no fold
            has, it is called by `neuro tune test` alone.
        prune: "median" or "hyperband", or a mapping with "by" and the words of that pruner: trials end early at which
            others were better; the function calls `neuro.report_step(value, step)`. Of several runs of a trial, the
            means so far are compared.
        set: values that are the same in all runs.
        on: "cores", processes of this machine; "here", this process; "tcp://host:8786" or the file of a Dask
            scheduler, which all work in the same folder.
        workers: how many processes of this machine; as many as there are cores if not given.
        share: "I/N" for one of N processes that ask one journal, for array jobs: it asks for its share of the trials.
        time_limit: of a run, in s or with its unit.
        memory_limit: of a run, as "500 MB" or "2 GB".
        retry_failed: whether to do those trials again of which a run failed.
        progress: whether to tell on stderr how many are done, failed and left, and how long it will take.
        each: is called with the table after each run.

    Returns:
        The table: a row for each trial, `table.best()` are those that no other beats, each with its `point` and its
        `values` in the order of the objectives. `neuro.tuned(out)` gives it while it fills, also in another process.

    Raises:
        ModelError: Optuna is not installed, the function does not take the space or returns no objective, the space
            is empty, the folder is of another search, is damaged or cannot be written.
    """
    plan = plan_of(space, objectives, trials, sampler, draw, seeds, folds, prune)
    limits, place = limits_of(time_limit, memory_limit), place_of(on, workers, share)
    made = python_search(function, plan, limits, set, place.on == HERE)
    folder = Folder(file_path(out, "out"), TUNING)
    return _done(
        partial(execute_search, made, folder, place), partial(tune_table_of, folder.path), retry_failed, progress, each
    )


def _done(
    do: Callable[..., object], table: Callable[[], T], again: bool, progress: bool, each: Callable[[T], None] | None
) -> T:
    """Do all runs, and give the table of them."""
    retry = check(_FLAG, again, "retry_failed")
    hear = None if each is None else lambda key: each(table())
    with Bar() if check(_FLAG, progress, "progress") else nullcontext() as bar:
        do(retry=retry, bar=bar, hear=hear)
    return table()


def tuned(path: str | PathLike[str]) -> TuneTable:
    """The table of a search, as `neuro.tune` or `neuro tune run` keeps it in a folder.

    Raises:
        ModelError: the folder holds none.
    """
    return tune_table_of(path)
