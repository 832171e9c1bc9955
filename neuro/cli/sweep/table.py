"""`neuro sweep table`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.sweep.options import Runs

Out = Annotated[Path | None, typer.Option(metavar="FILE", help="A file .csv or .parquet; printed as CSV if not given.")]
Times = Annotated[bool, typer.Option("--times", help="Also how long each took, and how often it was begun.")]


def table(folder: Runs, out: Out = None, times: Times = False) -> None:
    """Print or write a row for each run: outcome, parameters, seed, metrics and error."""
    from neuro.sweeps.table import table_of

    found = table_of(folder)
    if out is None:
        typer.echo(found.csv(times), nl=False)
        return
    found.save(out, times)
    typer.echo(f"{out}: {len(found):,} rows")
