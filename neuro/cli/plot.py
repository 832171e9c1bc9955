"""`neuro plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

File = Annotated[Path, typer.Argument(metavar="FILE", help="Results that 'neuro run' wrote.")]
Folder = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; beside FILE if not given.")]


def plot(file: File, out: Folder = None) -> None:
    """Draw the spikes, rates and traces of a run as PNG files."""
    from neuro.core.errors import ModelError
    from neuro.core.outputs import make_folder, write_picture
    from neuro.files import plots
    from neuro.files.results import read

    results = read(file)
    folder = file.parent if out is None else out
    make_folder(folder)
    spikes = any(train.recorded for train in results.populations.values())
    pictures = [plots.raster, plots.rates] * spikes + [plots.traces] * bool(results.traces)
    if not pictures:
        raise ModelError(f"{file}: holds neither spikes nor traces", hint="'neuro run --record NAME' keeps spikes")
    for draw in pictures:
        path = folder / f"{file.stem}-{draw.__name__}.png"
        write_picture(path, draw(results))
        typer.echo(path)
