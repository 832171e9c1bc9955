"""`neuro events info`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.events.generic import begins_generic, of_generic
from neuro.cli.events.options import From, Sensor, events_so_far, going

if TYPE_CHECKING:
    from neuro.events.info import Info

File = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="A recording, - for standard input, or a data set as a folder, zip or HDF5."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def info(file: File, from_format: From = None, sensor: Sensor = None, as_json: Json = False) -> None:
    """Tell what a recording is: format, sensor, counts, rates, gaps, hot pixels, other streams; or a data set."""
    if file.is_dir() or file.suffix.lower() == ".zip":
        told, rows = _of_dataset(file)
    else:
        told, rows = _of_recording(file, from_format, sensor)
    if as_json:
        typer.echo(json.dumps(told, indent=2, default=str))
        return
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        typer.echo(f"{name:<{width}}  {value}")


Told = tuple[dict[str, Any], list[tuple[str, str]]]


def _of_recording(file: Path, from_format: str | None, sensor: Any) -> Told:
    """Counts of a recording, also of generic events; or of a data set in an HDF5 file."""
    from neuro.events.convert import given
    from neuro.events.errors import EventFileError
    from neuro.events.info import info as look

    source, name = given(file)
    if from_format in (None, "event_stream", "es") and begins_generic(source):
        return of_generic(source, str(name or source))
    try:
        with going("nothing is told") as bar:
            found = look(source, format=from_format, sensor_size=sensor, name=name, report=events_so_far(bar))
    except EventFileError:
        if file.suffix.lower() not in (".h5", ".hdf5"):
            raise
        try:
            return _of_dataset(file)
        except EventFileError:
            pass
        raise
    return found.as_dict(), _rows(found)


def _rows(found: Info) -> list[tuple[str, str]]:
    """What is printed."""
    width, height = found.sensor_size
    size = "" if found.bytes is None else f", {found.bytes:,} bytes"
    rows = [("file", f"{found.path}{size}"), ("format", found.title)]
    if found.untested:
        rows.append(("", f"untested on a real file: {found.untested}"))
    rows.append(("sensor", f"{width}x{height}" + ("" if found.sensor_told else ", not told by the file")))
    rows.append(("events", f"{found.events:,}"))
    if found.events:
        rows += _counts(found, width * height)
    rows += [("damage", text) for text in found.damage]
    rows += [(name.replace("_", " "), _plain(value)) for name, value in found.metadata.items()]
    return rows


def _counts(found: Info, pixels: int) -> list[tuple[str, str]]:
    on = found.on / found.events
    rows = [("polarity", f"{on:.1%} ON, {1 - on:.1%} OFF")]
    rows.append(("time", f"{found.start_us} to {found.stop_us} us, {_number(found.duration_us / 1e6)} s"))
    if found.rate_hz is not None:
        peak = f", at most {found.peak_hz:,.0f} in 10 ms" if found.peak_hz > found.rate_hz else ""
        rate = f"{found.rate_hz:,.0f}" if found.rate_hz >= 10 else f"{found.rate_hz:.3g}"
        rows.append(("rate", f"{rate} events/s{peak}"))
    if found.gaps:
        gaps = ", ".join(f"{long:,} us from {since}" for since, long in found.gaps)
        rows.append(("longest gaps", gaps))
    if found.active_pixels is None:
        return [*rows, ("pixels", f"not counted, since there are {pixels:,}")]
    rows.append(("pixels", f"{found.active_pixels:,} of {pixels:,} have events"))
    told = ", ".join(f"({x}, {y}): {n:,}" for x, y, n in found.hot) or "none"
    more = found.hot_pixels - len(found.hot)
    rows.append(("hot pixels", told + (f" and {more} more" if more > 0 else "")))
    return rows


def _number(value: float) -> str:
    return f"{value:,.6f}".rstrip("0").rstrip(".")


def _plain(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 200 else f"{text[:200]} ... (--json has all)"


def _of_dataset(path: Path) -> Told:
    """Classes and counts of a data set."""
    from neuro.events.dataset import LAYOUTS, Dataset

    data = Dataset(path)
    counts = {name: int((data.labels == k).sum()) for k, name in enumerate(data.classes)}
    title = {"hdf5": "HDF5, /class/sample", **{layout.name: layout.title for layout in LAYOUTS}}[data.layout]
    rows = [("data set", str(path)), ("layout", title), ("recordings", f"{len(data):,}")]
    rows += [(f"class {name}", f"{n:,}") for name, n in counts.items()]
    return {"path": str(path), "layout": data.layout, "recordings": len(data), "classes": counts}, rows
