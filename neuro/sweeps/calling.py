"""`neuro.sweep`: a function over a space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from os import PathLike
from typing import Any

from neuro.core.checks import check
from neuro.core.paths import file_path
from neuro.core.progress import Bar
from neuro.core.quantities import Quantity
from neuro.sweeps.definition import limits_of, python_sweep
from neuro.sweeps.execute import execute
from neuro.sweeps.executors import HERE, place_of
from neuro.sweeps.folder import SWEEP, Folder
from neuro.sweeps.space import space_of
from neuro.sweeps.table import SweepTable, table_of

_FLAG = Quantity(kind="boolean")


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
    part: str | None = None,
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
        part: "I/N" for one of N parts, for array jobs.
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
    limits, place = limits_of(time_limit, memory_limit), place_of(on, workers, part)
    made = python_sweep(function, points, limits, set, place.on == HERE)
    folder = Folder(file_path(out, "out"), SWEEP)
    again = check(_FLAG, retry_failed, "retry_failed")
    hear = None if each is None else lambda key: each(table_of(folder.path))
    with Bar() if check(_FLAG, progress, "progress") else nullcontext() as bar:
        execute(made, folder, place, retry=again, bar=bar, hear=hear)
    return table_of(folder.path)
