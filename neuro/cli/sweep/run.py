"""`neuro sweep run`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.sweep.options import On, Out, Retry, Workers

if TYPE_CHECKING:
    from neuro.sweeps.execute import Count
    from neuro.sweeps.folder import Folder


File = Annotated[Path, typer.Argument(metavar="SWEEP", help="A sweep, as YAML.")]
Part = Annotated[str | None, typer.Option(metavar="I/N", help="Only the I-th of each N runs, for array jobs.")]


def run(
    file: File,
    out: Out = Path("runs"),
    on: On = "cores",
    workers: Workers = None,
    part: Part = None,
    retry_failed: Retry = False,
) -> None:
    """Do all runs of a sweep that the folder does not have; the same command goes on where it was."""
    from neuro.cli.sweep.going import going
    from neuro.sweeps.definition import load_sweep
    from neuro.sweeps.execute import execute
    from neuro.sweeps.folder import SWEEP, Folder
    from neuro.sweeps.place import place_of

    place = place_of(on, workers, part)
    made, folder = load_sweep(file), Folder(out, SWEEP)
    with going(out) as bar:
        count = execute(made, folder, place, retry=retry_failed, bar=bar)
    told(folder, count, part)


def told(folder: Folder, count: Count, part: str | None) -> None:
    """Say what came of it, write the page, and what to do next."""
    from neuro.cli.sweep.going import failures
    from neuro.sweeps.page import write_page
    from neuro.sweeps.table import table_of

    name = shlex.quote(str(folder.path))
    typer.echo(f"{folder.path}: {f'part {part}: ' if part else ''}{count}")
    table = table_of(folder.path)
    for line in failures(folder, list(table.keys)):
        typer.echo(line)
    if not table.counts()["left"]:
        typer.echo(f"{write_page(table)}: written")
    typer.echo(f"next: neuro sweep table {name}, or neuro sweep plot {name}")
