"""`neuro tune`: the best points of a space, told, tabled and drawn."""

from __future__ import annotations

import typer

from neuro.cli.tune.held_out import held_out
from neuro.cli.tune.page import page
from neuro.cli.tune.plot import plot
from neuro.cli.tune.run import run
from neuro.cli.tune.status import status
from neuro.cli.tune.table import table

COMMANDS = (run, status, table, plot, page)

app = typer.Typer(name="tune", add_completion=False, pretty_exceptions_enable=False)
for command in COMMANDS:
    app.command()(command)
app.command("test")(held_out)


@app.callback(invoke_without_command=True)
def tune(context: typer.Context) -> None:
    """Look for the best parameters, by Optuna: one objective, or the front of several, such as accuracy and joules."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


__all__ = ["app"]
