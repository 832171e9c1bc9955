"""All commands in one table; what they compute with is imported when one of them runs."""

from __future__ import annotations

from typing import Annotated

import typer

from neuro.cli.catalogue import backends, models, schema
from neuro.cli.check import check, show
from neuro.cli.chips import energy, fit
from neuro.cli.commands import Commands
from neuro.cli.compare import compare, verify
from neuro.cli.events import app as events, shell
from neuro.cli.pictures import plot, report
from neuro.cli.run import rerun, run
from neuro.cli.start import example, new
from neuro.cli.sweep import app as sweep
from neuro.cli.tune import app as tune
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
