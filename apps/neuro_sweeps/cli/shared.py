"""Options and reports that `neuro sweep` and `neuro tune` share."""

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


Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Where runs are kept; what is there is not done again.")]
On = Annotated[
    str, typer.Option(metavar="WHERE", help="cores, here (this process), or a Dask scheduler: tcp://HOST:PORT, a file.")
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="N", parser=at_least(1), help="Processes; as many as there are cores if not given."),
]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Do again what failed.")]
TableFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="A file .csv or .parquet; printed as CSV if not given.")
]
Pictures = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; into FOLDER if not given.")]


def going(out: Path) -> AbstractContextManager[Bar]:
    """A bar while runs are done; an interrupt is answered with how to go on."""
    return stoppable(f"{out} keeps what is done; the same command goes on")


def echo_failures(folder: Folder, keys: Sequence[str]) -> None:
    """Print why runs failed, each of the first five reasons once, with how often and where."""
    from neuro_sweeps.table import reasons

    failed = reasons(folder.outcomes(keys))
    for those in failed[:5]:
        first = those[0].error.partition("\n")[0]
        alike = ", and others like it" if any(each.error != those[0].error for each in those) else ""
        typer.echo(f"failed {len(those):,} x: {first}{alike} (first: {those[0].key[:10]})")
    if len(failed) > 5:
        typer.echo(f"and {len(failed) - 5} more reasons, see the table")


def echo_next(found: SweepTable | TuneTable, command: str, left: int, more: str = "") -> None:
    """Write the page when all is done, and print what to do next."""
    from neuro_sweeps.page import write_page

    if not left:
        typer.echo(f"{write_page(found)}: written")
    name = shlex.quote(str(found.path))
    typer.echo(f"next: neuro {command} table {name}, or neuro {command} plot {name}{more}")


def all_counts(counts: Mapping[str, int]) -> str:
    """How many came to what, also none."""
    return ", ".join(f"{n:,} {word}" for word, n in counts.items())


def put_table(found: RunRows, out: Path | None, times: bool) -> None:
    """Write a table to a file, or print it as CSV."""
    if out is None:
        typer.echo(found.csv(times), nl=False)
        return
    found.save(out, times)
    typer.echo(f"{out}: {len(found):,} rows")
