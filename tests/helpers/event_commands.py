"""`neuro events` without the other commands."""

import typer

from neuro.cli.commands import Commands
from neuro_events.cli import app


def root():
    made = typer.Typer(cls=Commands, name="neuro", add_completion=False, pretty_exceptions_enable=False)
    made.add_typer(app)
    made.command("show")(lambda: None)
    made.callback()(lambda: None)
    return made
