"""`neuro events`: files of event cameras looked at, converted, filtered, cut, drawn and gathered."""

from __future__ import annotations

import typer

from neuro.cli.events.convert import convert
from neuro.cli.events.filter import filter
from neuro.cli.events.formats import formats
from neuro.cli.events.frames import frames
from neuro.cli.events.gif import gif
from neuro.cli.events.info import info
from neuro.cli.events.shell import shell
from neuro.cli.events.split import split
from neuro.cli.events.tohdf5 import tohdf5
from neuro.cli.events.view import view

COMMANDS = (info, formats, convert, filter, split, frames, gif, view, tohdf5, shell)

app = typer.Typer(name="events", add_completion=False, pretty_exceptions_enable=False)
for command in COMMANDS:
    app.command()(command)


@app.callback(invoke_without_command=True)
def events(context: typer.Context) -> None:
    """Look at, convert, filter, cut, draw and gather the files of event cameras."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


__all__ = ["app", "shell"]
