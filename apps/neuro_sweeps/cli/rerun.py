"""The command `neuro rerun`, which repeats the computation of a file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import input_file

RepeatedFile = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        callback=input_file("results, a model, a page, or the folder of a run", or_folder=True),
        help="File to repeat: results, a model or a page; or the folder of a run.",
    ),
]
OtherBackend = Annotated[
    str, typer.Option("--backend", metavar="NAME", help="Run on this backend instead of the recorded one.")
]
MovedTo = Annotated[
    list[Path],
    typer.Option("--moved-to", metavar="FOLDER", help="Search this folder for moved inputs, by content; repeatable."),
]
Against = Annotated[
    Path | None, typer.Option(metavar="OTHER", help="Compare with this file instead of repeating the computation.")
]


def rerun(
    context: typer.Context,
    file: RepeatedFile,
    backend: OtherBackend = "",
    moved_to: MovedTo = [],  # noqa: B006
    against: Against = None,
) -> None:
    """Repeat the run that wrote a file, and report whether the results have the same bits, or the first difference.

    Changes of versions and inputs since then are listed as well.
    """
    from neuro.apps import Bar, printable
    from neuro_sweeps.cli.recorded import repeated
    from neuro_sweeps.rerun import rerun as repeat_file

    repeat = partial(repeated, context.find_root().command)
    with Bar() as bar:
        bar.say("running again")
        verdict = repeat_file(file, backend=backend, inputs=moved_to, against=against, bar=bar, repeat=repeat)
    typer.echo(printable(f"{file}: " + ("the same bits" if verdict.same else f"not the same: {verdict.difference}")))
    for line in verdict.changed:
        typer.echo(printable(f"changed: {line}"))
    if not verdict.same:
        raise typer.Exit(1)
