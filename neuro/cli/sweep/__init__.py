"""`neuro sweep`: many runs over a space, told, tabled and drawn."""

from __future__ import annotations

import typer

from neuro.cli.sweep.page import page
from neuro.cli.sweep.plot import plot
from neuro.cli.sweep.run import run
from neuro.cli.sweep.status import status
from neuro.cli.sweep.table import table

COMMANDS = (run, status, table, plot, page)

app = typer.Typer(name="sweep", add_completion=False, pretty_exceptions_enable=False)
for command in COMMANDS:
    app.command()(command)


@app.callback(invoke_without_command=True)
def sweep(context: typer.Context) -> None:
    """Run something at many points and with many seeds, on this machine or many; tell, table and draw what came."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


__all__ = ["app"]
