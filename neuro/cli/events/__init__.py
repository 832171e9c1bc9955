"""`neuro events`: files of event cameras looked at, converted, filtered, cut, drawn and gathered."""

from __future__ import annotations

import typer

from neuro.cli.events.looking import formats, gif, info, view
from neuro.cli.events.making import convert, filter, frames, split, tohdf5

COMMANDS = (info, formats, convert, filter, split, frames, gif, view, tohdf5)

app = typer.Typer(name="events", add_completion=False, pretty_exceptions_enable=False)
for command in COMMANDS:
    app.command()(command)


@app.callback(invoke_without_command=True)
def events(context: typer.Context) -> None:
    """Look at, convert, filter, cut, draw and gather the files of event cameras."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
