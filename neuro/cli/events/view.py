"""`neuro events view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.cli.events.options import File, Force, From, Lenient, Sensor, count, going, spare

Out = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="The page; FILE.html if not given.")]
Most = Annotated[Any, typer.Option("--most", metavar="N", parser=count, help="Show at most so many events.")]


def view(
    file: File,
    out: Out = None,
    most: Most = 500_000,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Write a page on which a browser plays the recording; the page needs nothing else."""
    from neuro.events.convert import read
    from neuro.events.view import view as write

    target = file.with_name(f"{file.name}.html") if out is None else out
    spare(file, target, force)
    with going(f"{target} is not written"):
        step = write(read(file, from_format, sensor, not lenient), target, title=file.name, most=most)
    shown = "all events" if step == 1 else f"one of every {step:,} events; --most shows more"
    typer.echo(f"{target}: {shown}")
