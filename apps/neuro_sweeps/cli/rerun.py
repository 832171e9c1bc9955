"""A file made again from what it holds: `neuro rerun`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

Made = Annotated[Path, typer.Argument(metavar="FILE", help="Results, a model, a page, or the folder of a run.")]
OtherBackend = Annotated[str, typer.Option("--backend", metavar="NAME", help="Another one than it was made on.")]
MovedTo = Annotated[
    list[Path],
    typer.Option("--moved-to", metavar="FOLDER", help="Look there for inputs that were moved, by content; repeatable."),
]
Against = Annotated[Path | None, typer.Option(metavar="OTHER", help="Compare with this file instead of making it.")]


def rerun(
    context: typer.Context,
    file: Made,
    backend: OtherBackend = "",
    moved_to: MovedTo = [],  # noqa: B006
    against: Against = None,
) -> None:
    """Make a file again from what it holds; report whether it has the same bits, or what differs and what changed."""
    from neuro.apps import Bar, printable
    from neuro_sweeps.cli.recorded import repeated
    from neuro_sweeps.rerun import rerun as again

    repeat = partial(repeated, context.find_root().command)
    with Bar() as bar:
        bar.say("running again")
        verdict = again(file, backend=backend, inputs=moved_to, against=against, bar=bar, repeat=repeat)
    typer.echo(printable(f"{file}: " + ("the same bits" if verdict.same else f"not the same: {verdict.difference}")))
    for line in verdict.changed:
        typer.echo(printable(f"changed: {line}"))
    if not verdict.same:
        raise typer.Exit(1)
