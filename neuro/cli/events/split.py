"""`neuro events split`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.cli.events.options import File, Force, From, Lenient, Sensor, count, going, microseconds, spare
from neuro.cli.options import milliseconds

Every = Annotated[Any, typer.Option("--every", metavar="MS", parser=milliseconds, help="Cut after so many ms.")]
Count = Annotated[Any, typer.Option("--count", metavar="N", parser=count, help="Cut after so many events.")]
Folder = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; beside FILE if not given.")]
As = Annotated[str | None, typer.Option("--as", metavar="ENDING", help="Such as .h5; that of FILE if not given.")]


def split(
    file: File,
    every: Every = None,
    count: Count = None,
    out: Folder = None,
    ending: As = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Cut a recording into files of equal time or equally many events; windows without events give no file."""
    from neuro.events import save, stream

    if (every is None) == (count is None):
        raise typer.BadParameter("expected one of the two", param_hint="'--every' / '--count'")
    window = None if every is None else microseconds(every, "'--every'")
    folder = file.parent if out is None else out
    suffix = file.suffix if ending is None else f".{ending.lstrip('.')}"
    parts = stream(
        file, window_us=window, count=count, format=from_format, sensor_size=sensor, strict=not lenient
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    written = empty = 0
    with going("files written so far are whole") as bar:
        for k, part in enumerate(parts):
            if not len(part):
                empty += 1
                continue
            target = folder / f"{file.stem}-{k:05d}{suffix}"
            spare(file, target, force)
            save(part, target)
            written += 1
            bar.say(f"{written:,} files")
    without = f"; {empty:,} windows without events" if empty else ""
    typer.echo(f"{folder / file.stem}-*{suffix}: {written:,} files{without}")
