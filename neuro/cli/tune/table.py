"""`neuro tune table`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.tune.options import Tuned

Out = Annotated[Path | None, typer.Option(metavar="FILE", help="A file .csv or .parquet; printed as CSV if not given.")]
Times = Annotated[bool, typer.Option("--times", help="Also how long the runs of each took together.")]
Runs = Annotated[bool, typer.Option("--runs", help="A row for each run of a trial, each seed and fold, instead.")]


def table(folder: Tuned, out: Out = None, times: Times = False, runs: Runs = False) -> None:
    """Print or write a row for each trial: outcome, parameters, means of the metrics, whether no other beats it."""
    from neuro.sweeps.tuning.table import tune_table_of

    found = tune_table_of(folder)
    chosen = found.runs() if runs else found
    if out is None:
        typer.echo(chosen.csv(times), nl=False)
        return
    chosen.save(out, times)
    typer.echo(f"{out}: {len(chosen):,} rows")
