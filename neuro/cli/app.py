"""All commands in one table; what they compute with is imported when one of them runs."""

from __future__ import annotations

from typing import Annotated

import typer

from neuro.cli.backends import backends
from neuro.cli.check import check
from neuro.cli.commands import Commands
from neuro.cli.compare import compare
from neuro.cli.energy import energy
from neuro.cli.events import app as events, shell
from neuro.cli.example import example
from neuro.cli.fit import fit
from neuro.cli.models import models
from neuro.cli.new import new
from neuro.cli.plot import plot
from neuro.cli.report import report
from neuro.cli.rerun import rerun
from neuro.cli.run import run
from neuro.cli.schema import schema
from neuro.cli.show import show
from neuro.cli.sweep import app as sweep
from neuro.cli.tune import app as tune
from neuro.cli.verify import verify
from neuro.core.version import VERSION

COMMANDS = (
    new,
    example,
    run,
    rerun,
    plot,
    report,
    compare,
    check,
    show,
    fit,
    energy,
    schema,
    verify,
    models,
    backends,
    shell,
)

app = typer.Typer(cls=Commands, name="neuro", add_completion=False, pretty_exceptions_enable=False)
for command in COMMANDS:
    app.command()(command)
app.add_typer(events)
app.add_typer(sweep)
app.add_typer(tune)


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False,
) -> None:
    """Describe a spiking network once; run it on a fast simulator or on an emulated chip."""
    if version:
        typer.echo(f"neuro {VERSION}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
