"""`neuro events view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Sensor, count, going, named, spare, watched

Out = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="The page; IN.html in the current folder.")]
Most = Annotated[Any, typer.Option("--most", metavar="N", parser=count, help="Show at most so many events.")]


def view(
    source: In,
    out: Out = None,
    most: Most = 500_000,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Write a page on which a browser plays the recording; the page needs nothing else."""
    from neuro.events.convert import read
    from neuro.events.view import PAGE, view as write

    name = named(source)
    target = Path(f"{name}.html") if out is None else out
    spare(source, target, PAGE, force)
    with going(f"{target} is not written") as bar:
        parts = watched(read(source, from_format, sensor, not lenient), bar)
        step = write(parts, target, title=name, most=most, replace=force)
    shown = "all events" if step == 1 else f"one of every {step:,} events; --most shows more"
    typer.echo(f"{target}: {shown}")
