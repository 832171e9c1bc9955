"""Sweeps of a function over a space and searches for its best points: the calls, and how all runs are done."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, nullcontext
from functools import partial
from os import PathLike
from typing import Any, TypeVar

from neuro import ModelError
from neuro.apps import Bar, Quantity, check, file_path, provenance
from neuro_sweeps.definition import Definition, Search, Sweep, limits_of, python_search, python_sweep
from neuro_sweeps.executors import HERE, POLL_S, Executor, doing, place_of
from neuro_sweeps.folder import SWEEP, TUNING, Folder, claimed, waiting
from neuro_sweeps.journal import journal_of, locked, optuna, trials_of
from neuro_sweeps.plan import SearchPlan, plan_of
from neuro_sweeps.space import Point, space_of
from neuro_sweeps.table import SweepTable, as_text, table_of
from neuro_sweeps.trials import Asker, TuneTable, point_of, tune_table_of

Hear = Callable[[str], None]
"""Gets the key of each run when it is there."""


def execute(
    sweep: Sweep,
    folder: Folder,
    place: Executor,
    *,
    retry: bool = False,
    bar: Bar | None = None,
    hear: Hear | None = None,
) -> dict[str, int]:
    """Do all runs of a sweep that its folder does not have.

    Args:
        sweep: the sweep.
        folder: where runs are kept; made if it is not there.
        place: where they are done.
        retry: whether to do those again that failed.
        bar: shows how far it is.
        hear: gets the key of each run when it is there.

    Returns:
        How many runs are done, failed and left.

    Raises:
        ModelError: the folder is another's, cannot be written, or there are no such workers.
    """
    folder.begin(_recorded(sweep), "digest_of_runs", "same")
    share = place.share
    items = [item for k, item in enumerate(sweep.items, 1) if share is None or k % share[1] == share[0]]
    there = folder.outcomes(item.key for item in items)
    if retry:
        for key in [key for key, outcome in there.items() if outcome.failed]:
            folder.forget(key)
            del there[key]
    failed = sum(outcome.failed for outcome in there.values())
    counts = {"done": len(there) - failed, "failed": failed, "left": len(items) - len(there)}
    total = counts["left"]

    def tell(key: str, failed: bool) -> None:
        counts["failed" if failed else "done"] += 1
        counts["left"] -= 1
        if bar is not None:
            bar.show(total - counts["left"], total, as_text(counts))
        if hear is not None:
            hear(key)

    if bar is not None:
        bar.say(as_text(counts))
    if total:
        with doing(sweep, folder, place, tell, say=None if bar is None else bar.say, wait=False) as do:
            do([item for item in items if item.key not in there])
    return counts


def _recorded(definition: Definition) -> dict[str, object]:
    """What the file of a folder has."""
    inputs = definition.inputs
    return definition.as_dict() | {"inputs": list(inputs), "provenance": provenance(inputs)}


def execute_search(
    search: Search,
    folder: Folder,
    place: Executor,
    *,
    retry: bool = False,
    bar: Bar | None = None,
    hear: Hear | None = None,
) -> dict[str, int]:
    """Ask for trials and do their runs until there are as many as the plan says.

    Args:
        search: the search.
        folder: where runs and the journal are kept; made if it is not there.
        place: where runs are done; one that has a share asks for so many trials and does not wait for others.
        retry: whether to do those trials again of which a run failed; not of a share.
        bar: shows how far it is.
        hear: gets the key of each run when it is there.

    Returns:
        How many trials are done, failed, pruned and left.

    Raises:
        ModelError: the folder is another's, cannot be written, its journal is damaged, Optuna is not installed, no run
            has a metric of the objectives, or there are no such workers.
    """
    optuna()  # whether it is there shows before a folder is made
    if retry and place.share is not None:
        message = "what failed is done again by one process for all"
        raise ModelError(f"{message}: expected no share", hint="run it once without, then the shares")
    _begin_search(search, folder)
    if retry:
        _retry_failed(search.plan, search.before, folder)
    with closing(Asker(search.plan, search.before, folder, _share(search.plan.most, place.share))) as asker:
        _ask(asker, search, folder, place, bar, hear)
        return asker.counts()


def _ask(asker: Asker, search: Search, folder: Folder, place: Executor, bar: Bar | None, hear: Hear | None) -> None:
    """Do the runs that are asked for, and wait for trials of others where this has no share."""

    def tell(key: str, failed: bool) -> None:
        asker.tell(key)
        if bar is not None:
            counts = asker.counts()
            bar.show(search.plan.most - counts["left"], search.plan.most, as_text(counts))
        if hear is not None:
            hear(key)

    if bar is not None:
        bar.say(as_text(asker.counts()))
    say = None if bar is None else bar.say
    with doing(search, folder, place, tell, asker.more, say=say) as do:
        do(())
        while place.share is None and not asker.finished():
            if say is not None and (others := asker.others()):
                say(waiting(folder.claims, others, "trial"))
            time.sleep(POLL_S)  # others work on what is left, and may die
            if items := asker.more(1):
                do(items)


def hold_out(search: Search, folder: Folder, points: Sequence[Point], place: Executor, bar: Bar) -> None:
    """Run points on what is held out from all folds.

    Args:
        search: the search.
        folder: where it is kept.
        points: values of the parameters.
        place: where runs are done.
        bar: shows how far it is.

    Raises:
        ModelError: as `execute_search`.
    """
    _begin_search(search, folder)
    items = list({item.key: item for point in points for item in search.plan.tests(search.before, point)}.values())
    left = [item for item in items if folder.outcome(item.key) is None]
    done = len(items) - len(left)
    bar.begin(done)

    def tell(key: str, failed: bool) -> None:
        nonlocal done
        done += 1
        bar.show(done, len(items), f"{done:,} of {len(items):,} tested")

    with doing(search, folder, place, tell, say=bar.say) as do:
        do(left)


def _begin_search(search: Search, folder: Folder) -> None:
    """Make the folder of a search, or go on in it, also with another number of trials."""
    content = _recorded(search)
    folder.begin(content, "same", "same")
    there = folder.read()
    if there["plan"]["trials"] != search.plan.trials:
        kept = {word: value for word, value in there.items() if word not in ("format", "digest")}
        folder.write(kept | {"plan": content["plan"]})


def _share(most: int, share: tuple[int, int] | None) -> int | None:
    """Of how many trials a share asks at most."""
    return None if share is None else most // share[1] + (0 < share[0] <= most % share[1])


def _retry_failed(plan: SearchPlan, before: str, folder: Folder) -> None:
    """Leave trials of which a run has failed as if they were under way, so that the next asker takes them over.

    Raises:
        ModelError: others work in the folder, or the journal is damaged.
    """
    with locked(folder.claims / ".ask"):
        if others := claimed(folder.claims):
            message = f"{folder.path}: others work in it, on {len(others)} runs or trials"
            raise ModelError(message, hint="what failed is done again when no other call does")
        state = optuna().trial.TrialState.FAIL
        trials = [trial for trial in trials_of(folder) if trial.state == state]
        items = {trial._trial_id: plan.items(before, point_of(plan, trial.params)) for trial in trials}
        found = folder.outcomes({item.key: None for each in items.values() for item in each})
        failed = {key for key, outcome in found.items() if outcome.failed}
        again = {number for number, each in items.items() if any(item.key in failed for item in each)}
        journal_of(folder).forget_ends(again, state.value)
        for key in failed:
            folder.forget(key)


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
        The table; `neuro_sweeps.table.table_of(out)` gives it while it fills, also in another process.

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
