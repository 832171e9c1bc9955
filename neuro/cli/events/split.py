"""`neuro events split`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Sensor, count, going, microseconds, named, spare
from neuro.cli.options import milliseconds

Every = Annotated[Any, typer.Option("--every", metavar="MS", parser=milliseconds, help="Cut after so many ms.")]
Count = Annotated[Any, typer.Option("--count", metavar="N", parser=count, help="Cut after so many events.")]
Folder = Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where to; the current folder.")]
As = Annotated[str | None, typer.Option("--as", metavar="ENDING", help="Such as .h5; that of IN if not given.")]


def split(
    source: In,
    every: Every = None,
    count: Count = None,
    out: Folder = Path(),
    ending: As = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Cut a recording into files of equal time or equally many events; windows without events give no file."""
    from neuro.core.errors import ModelError
    from neuro.core.outputs import make_folder
    from neuro.events import save, stream
    from neuro.events.convert import given
    from neuro.events.files import RECORDING

    if (every is None) == (count is None):
        raise typer.BadParameter("expected one of the two", param_hint="'--every' / '--count'")
    window = None if every is None else microseconds(every, "'--every'")
    name = Path(named(source))
    suffix = name.suffix.lower() if ending is None else f".{ending.lstrip('.')}"
    _room(out, name.stem, suffix, force)
    file, called = given(source)
    parts = stream(
        file, window_us=window, count=count, format=from_format, sensor_size=sensor, name=called, strict=not lenient
    )  # fmt: skip
    written = empty = 0
    with going("files written so far are whole") as bar:
        for k, part in enumerate(parts):
            if not len(part):
                empty += 1
                continue
            make_folder(out)
            target = out / f"{name.stem}-{k:05d}{suffix}"
            spare(source, target, RECORDING, force)
            save(part, target, replace=force)
            written += 1
            bar.say(f"{written:,} files")
    if not written:
        raise ModelError(f"{source}: the recording has no events: nothing to cut")
    files = "1 file" if written == 1 else f"{written:,} files"
    without = f"; {empty:,} windows without events" if empty else ""
    typer.echo(f"{out / name.stem}-*{suffix}: {files}{without}")


def _room(out: Path, stem: str, suffix: str, force: bool) -> None:
    """Refuse at once what would be refused after a part of the work."""
    from neuro.events.files import RECORDING
    from neuro.events.formats import written as formats

    written = list(dict.fromkeys(ending for f in formats() for ending in f.suffixes))
    if suffix not in written:
        raise typer.BadParameter(f"'{suffix}': cannot be written, expected {', '.join(written)}", param_hint="'--as'")
    for there in sorted(out.iterdir()) if out.is_dir() else ():
        number = there.name.removeprefix(f"{stem}-").removesuffix(suffix)
        if there.name == f"{stem}-{number}{suffix}" and number.isdecimal():
            spare("-", there, RECORDING, force)
