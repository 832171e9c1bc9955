"""The commands `neuro events convert`, `filter`, `split`, `frames` and `tohdf5`, which write files from recordings."""

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
    base_name,
    check_target,
    count,
    events_so_far,
    list_parts,
    microseconds,
    parse_choice,
    progress,
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
    """Convert a recording to another format, chosen by the ending of OUT."""
    from neuro_events.convert import comes_once, convert as write
    from neuro_events.files import RECORDING

    check_target(source, target, RECORDING, force)
    with progress(f"{target} is not written") as bar:
        n_events = write(
            source, target, from_format=from_format, to_format=to_format, sensor_size=sensor, strict=not lenient,
            report=events_so_far(bar), replace=force, keep=comes_once(source),
        )  # fmt: skip
    typer.echo(f"{target}: {n_events:,} events", err=target == "-")


Filters = Annotated[
    list[str], typer.Argument(metavar="FILTER...", help="Name of a filter, or 'name: {parameter: value}'; see --list.")
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
        bool, typer.Option("--list", callback=lambda is_set: _list_filters(is_set), help="List the filters and exit.")
    ] = False,
) -> None:
    """Filter a recording with one or more filters in order, e.g. 'tar: {tau: 0.08}' 'crop: {x: [0, 300]}'."""
    from neuro_events.convert import comes_once, read, write
    from neuro_events.files import RECORDING
    from neuro_events.filters import Filter, chain

    check_target(source, target, RECORDING, force)
    parts = [_parse_filter(text) for text in filters]
    n_read = 0

    def filtered() -> Iterator[Events]:
        nonlocal n_read
        steps_in_order: Chain | None = None
        for part in read(source, from_format, sensor, not lenient):
            if steps_in_order is None:
                size, steps = part.sensor_size, list[Filter]()
                for kind, values in parts:
                    steps.append(kind(size, **values))
                    size = steps[-1].out_size
                steps_in_order = chain(*steps)
            n_read += len(part)
            yield steps_in_order(part)
        if steps_in_order is not None:
            yield steps_in_order.finish()

    with progress(f"{target} is not written") as bar:
        n_written = write(filtered(), target, to_format, events_so_far(bar), force, comes_once(source))
    typer.echo(f"{target}: {n_written:,} of {n_read:,} events", err=target == "-")


def _parse_filter(text: str) -> tuple[type[Filter], dict[str, Any]]:
    """Parse a filter and its parameters."""
    from neuro import ModelError
    from neuro_events.filters import FILTERS

    kind, values = parse_choice(text, FILTERS, "filter", "FILTER")
    if kind is FILTERS["hot"] and not values.get("pixels"):
        example = "such as 'hot: {pixels: [[8, 1], [205, 59]]}'"
        raise ModelError("filter 'hot': expected pixels", hint=f"{example}; 'neuro events info' lists hot pixels")
    return kind, values


def _list_filters(is_set: bool) -> None:
    if is_set:
        from neuro_events.filters import FILTERS

        list_parts(filter=FILTERS)


Every = Annotated[Any, typer.Option("--every", metavar="MS", parser=milliseconds, help="Duration of each file, ms.")]
Count = Annotated[Any, typer.Option("--count", metavar="N", parser=count, help="Number of events per file.")]
Folder = Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder for the files.")]
Ending = Annotated[
    str | None,
    typer.Option("--to", metavar="FORMAT", help="Ending of the files, such as .h5. Default: the ending of IN."),
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
    """Cut a recording into files of equal duration or of equal numbers of events. Empty windows give no file."""
    from neuro import ModelError
    from neuro.apps import make_folder
    from neuro_events import save, stream
    from neuro_events.convert import named_input
    from neuro_events.files import RECORDING

    if (every is None) == (count is None):
        raise typer.BadParameter("expected one of the two", param_hint="'--every' / '--count'")
    window = None if every is None else microseconds(every, "'--every'")
    name = Path(base_name(source))
    suffix = name.suffix.lower() if to_ending is None else f".{to_ending.lstrip('.')}"
    _check_targets(out, name.stem, suffix, force)
    file, input_name = named_input(source)
    parts = stream(
        file, window_us=window, count=count, format=from_format, sensor_size=sensor, name=input_name, strict=not lenient
    )  # fmt: skip
    n_written = n_empty = 0
    with progress("the files written so far are complete") as bar:
        for k, part in enumerate(parts):
            if not len(part):
                n_empty += 1
                continue
            make_folder(out)
            target = out / f"{name.stem}-{k:05d}{suffix}"
            check_target(source, target, RECORDING, force)
            save(part, target, replace=force)
            n_written += 1
            bar.say(f"{n_written:,} files")
    if not n_written:
        raise ModelError(f"{source}: the recording has no events: nothing to split")
    files = "1 file" if n_written == 1 else f"{n_written:,} files"
    skipped = f"; {n_empty:,} windows without events" if n_empty else ""
    typer.echo(f"{out / name.stem}-*{suffix}: {files}{skipped}")


def _check_targets(out: Path, stem: str, suffix: str, force: bool) -> None:
    """Check the ending and the existing files before any work begins."""
    from neuro_events.files import RECORDING
    from neuro_events.formats import written as formats

    endings = list(dict.fromkeys(ending for f in formats() for ending in f.suffixes))
    if suffix not in endings:
        raise typer.BadParameter(f"'{suffix}': cannot be written, expected {', '.join(endings)}", param_hint="'--to'")
    for existing in sorted(out.iterdir()) if out.is_dir() else ():
        number = existing.name.removeprefix(f"{stem}-").removesuffix(suffix)
        if existing.name == f"{stem}-{number}{suffix}" and number.isdecimal():
            check_target("-", existing, RECORDING, force)


ArraysOut = Annotated[
    Path, typer.Argument(metavar="OUT.npz", help="NPZ file to write, with arrays 'frames' and 'bounds'.")
]
Representation = Annotated[
    str, typer.Option("--as", metavar="NAME", help="Name of a representation, or 'name: {parameter: value}'.")
]
Cut = Annotated[
    str | None,
    typer.Option("--cut", metavar="NAME", help="Name of a segmenter, or 'name: {parameter: value}'. Default: no cuts."),
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
        typer.Option(
            "--list",
            callback=lambda is_set: _list_arrays(is_set),
            is_eager=True,
            help="List the representations and segmenters and exit.",
        ),
    ] = False,
) -> None:
    """Turn a recording into arrays, one per segment, e.g. --cut 'count_segments: {count: 5000}' --as hats."""
    import numpy as np

    from neuro import ModelError
    from neuro.apps import Kind, output
    from neuro_events import load
    from neuro_events.representations import REPRESENTATIONS
    from neuro_events.segmentation import SEGMENTERS

    make, values = parse_choice(representation, REPRESENTATIONS, "representation", "--as")
    cutter = None if cut is None else parse_choice(cut, SEGMENTERS, "segmenter", "--cut")
    if target.suffix != ".npz":
        raise typer.BadParameter(f"'{target}': expected a name that ends in .npz", param_hint="OUT.npz")
    arrays_kind = Kind("arrays of frames", ask="--force")
    check_target(source, target, arrays_kind, force)
    events: Events = load(source, format=from_format, sensor_size=sensor, strict=not lenient)
    bounds = np.array([0, len(events)]) if cutter is None else np.asarray(cutter[0](events.t, **cutter[1]))
    if len(bounds) < 2:
        raise ModelError(f"{source}: '{cut}' finds no segment in {len(events):,} events")
    arrays = np.stack([np.asarray(make(events[a:b], **values)) for a, b in pairwise(bounds)])
    with output(target, arrays_kind, force) as part, part.open("wb") as file:
        np.savez_compressed(file, frames=arrays, bounds=bounds)
    typer.echo(f"{target}: {len(arrays):,} of {representation}, {list(arrays.shape[1:])} {arrays.dtype}")


def _list_arrays(is_set: bool) -> None:
    if is_set:
        from neuro_events.representations import REPRESENTATIONS
        from neuro_events.segmentation import SEGMENTERS

        list_parts(representation=REPRESENTATIONS, segmenter=SEGMENTERS)


DataFolder = Annotated[Path, typer.Option("--data", "-f", metavar="FOLDER", help="Folder or zip of recordings.")]
OnlyEnding = Annotated[
    str | None, typer.Option("--ending", "-e", metavar="ENDING", help="Ending of the files to read, such as bin.")
]
StoreOut = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The HDF5 file to write.")]
Part = Annotated[
    str | None, typer.Option("--part", metavar="NAME", help="Part of the data set to read, such as Train.")
]
LayoutName = Annotated[
    str | None,
    typer.Option("--layout", metavar="NAME", help="Layout of the data set, such as nmnist. Default: detected."),
]
Workers = Annotated[
    Any, typer.Option("--workers", metavar="N", parser=count, help="Number of processes. Default: one per core.")
]
Strict = Annotated[bool, typer.Option("--strict", help="Stop at a damaged file. Default: skip it.")]
Mend = Annotated[bool, typer.Option("--lenient", help="Read damaged files up to the damage.")]


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
    """Pack a data set into one HDF5 file, /class/sample. Run the same command again to resume after an interruption."""
    from neuro import ModelError
    from neuro_events.dataset import Dataset

    if not out.parent.is_dir():
        raise ModelError(f"{out}: there is no folder {out.parent}")
    if strict and lenient:
        raise typer.BadParameter("expected one of the two", param_hint="'--strict' / '--lenient'")
    choice = "stop" if strict else "mend" if lenient else "skip"
    dataset = Dataset(data, part=part, layout=layout, ending=ending, sensor_size=sensor)
    with progress("run the same command again to resume") as bar:

        def report(damage: str, n_done: int, total: int) -> None:
            bar.show(n_done, total, f"{damage}: {n_done:,} of {total:,}")

        conversion = dataset.to_hdf5(out, jobs=workers, damaged=choice, report=report)
    typer.echo(f"{out}: {conversion.samples:,} recordings of {len(dataset.classes)} classes")
    if conversion.damaged:
        files = f"{len(conversion.damaged):,} damaged file{'s' if len(conversion.damaged) > 1 else ''}"
        typer.echo(f"{files}, {_FATE[choice]}:", err=True)
        for path, damage in conversion.damaged.items():
            typer.echo(f"  {path}: {damage}", err=True)
        raise typer.Exit(1)


_FATE = {"skip": "skipped", "mend": "read up to the damage"}
