"""`neuro rerun`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

File = Annotated[Path, typer.Argument(metavar="FILE", help="Results, a model, a page, or the folder of a run.")]
Backend = Annotated[str, typer.Option("--backend", metavar="NAME", help="Another one than it was made on.")]
Inputs = Annotated[
    list[Path], typer.Option(metavar="FOLDER", help="Look there for inputs that were moved, by content; repeatable.")
]
Against = Annotated[Path | None, typer.Option(metavar="OTHER", help="Compare with this file instead of making it.")]


def rerun(
    file: File,
    backend: Backend = "",
    inputs: Inputs = [],  # noqa: B006
    against: Against = None,
) -> None:
    """Make a file again from what it holds; tell whether it has the same bits, or what differs and what changed."""
    from neuro.core.progress import Bar
    from neuro.rerun.again import rerun as again

    with Bar() as bar:
        bar.say("running again")
        verdict = again(file, backend=backend, inputs=inputs, against=against, bar=bar)
    typer.echo(f"{file}: " + ("the same bits" if verdict.same else f"not the same: {verdict.difference}"))
    for line in verdict.changed:
        typer.echo(f"changed: {line}")
    if not verdict.same:
        raise typer.Exit(1)
