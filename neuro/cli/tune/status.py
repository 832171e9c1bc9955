"""`neuro tune status`."""

from __future__ import annotations

import typer

from neuro.cli.tune.options import Tuned


def status(folder: Tuned) -> None:
    """Tell how many trials are done, failed, pruned and left, which is the best so far, and why what failed did."""
    from neuro.cli.tune.run import told
    from neuro.sweeps.tuning.table import tune_table_of

    table = tune_table_of(folder)
    counts = ", ".join(f"{n:,} {word}" for word, n in table.counts().items())
    typer.echo(f"{table.name}: {table.plan.most:,} trials by {table.plan.sampler}: {counts}")
    for line in told(table):
        typer.echo(line)
