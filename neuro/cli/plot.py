"""`neuro plot`."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import milliseconds

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Format(StrEnum):
    """Formats of pictures."""

    png = "png"
    pdf = "pdf"
    svg = "svg"


File = Annotated[Path, typer.Argument(metavar="FILE", help="Results that 'neuro run' wrote.")]
Folder = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; beside FILE if not given.")]
Window = Annotated[
    tuple[float, float] | None, typer.Option("--window", metavar="BEGIN END", help="Only this stretch, in ms.")
]
Of = Annotated[
    list[str], typer.Option("--of", "--population", metavar="NAME", help="Only this population; repeatable.")
]
Bin = Annotated[float | None, typer.Option("--bin", metavar="MS", parser=milliseconds, help="Bins of the rates.")]
As = Annotated[Format, typer.Option("--format", help="Of the pictures.")]


def plot(
    file: File,
    out: Folder = None,
    window: Window = None,
    of: Of = [],  # noqa: B006
    bin: Bin = None,
    format: As = Format.png,
) -> None:
    """Draw the spikes, rates and traces of a run as pictures."""
    from neuro import plots
    from neuro.core.errors import ModelError, unknown
    from neuro.core.outputs import make_folder, write_picture
    from neuro.files.results import read

    results = read(file)
    for name in of:
        if name not in results.populations:
            raise unknown("population", name, results.populations)
    names = of or None
    probes = [name for name, trace in results.traces.items() if not of or trace.population in of]
    draw: dict[str, Callable[[], Figure]] = {}
    if of or any(train.recorded for train in results.populations.values()):
        draw["raster"] = lambda: plots.raster(results, names, window=window)
        draw["rates"] = lambda: plots.rate(results, names, bin=bin, window=window)
    if probes:
        draw["traces"] = lambda: plots.trace(results, probes, window=window)
    if not draw:
        raise ModelError(f"{file}: holds neither spikes nor traces", hint="'neuro run --record NAME' keeps spikes")
    folder = file.parent if out is None else out
    make_folder(folder)
    for what, picture in draw.items():
        path = folder / f"{file.stem}-{what}.{format.value}"
        write_picture(path, picture())
        typer.echo(path)
