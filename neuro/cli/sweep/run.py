"""`neuro sweep run`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import whole

if TYPE_CHECKING:
    from neuro.sweeps.execute import Count
    from neuro.sweeps.folder import Folder


def workers(text: str) -> int:
    """A whole number >= 1."""
    return whole(text, 1)


File = Annotated[Path, typer.Argument(metavar="SWEEP", help="A sweep, as YAML.")]
Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Where runs are kept; what is there is not done again.")]
On = Annotated[
    str, typer.Option(metavar="WHERE", help="cores, here (this process), or a Dask scheduler: tcp://HOST:PORT, a file.")
]
Workers = Annotated[
    int | None, typer.Option(metavar="N", parser=workers, help="Processes; as many as there are cores if not given.")
]
Part = Annotated[str | None, typer.Option(metavar="I/N", help="Only the I-th of each N runs, for array jobs.")]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Do again what failed.")]


def run(
    file: File,
    out: Out = Path("runs"),
    on: On = "cores",
    workers: Workers = None,
    part: Part = None,
    retry_failed: Retry = False,
) -> None:
    """Do all runs of a sweep that the folder does not have; the same command goes on where it was."""
    from neuro.core.progress import Bar
    from neuro.sweeps.definition import load_sweep
    from neuro.sweeps.execute import Place, execute, part_of
    from neuro.sweeps.folder import SWEEP, Folder

    place = Place(on, workers, None if part is None else part_of(part))
    made, folder = load_sweep(file), Folder(out, SWEEP)
    with Bar() as bar:
        try:
            count = execute(made, folder, place, retry=retry_failed, bar=bar)
        except KeyboardInterrupt:
            bar.stop()
            typer.echo(f"interrupted: {out} keeps what is done; the same command goes on", err=True)
            raise typer.Exit(130) from None
    told(folder, count, part)


def told(folder: Folder, count: Count, part: str | None) -> None:
    """Say what came of it, write the page, and what to do next."""
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


def failures(folder: Folder, keys: list[str]) -> list[str]:
    """What went wrong, each reason once, with how often and where."""
    from neuro.sweeps.table import reasons

    lines = []
    for those in reasons(folder.outcomes(keys)):
        first = those[0].error.partition("\n")[0]
        alike = ", and others like it" if any(each.error != those[0].error for each in those) else ""
        lines.append(f"failed {len(those):,} x: {first}{alike} (first: {those[0].key[:10]})")
    return [*lines[:5], f"and {len(lines) - 5} more reasons, see the table"] if len(lines) > 5 else lines
