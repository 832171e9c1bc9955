"""`neuro.tune`: the best points of a space for a function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from os import PathLike
from typing import Any

from neuro.core.checks import check
from neuro.core.paths import file_path
from neuro.core.progress import Bar
from neuro.core.quantities import Quantity
from neuro.sweeps.definition import limits_of
from neuro.sweeps.executors import HERE, place_of
from neuro.sweeps.folder import TUNING, Folder
from neuro.sweeps.tuning.execute import execute
from neuro.sweeps.tuning.plan import plan_of
from neuro.sweeps.tuning.search import python_search
from neuro.sweeps.tuning.table import TuneTable, tune_table_of

_FLAG = Quantity(kind="boolean")


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
    part: str | None = None,
    time_limit: float | str | None = None,
    memory_limit: str | None = None,
    retry_failed: bool = False,
    progress: bool = True,
    each: Callable[[TuneTable], None] | None = None,
) -> TuneTable:
    """Look for the points of a space at which a function is best, by Optuna; needs the extra `tune`.

    A trial is a point, run once, or once for each seed and fold; its objectives are the means over its runs. Each run
    is kept in a folder of its own, named by what it is told, so the same point is not run twice, and the same call
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
        part: "I/N" for one of N processes that ask one journal, for array jobs: it asks for its share of the trials.
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
    limits, place = limits_of(time_limit, memory_limit), place_of(on, workers, part)
    made = python_search(function, plan, limits, set, place.on == HERE)
    folder = Folder(file_path(out, "out"), TUNING)
    again = check(_FLAG, retry_failed, "retry_failed")
    hear = None if each is None else lambda key: each(tune_table_of(folder.path))
    with Bar() if check(_FLAG, progress, "progress") else nullcontext() as bar:
        execute(made, folder, place, retry=again, bar=bar, hear=hear)
    return tune_table_of(folder.path)


def tuned(path: str | PathLike[str]) -> TuneTable:
    """The table of a search, as `neuro.tune` or `neuro tune run` keeps it in a folder.

    Raises:
        ModelError: the folder holds none.
    """
    return tune_table_of(path)
