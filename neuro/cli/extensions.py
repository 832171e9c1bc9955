"""`--with FILE.py`, which every command takes: parts of the user's own, registered before anything is looked up."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer


def with_extensions(command: Any) -> Any:
    """A command, or a group with all its commands, that takes `--with`."""
    for inner in getattr(command, "commands", {}).values():
        with_extensions(inner)
    if not hasattr(command, "commands") and not any("--with" in one.opts for one in command.params):
        command.params.append(_option())
    return command


@cache
def _option() -> Any:
    """The option, as typer makes it: eager, so that it comes before all that may name a part."""
    app = typer.Typer(add_completion=False)
    app.command()(_declared)
    return next(one for one in typer.main.get_command(app).params if "--with" in one.opts)


def _run(files: list[Path]) -> list[Path]:
    from neuro.core.extension import extensions, run_extension
    from neuro.core.launch import speaks

    for file in files or []:
        if speaks() and str(file.resolve()) not in extensions():
            typer.echo(f"neuro: running {file} (--with)", err=True)
        run_extension(file)
    return files


def _declared(
    files: Annotated[
        list[Path],
        typer.Option(
            "--with",
            metavar="FILE.py",
            is_eager=True,
            expose_value=False,
            callback=_run,
            help="Run a Python file first, whose parts are registered; repeatable.",
        ),
    ] = [],  # noqa: B006
) -> None:
    """Declare it."""
