"""Options and outputs that `neuro sweep` and `neuro tune` share."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.apps import Bar, at_least, stoppable

if TYPE_CHECKING:
    from neuro_sweeps.folder import Folder
    from neuro_sweeps.table import RunRows, SweepTable
    from neuro_sweeps.trials import TuneTable


Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the runs; runs in it are not repeated.")]
On = Annotated[
    str,
    typer.Option(
        metavar="WHERE",
        help="Place of the runs: cores, here (this process), or a Dask scheduler: tcp://HOST:PORT, a file.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="N", parser=at_least(1), help="Number of processes; default: the number of cores."),
]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Repeat failed runs.")]
TableFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="File .csv or .parquet; default: print as CSV.")
]
Pictures = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Folder for the pictures; default: the folder of the runs."),
]


def progress_bar(out: Path) -> AbstractContextManager[Bar]:
    """Return a progress bar. After an interrupt a message explains how to continue."""
    return stoppable(f"finished runs are kept in {out}; run the same command again to continue")


def echo_failures(folder: Folder, keys: Sequence[str]) -> None:
    """Print the five most frequent errors, with the number of runs and the first run of each."""
    from neuro_sweeps.table import failures_by_reason

    groups = failures_by_reason(folder.outcomes(keys))
    for runs in groups[:5]:
        first = runs[0].error.partition("\n")[0]
        similar = ", and similar errors" if any(each.error != runs[0].error for each in runs) else ""
        typer.echo(f"failed {len(runs):,} x: {first}{similar} (first: {runs[0].key[:10]})")
    if len(groups) > 5:
        typer.echo(f"and {len(groups) - 5} more errors, see the table")


def echo_next(table: SweepTable | TuneTable, command: str, remaining: int, more: str = "") -> None:
    """Write the page if no run is left, and print the next commands."""
    from neuro_sweeps.page import write_page

    if not remaining:
        typer.echo(f"{write_page(table)}: written")
    name = shlex.quote(str(table.path))
    typer.echo(f"next: neuro {command} table {name}, or neuro {command} plot {name}{more}")


def all_counts(counts: Mapping[str, int]) -> str:
    """Return all numbers by outcome as text, including 0."""
    return ", ".join(f"{n:,} {word}" for word, n in counts.items())


def write_table(table: RunRows, out: Path | None, times: bool) -> None:
    """Write a table to a file, or print it as CSV."""
    if out is None:
        typer.echo(table.csv(times), nl=False)
        return
    table.save(out, times)
    typer.echo(f"{out}: {len(table):,} rows")
