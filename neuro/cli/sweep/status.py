"""`neuro sweep status`."""

from __future__ import annotations

import typer

from neuro.cli.sweep.options import Runs


def status(folder: Runs) -> None:
    """Tell how many runs are done, failed, under way and left, and why what failed did."""
    from neuro.cli.sweep.going import failures
    from neuro.sweeps.folder import Folder
    from neuro.sweeps.table import table_of

    table = table_of(folder)
    counts = table.counts()
    typer.echo(f"{table.name}: {len(table):,} runs: " + ", ".join(f"{n:,} {word}" for word, n in counts.items()))
    for line in failures(Folder(folder), list(table.keys)):
        typer.echo(line)
