"""`neuro events tohdf5`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.cli.events.options import Sensor, count, going

Folder = Annotated[Path, typer.Option("--folder", "-f", metavar="FOLDER", help="Recordings, a folder or zip.")]
Ending = Annotated[str | None, typer.Option("--ending", "-e", metavar="ENDING", help="Only such files, as bin.")]
Out = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The HDF5 file to write.")]
Part = Annotated[str | None, typer.Option("--part", metavar="NAME", help="Only this part, such as Train.")]
LayoutName = Annotated[str | None, typer.Option("--layout", metavar="NAME", help="Such as nmnist, instead of looking.")]
Jobs = Annotated[Any, typer.Option("--jobs", metavar="N", parser=count, help="Processes; one for each core.")]
Strict = Annotated[bool, typer.Option("--strict", help="Stop at a damaged file instead of leaving it out.")]
Mend = Annotated[bool, typer.Option("--lenient", help="Take what is whole of damaged files.")]


def tohdf5(
    folder: Folder,
    out: Out,
    ending: Ending = None,
    part: Part = None,
    layout: LayoutName = None,
    sensor: Sensor = None,
    jobs: Jobs = None,
    strict: Strict = False,
    lenient: Mend = False,
) -> None:
    """Gather a data set into one HDF5 file, /class/sample; after a kill the same command goes on where it was."""
    from neuro.core.errors import ModelError
    from neuro.events.dataset import Dataset

    if not out.parent.is_dir():
        raise ModelError(f"{out}: there is no folder {out.parent}")
    if strict and lenient:
        raise typer.BadParameter("expected one of the two", param_hint="'--strict' / '--lenient'")
    choice = "stop" if strict else "mend" if lenient else "skip"
    data = Dataset(folder, part=part, layout=layout, ending=ending, sensor_size=sensor)
    with going("the same command goes on where it was") as bar:
        done = data.to_hdf5(out, jobs=jobs, damaged=choice, report=bar.count)
    typer.echo(f"{out}: {done.samples:,} recordings of {len(data.classes)} classes")
    if done.damaged:
        files = f"{len(done.damaged):,} damaged file{'s' if len(done.damaged) > 1 else ''}"
        typer.echo(f"{files}, {_FATE[choice]}:", err=True)
        for path, what in done.damaged.items():
            typer.echo(f"  {path}: {what}", err=True)
        raise typer.Exit(1)


_FATE = {"skip": "left out", "mend": "read as far as they are whole"}
