"""`neuro events info`, `formats`, `gif` and `view`: recordings looked at."""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import milliseconds
from neuro_events.cli.options import (
    Force,
    From,
    In,
    Lenient,
    Sensor,
    count,
    events_so_far,
    going,
    microseconds,
    named,
    spare,
    watched,
)

if TYPE_CHECKING:
    from neuro_events.info import Info
    from neuro_events.source import Given

File = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="A recording, - for standard input, or a data set as a folder, zip or HDF5."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def info(file: File, from_format: From = None, sensor: Sensor = None, as_json: Json = False) -> None:
    """Tell what a recording is: format, sensor, counts, rates, gaps, hot pixels, other streams; or a data set."""
    if file.is_dir() or file.suffix.lower() == ".zip":
        facts, rows = _of_dataset(file)
    else:
        facts, rows = _of_recording(file, from_format, sensor)
    if as_json:
        typer.echo(json.dumps(facts, indent=2, default=str))
        return
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        typer.echo(f"{name:<{width}}  {value}")


Told = tuple[dict[str, Any], list[tuple[str, str]]]


def _of_recording(file: Path, from_format: str | None, sensor: Any) -> Told:
    """Counts of a recording, also of generic events; or of a data set in an HDF5 file."""
    from neuro_events.convert import given
    from neuro_events.info import info as look
    from neuro_events.source import EventFileError

    source, name = given(file)
    if from_format in (None, "event_stream", "es") and begins_generic(source):
        return of_generic(source, str(name or source))
    try:
        with going("nothing is reported") as bar:
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
    rows.append(("sensor", f"{width}x{height}" + ("" if found.sensor_told else ", not stated by the file")))
    rows.append(("events", f"{found.events:,}"))
    if found.events:
        rows += _counts(found, width * height)
    rows += [("damage", text) for text in found.damage]
    rows += [(name.replace("_", " "), _plain(value)) for name, value in found.metadata.items()]
    return rows


def _counts(found: Info, pixels: int) -> list[tuple[str, str]]:
    on = found.on / found.events
    seconds = f"{found.duration_us / 1e6:,.6f}".rstrip("0").rstrip(".")
    rows = [("polarity", f"{on:.1%} ON, {1 - on:.1%} OFF")]
    rows.append(("time", f"{found.start_us} to {found.stop_us} us, {seconds} s"))
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
    hot = ", ".join(f"({x}, {y}): {n:,}" for x, y, n in found.hot) or "none"
    more = found.hot_pixels - len(found.hot)
    rows.append(("hot pixels", hot + (f" and {more} more" if more > 0 else "")))
    return rows


def _plain(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 200 else f"{text[:200]} ... (--json has all)"


def _of_dataset(path: Path) -> Told:
    """Classes and counts of a data set."""
    from neuro_events.dataset import LAYOUTS, Dataset

    data = Dataset(path)
    counts = {name: int((data.labels == k).sum()) for k, name in enumerate(data.classes)}
    title = {"hdf5": "HDF5, /class/sample", **{layout.name: layout.title for layout in LAYOUTS}}[data.layout]
    rows = [("data set", str(path)), ("layout", title), ("recordings", f"{len(data):,}")]
    rows += [(f"class {name}", f"{n:,}") for name, n in counts.items()]
    return {"path": str(path), "layout": data.layout, "recordings": len(data), "classes": counts}, rows


SHOWN = 40
"""Bytes of the first event that are shown."""
HEAD = 16
"""Bytes that tell the type."""


def begins_generic(source: Given) -> bool:
    """Whether a path or standard input is such a file; what is looked at is not used up."""
    from neuro_events.formats.event_stream import is_generic

    if not isinstance(source, str | os.PathLike):
        peek = getattr(source, "peek", None)
        return peek is not None and is_generic(peek(HEAD)[:HEAD])
    try:
        with Path(source).open("rb") as file:
            return is_generic(file.read(HEAD))
    except OSError:
        return False


def of_generic(source: Given, name: str) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Counts, times and sizes, for JSON and as rows.

    Args:
        source: a path or standard input.
        name: what to call it.
    """
    from neuro_events.formats.event_stream import generic
    from neuro_events.source import EventFileWarning

    with warnings.catch_warnings(record=True) as damage:
        warnings.simplefilter("always", EventFileWarning)
        events = generic(source, name=name, strict=False)
    sizes = [len(content) for _, content in events]
    start, stop = (events[0][0], events[-1][0]) if events else (None, None)
    facts: dict[str, Any] = {
        "path": name, "format": "event_stream", "type": "generic", "events": len(events), "start_us": start,
        "stop_us": stop, "smallest_bytes": min(sizes, default=None), "largest_bytes": max(sizes, default=None),
        "total_bytes": sum(sizes), "damage": [str(one.message).removeprefix(f"{name}: ") for one in damage],
    }  # fmt: skip
    rows = [("file", name), ("format", "Event Stream, generic: times with bytes, no pixels")]
    rows.append(("events", f"{len(events):,}"))
    if events:
        seconds = f"{(events[-1][0] - events[0][0]) / 1e6:,.6f}".rstrip("0").rstrip(".")
        rows.append(("time", f"{start} to {stop} us, {seconds} s"))
        rows.append(("bytes", f"{min(sizes):,} to {max(sizes):,} an event, {sum(sizes):,} in all"))
        rows.append(("first", _shown(events[0][1])))
    return facts, rows + [("damage", text) for text in facts["damage"]]


def _shown(content: bytes) -> str:
    """Text where it is, else hexadecimal; the beginning of much."""
    more = " ..." if len(content) > SHOWN else ""
    text = content[:SHOWN].decode("utf-8", "replace")
    return (repr(text) if text.isprintable() and "\ufffd" not in text else content[:SHOWN].hex(" ")) + more


def formats() -> None:
    """List the file formats, and whether they were tried on real recordings."""
    from neuro.apps import console, table
    from neuro_events.formats import FORMATS

    rows = [
        (f.name, f.title, " ".join(f.suffixes), "yes" if f.write else "no", f.untested or "on real files")
        for f in FORMATS.values()
    ]
    console().print(table(("format", "title", "endings", "written", "tested"), rows))


Fps = Annotated[float, typer.Option("--fps", metavar="N", help="Frames per second, 0.1 to 50.")]
FrameTime = Annotated[
    Any,
    typer.Option(
        "--frame", metavar="MS", parser=milliseconds, help="Of a frame; 40 ms, or less for 25 frames at least."
    ),
]
Zoom = Annotated[Any, typer.Option("--zoom", metavar="N", parser=count, help="Size of a pixel; else 240 px or more.")]
Colours = Annotated[
    str, typer.Option("--colours", metavar="ON,OFF,BACK", help="Of ON, OFF and the background: names or #rrggbb.")
]


def gif(
    source: In,
    out: Annotated[str | None, typer.Argument(metavar="OUT", help="The GIF; IN.gif in the current folder.")] = None,
    fps: Fps = 25.0,
    frame: FrameTime = None,
    colours: Colours = "#0072B2,#D55E00,#FFFFFF",
    zoom: Zoom = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Draw a recording as a GIF; with --frame 40 and --fps 25 time runs as it did, save long pauses, left out."""
    from neuro_events.convert import read
    from neuro_events.pictures import GIF, gif as draw

    names = colours.split(",")
    if len(names) != 3:
        raise typer.BadParameter(f"'{colours}': expected three colours, ON,OFF,BACK", param_hint="'--colours'")
    window_us = None if frame is None else microseconds(frame, "'--frame'")
    target = f"{named(source)}.gif" if out is None else out
    if not target.lower().endswith(".gif"):
        raise typer.BadParameter(f"'{target}': expected a name that ends in .gif", param_hint="OUT")
    spare(source, target, GIF, force)
    with going(f"{target} is not written") as bar:
        parts = watched(read(source, from_format, sensor, not lenient), bar)
        made = draw(
            parts,
            target,
            fps=fps,
            window_us=window_us,
            colours=(names[0], names[1], names[2]),
            scale=zoom,
            name=source,
            replace=force,
        )
    speed = made.window_us * made.fps / 1e6
    message = "as fast as it was" if abs(speed - 1) < 0.005 else f"{speed:.3g} times as fast as it was"
    frames = "1 frame" if made.frames == 1 else f"{made.frames:,} frames"
    without = f"; {made.left_out:,} still frames left out" if made.left_out else ""
    typer.echo(f"{target}: {frames} of {made.size[0]}x{made.size[1]} px, {made.fps:.4g} a second, {message}{without}")


PageOut = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="The page; IN.html in the current folder.")]
Most = Annotated[Any, typer.Option("--most", metavar="N", parser=count, help="Show at most so many events.")]


def view(
    source: In,
    out: PageOut = None,
    most: Most = 500_000,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Write a page on which a browser plays the recording; the page needs nothing else."""
    from neuro_events.convert import read
    from neuro_events.pictures import PAGE, view as write

    name = named(source)
    target = Path(f"{name}.html") if out is None else out
    spare(source, target, PAGE, force)
    with going(f"{target} is not written") as bar:
        parts = watched(read(source, from_format, sensor, not lenient), bar)
        step = write(parts, target, title=name, most=most, replace=force)
    shown = "all events" if step == 1 else f"one of every {step:,} events; --most shows more"
    typer.echo(f"{target}: {shown}")
