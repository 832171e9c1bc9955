"""The commands `neuro events info`, `formats`, `gif` and `view`, which inspect and draw recordings."""

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
    base_name,
    check_target,
    count,
    events_so_far,
    microseconds,
    progress,
    with_progress,
)

if TYPE_CHECKING:
    from neuro_events.info import Info
    from neuro_events.source import FileInput

File = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="A recording, - for standard input, or a data set as a folder, zip or HDF5."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def info(file: File, from_format: From = None, sensor: Sensor = None, as_json: Json = False) -> None:
    """Show a recording's format, sensor, counts, rates, gaps, hot pixels and other streams, or a data set's classes."""
    if file.is_dir() or file.suffix.lower() == ".zip":
        facts, rows = _summarise_dataset(file)
    else:
        facts, rows = _summarise_recording(file, from_format, sensor)
    if as_json:
        typer.echo(json.dumps(facts, indent=2, default=str))
        return
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        typer.echo(f"{name:<{width}}  {value}")


Summary = tuple[dict[str, Any], list[tuple[str, str]]]
"""Properties of a file, as a dictionary for JSON and as rows of names and values for a table."""


def _summarise_recording(file: Path, from_format: str | None, sensor: Any) -> Summary:
    """Summarise a recording, a file of generic events, or a data set in an HDF5 file."""
    from neuro_events.convert import named_input
    from neuro_events.info import info as summarise
    from neuro_events.source import EventFileError

    source, name = named_input(file)
    if from_format in (None, "event_stream", "es") and _is_generic(source):
        return _summarise_generic(source, str(name or source))
    try:
        with progress("nothing is reported") as bar:
            summary = summarise(source, format=from_format, sensor_size=sensor, name=name, report=events_so_far(bar))
    except EventFileError:
        if file.suffix.lower() not in (".h5", ".hdf5"):
            raise
        try:
            return _summarise_dataset(file)
        except EventFileError:
            pass
        raise
    return summary.as_dict(), _rows(summary)


def _rows(summary: Info) -> list[tuple[str, str]]:
    """Return the rows of the table."""
    width, height = summary.sensor_size
    size = "" if summary.bytes is None else f", {summary.bytes:,} bytes"
    rows = [("file", f"{summary.path}{size}"), ("format", summary.title)]
    if summary.untested:
        rows.append(("", f"untested on a real file: {summary.untested}"))
    rows.append(("sensor", f"{width}x{height}" + ("" if summary.sensor_told else ", not stated by the file")))
    rows.append(("events", f"{summary.events:,}"))
    if summary.events:
        rows += _counts(summary, width * height)
    rows += [("damage", text) for text in summary.damage]
    rows += [(name.replace("_", " "), _plain(value)) for name, value in summary.metadata.items()]
    return rows


def _counts(summary: Info, pixels: int) -> list[tuple[str, str]]:
    on_share = summary.on / summary.events
    seconds = f"{summary.duration_us / 1e6:,.6f}".rstrip("0").rstrip(".")
    rows = [("polarity", f"{on_share:.1%} ON, {1 - on_share:.1%} OFF")]
    rows.append(("time", f"{summary.start_us} to {summary.stop_us} us, {seconds} s"))
    if summary.rate_hz is not None:
        peak = f", at most {summary.peak_hz:,.0f} in 10 ms" if summary.peak_hz > summary.rate_hz else ""
        rate = f"{summary.rate_hz:,.0f}" if summary.rate_hz >= 10 else f"{summary.rate_hz:.3g}"
        rows.append(("rate", f"{rate} events/s{peak}"))
    if summary.gaps:
        gaps = ", ".join(f"{long:,} us from {start}" for start, long in summary.gaps)
        rows.append(("longest gaps", gaps))
    if summary.active_pixels is None:
        return [*rows, ("pixels", f"not counted, since there are {pixels:,}")]
    rows.append(("pixels", f"{summary.active_pixels:,} of {pixels:,} have events"))
    hot = ", ".join(f"({x}, {y}): {n:,}" for x, y, n in summary.hot) or "none"
    n_more = summary.hot_pixels - len(summary.hot)
    rows.append(("hot pixels", hot + (f" and {n_more} more" if n_more > 0 else "")))
    return rows


def _plain(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 200 else f"{text[:200]} ... (--json has all)"


def _summarise_dataset(path: Path) -> Summary:
    """Summarise a data set: its layout, classes and counts."""
    from neuro_events.dataset import LAYOUTS, Dataset

    data = Dataset(path)
    counts = {name: int((data.labels == k).sum()) for k, name in enumerate(data.classes)}
    title = {"hdf5": "HDF5, /class/sample", **{layout.name: layout.title for layout in LAYOUTS}}[data.layout]
    rows = [("data set", str(path)), ("layout", title), ("recordings", f"{len(data):,}")]
    rows += [(f"class {name}", f"{n:,}") for name, n in counts.items()]
    return {"path": str(path), "layout": data.layout, "recordings": len(data), "classes": counts}, rows


SHOWN = 40
"""Number of bytes of the first event in the summary."""
HEAD = 16
"""Number of bytes at the beginning of a file that state its type."""


def _is_generic(source: FileInput) -> bool:
    """Return whether a file holds generic events of Event Stream. Nothing is consumed from standard input."""
    from neuro_events.formats.event_stream import is_generic

    if not isinstance(source, str | os.PathLike):
        peek = getattr(source, "peek", None)
        return peek is not None and is_generic(peek(HEAD)[:HEAD])
    try:
        with Path(source).open("rb") as file:
            return is_generic(file.read(HEAD))
    except OSError:
        return False


def _summarise_generic(source: FileInput, name: str) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Summarise a file of generic events: counts, times and sizes.

    Args:
        source: a path or standard input.
        name: name for messages.
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
        "total_bytes": sum(sizes), "damage": [str(fault.message).removeprefix(f"{name}: ") for fault in damage],
    }  # fmt: skip
    rows = [("file", name), ("format", "Event Stream, generic: a time and some bytes per event, no pixels")]
    rows.append(("events", f"{len(events):,}"))
    if events:
        seconds = f"{(events[-1][0] - events[0][0]) / 1e6:,.6f}".rstrip("0").rstrip(".")
        rows.append(("time", f"{start} to {stop} us, {seconds} s"))
        rows.append(("bytes", f"{min(sizes):,} to {max(sizes):,} per event, {sum(sizes):,} in total"))
        rows.append(("first", _excerpt(events[0][1])))
    return facts, rows + [("damage", text) for text in facts["damage"]]


def _excerpt(content: bytes) -> str:
    """Return the beginning of the content, as text if printable, else in hexadecimal."""
    ellipsis = " ..." if len(content) > SHOWN else ""
    text = content[:SHOWN].decode("utf-8", "replace")
    return (repr(text) if text.isprintable() and "\ufffd" not in text else content[:SHOWN].hex(" ")) + ellipsis


def formats() -> None:
    """List the file formats, with their endings and whether each was tested on real recordings."""
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
        "--frame",
        metavar="MS",
        parser=milliseconds,
        help="Time per frame, ms. Default: 40, or less so that the GIF has at least 25 frames.",
    ),
]
Zoom = Annotated[
    Any,
    typer.Option(
        "--zoom",
        metavar="N",
        parser=count,
        help="Side of a sensor pixel in the GIF, px. Default: at least 240 px in all.",
    ),
]
Colours = Annotated[
    str,
    typer.Option("--colours", metavar="ON,OFF,BACK", help="Colours of ON, OFF and the background: names or #rrggbb."),
]


def gif(
    source: In,
    out: Annotated[
        str | None, typer.Argument(metavar="OUT", help="The GIF. Default: IN.gif in the current folder.")
    ] = None,
    fps: Fps = 25.0,
    frame: FrameTime = None,
    colours: Colours = "#0072B2,#D55E00,#FFFFFF",
    zoom: Zoom = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Draw a recording as a GIF. Long pauses are skipped.

    With --frame 40 and --fps 25 the GIF plays in real time.
    """
    from neuro_events.convert import read
    from neuro_events.pictures import GIF, gif as draw

    names = colours.split(",")
    if len(names) != 3:
        raise typer.BadParameter(f"'{colours}': expected three colours, ON,OFF,BACK", param_hint="'--colours'")
    window_us = None if frame is None else microseconds(frame, "'--frame'")
    target = f"{base_name(source)}.gif" if out is None else out
    if not target.lower().endswith(".gif"):
        raise typer.BadParameter(f"'{target}': expected a name that ends in .gif", param_hint="OUT")
    check_target(source, target, GIF, force)
    with progress(f"{target} is not written") as bar:
        parts = with_progress(read(source, from_format, sensor, not lenient), bar)
        drawing = draw(
            parts,
            target,
            fps=fps,
            window_us=window_us,
            colours=(names[0], names[1], names[2]),
            scale=zoom,
            name=source,
            replace=force,
        )
    speed = drawing.window_us * drawing.fps / 1e6
    message = "in real time" if abs(speed - 1) < 0.005 else f"at {speed:.3g} times real time"
    frames = "1 frame" if drawing.frames == 1 else f"{drawing.frames:,} frames"
    skipped = f"; {drawing.left_out:,} still frames skipped" if drawing.left_out else ""
    size = f"{drawing.size[0]}x{drawing.size[1]} px"
    typer.echo(f"{target}: {frames} of {size}, {drawing.fps:.4g} per second, {message}{skipped}")


PageOut = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The page. Default: IN.html in the current folder.")
]
Most = Annotated[Any, typer.Option("--most", metavar="N", parser=count, help="Largest number of events on the page.")]


def view(
    source: In,
    out: PageOut = None,
    most: Most = 500_000,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Write a page that plays a recording in the browser. The page is one file and works offline."""
    from neuro_events.convert import read
    from neuro_events.pictures import PAGE, view as write

    name = base_name(source)
    target = Path(f"{name}.html") if out is None else out
    check_target(source, target, PAGE, force)
    with progress(f"{target} is not written") as bar:
        parts = with_progress(read(source, from_format, sensor, not lenient), bar)
        step = write(parts, target, title=name, most=most, replace=force)
    share = "all events" if step == 1 else f"1 of every {step:,} events; --most shows more"
    typer.echo(f"{target}: {share}")
