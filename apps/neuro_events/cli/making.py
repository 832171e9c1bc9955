"""`neuro events convert`, `filter`, `split`, `frames` and `tohdf5`: recordings made into other files."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import milliseconds
from neuro_events.cli.options import (
    Force,
    From,
    In,
    Lenient,
    Out,
    Sensor,
    To,
    chosen,
    count,
    events_so_far,
    going,
    list_parts,
    microseconds,
    named,
    spare,
)

if TYPE_CHECKING:
    from neuro_events import Events
    from neuro_events.filters import Chain, Filter


def convert(
    source: In,
    target: Out,
    from_format: From = None,
    to_format: To = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Write a recording in another format, chosen by the ending of OUT."""
    from neuro_events.convert import comes_once, convert as write
    from neuro_events.files import RECORDING

    spare(source, target, RECORDING, force)
    with going(f"{target} is not written") as bar:
        done = write(
            source, target, from_format=from_format, to_format=to_format, sensor_size=sensor, strict=not lenient,
            report=events_so_far(bar), replace=force, keep=comes_once(source),
        )  # fmt: skip
    typer.echo(f"{target}: {done:,} events", err=target == "-")


Filters = Annotated[
    list[str], typer.Argument(metavar="FILTER...", help="A name, or 'name: {parameter: value}'; see --list.")
]


def filter(
    source: In,
    target: Out,
    filters: Filters,
    from_format: From = None,
    to_format: To = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
    list_all: Annotated[
        bool, typer.Option("--list", callback=lambda given: _list_filters(given), help="List all filters.")
    ] = False,
) -> None:
    """Write a recording through filters, one after the other: 'tar: {tau: 0.08}' 'crop: {x: [0, 300]}'."""
    from neuro_events.convert import comes_once, read, write
    from neuro_events.files import RECORDING
    from neuro_events.filters import Filter, chain

    spare(source, target, RECORDING, force)
    parts = [_parsed(text) for text in filters]
    seen = 0

    def through() -> Iterator[Events]:
        nonlocal seen
        made: Chain | None = None
        for part in read(source, from_format, sensor, not lenient):
            if made is None:
                size, steps = part.sensor_size, list[Filter]()
                for kind, values in parts:
                    steps.append(kind(size, **values))
                    size = steps[-1].out_size
                made = chain(*steps)
            seen += len(part)
            yield made(part)
        if made is not None:
            yield made.finish()

    with going(f"{target} is not written") as bar:
        done = write(through(), target, to_format, events_so_far(bar), force, comes_once(source))
    typer.echo(f"{target}: {done:,} of {seen:,} events", err=target == "-")


def _parsed(text: str) -> tuple[type[Filter], dict[str, Any]]:
    """A filter and its parameters, written as any choice in a network is."""
    from neuro import ModelError
    from neuro_events.filters import FILTERS

    kind, values = chosen(text, FILTERS, "filter", "FILTER")
    if kind is FILTERS["hot"] and not values.get("pixels"):
        example = "such as 'hot: {pixels: [[8, 1], [205, 59]]}'"
        raise ModelError("filter 'hot': expected pixels", hint=f"{example}; 'neuro events info' lists the hot ones")
    return kind, values


def _list_filters(given: bool) -> None:
    if given:
        from neuro_events.filters import FILTERS

        list_parts(filter=FILTERS)


Every = Annotated[Any, typer.Option("--every", metavar="MS", parser=milliseconds, help="Cut after so many ms.")]
Count = Annotated[Any, typer.Option("--count", metavar="N", parser=count, help="Cut after so many events.")]
Folder = Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where to; the current folder.")]
Ending = Annotated[
    str | None, typer.Option("--to", metavar="FORMAT", help="An ending such as .h5; that of IN if not given.")
]


def split(
    source: In,
    every: Every = None,
    count: Count = None,
    out: Folder = Path(),
    to_ending: Ending = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Cut a recording into files of equal time or equally many events; windows without events give no file."""
    from neuro import ModelError
    from neuro.apps import make_folder
    from neuro_events import save, stream
    from neuro_events.convert import given
    from neuro_events.files import RECORDING

    if (every is None) == (count is None):
        raise typer.BadParameter("expected one of the two", param_hint="'--every' / '--count'")
    window = None if every is None else microseconds(every, "'--every'")
    name = Path(named(source))
    suffix = name.suffix.lower() if to_ending is None else f".{to_ending.lstrip('.')}"
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
    from neuro_events.files import RECORDING
    from neuro_events.formats import written as formats

    written = list(dict.fromkeys(ending for f in formats() for ending in f.suffixes))
    if suffix not in written:
        raise typer.BadParameter(f"'{suffix}': cannot be written, expected {', '.join(written)}", param_hint="'--to'")
    for there in sorted(out.iterdir()) if out.is_dir() else ():
        number = there.name.removeprefix(f"{stem}-").removesuffix(suffix)
        if there.name == f"{stem}-{number}{suffix}" and number.isdecimal():
            spare("-", there, RECORDING, force)


ArraysOut = Annotated[Path, typer.Argument(metavar="OUT.npz", help="The arrays: 'frames' and 'bounds'.")]
Representation = Annotated[
    str, typer.Option("--as", metavar="NAME", help="A representation, or 'name: {parameter: value}'.")
]
Cut = Annotated[
    str | None, typer.Option("--cut", metavar="NAME", help="A segmenter, likewise; the whole if not given.")
]


def frames(
    source: In,
    target: ArraysOut,
    representation: Representation = "event_frame",
    cut: Cut = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
    list_all: Annotated[
        bool,
        typer.Option("--list", callback=lambda given: _list_arrays(given), is_eager=True, help="List what there is."),
    ] = False,
) -> None:
    """Make arrays of a recording, one of each segment: --cut 'count_segments: {count: 5000}' --as hats."""
    import numpy as np

    from neuro import ModelError
    from neuro.apps import Kind, output
    from neuro_events import load
    from neuro_events.representations import REPRESENTATIONS
    from neuro_events.segmentation import SEGMENTERS

    make, values = chosen(representation, REPRESENTATIONS, "representation", "--as")
    cutter = None if cut is None else chosen(cut, SEGMENTERS, "segmenter", "--cut")
    if target.suffix != ".npz":
        raise typer.BadParameter(f"'{target}': expected a name that ends in .npz", param_hint="OUT.npz")
    arrays_kind = Kind("arrays of frames", ask="--force")
    spare(source, target, arrays_kind, force)
    events: Events = load(source, format=from_format, sensor_size=sensor, strict=not lenient)
    bounds = np.array([0, len(events)]) if cutter is None else np.asarray(cutter[0](events.t, **cutter[1]))
    if len(bounds) < 2:
        raise ModelError(f"{source}: '{cut}' finds no segment in {len(events):,} events")
    arrays = np.stack([np.asarray(make(events[a:b], **values)) for a, b in pairwise(bounds)])
    with output(target, arrays_kind, force) as part, part.open("wb") as file:
        np.savez_compressed(file, frames=arrays, bounds=bounds)
    typer.echo(f"{target}: {len(arrays):,} of {representation}, {list(arrays.shape[1:])} {arrays.dtype}")


def _list_arrays(given: bool) -> None:
    if given:
        from neuro_events.representations import REPRESENTATIONS
        from neuro_events.segmentation import SEGMENTERS

        list_parts(representation=REPRESENTATIONS, segmenter=SEGMENTERS)


DataFolder = Annotated[Path, typer.Option("--data", "-f", metavar="FOLDER", help="Recordings, a folder or zip.")]
OnlyEnding = Annotated[str | None, typer.Option("--ending", "-e", metavar="ENDING", help="Only such files, as bin.")]
StoreOut = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The HDF5 file to write.")]
Part = Annotated[str | None, typer.Option("--part", metavar="NAME", help="Only this part, such as Train.")]
LayoutName = Annotated[str | None, typer.Option("--layout", metavar="NAME", help="Such as nmnist, instead of looking.")]
Workers = Annotated[Any, typer.Option("--workers", metavar="N", parser=count, help="Processes; one for each core.")]
Strict = Annotated[bool, typer.Option("--strict", help="Stop at a damaged file instead of leaving it out.")]
Mend = Annotated[bool, typer.Option("--lenient", help="Take what is whole of damaged files.")]


def tohdf5(
    data: DataFolder,
    out: StoreOut,
    ending: OnlyEnding = None,
    part: Part = None,
    layout: LayoutName = None,
    sensor: Sensor = None,
    workers: Workers = None,
    strict: Strict = False,
    lenient: Mend = False,
) -> None:
    """Gather a data set into one HDF5 file, /class/sample; after a kill the same command goes on where it was."""
    from neuro import ModelError
    from neuro_events.dataset import Dataset

    if not out.parent.is_dir():
        raise ModelError(f"{out}: there is no folder {out.parent}")
    if strict and lenient:
        raise typer.BadParameter("expected one of the two", param_hint="'--strict' / '--lenient'")
    choice = "stop" if strict else "mend" if lenient else "skip"
    found = Dataset(data, part=part, layout=layout, ending=ending, sensor_size=sensor)
    with going("the same command goes on where it was") as bar:

        def report(what: str, done: int, total: int) -> None:
            bar.show(done, total, f"{what}: {done:,} of {total:,}")

        done = found.to_hdf5(out, jobs=workers, damaged=choice, report=report)
    typer.echo(f"{out}: {done.samples:,} recordings of {len(found.classes)} classes")
    if done.damaged:
        files = f"{len(done.damaged):,} damaged file{'s' if len(done.damaged) > 1 else ''}"
        typer.echo(f"{files}, {_FATE[choice]}:", err=True)
        for path, what in done.damaged.items():
            typer.echo(f"  {path}: {what}", err=True)
        raise typer.Exit(1)


_FATE = {"skip": "left out", "mend": "read as far as they are whole"}
