"""Pages with a player in a browser: tracks along one time, with buttons, keys and a time slider.

The page contains all data, arrays as base64 of little-endian numbers, and is made without a screen. The script
`tracks.js` draws each kind of track.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import log
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from neuro.core import html
from neuro.core.errors import ModelError
from neuro.core.html import Html, join, tag
from neuro.core.outputs import Kind, output

T = TypeVar("T")
_TYPES = {np.dtype(name): name for name in ("u1", "i1", "u2", "u4", "f4")}


@dataclass(frozen=True, slots=True)
class Track:
    """A drawing that follows the time of a page.

    Attributes:
        kind: frames (pictures by moment), events (of a camera), image (numbers by moment as shades), raster (spikes),
            curve (lines along time), bars (numbers by moment), or a kind that the script of the page adds.
        name: name of the element of the drawing.
        label: description for screen readers.
        data: data by the names that `tracks.js` reads; arrays are packed. With `at`, (moments,) times, the track has
            its own moments. `notes` are texts for the title: before the first moment, then for each moment.
        height: height in px; 0 if it follows from the data.
        square: whether the drawing is as high as wide.
    """

    kind: str
    name: str
    label: str
    data: Mapping[str, Any]
    height: int = 0
    square: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """A box with a title and tracks below each other.

    Attributes:
        title: title of the box.
        tracks: tracks in the box.
        note: text or an element beside the title, e.g. a key of colours.
        controls: whether the box has the buttons, too.
        content: an element below the tracks.
    """

    title: str
    tracks: Sequence[Track]
    note: str = ""
    controls: bool = False
    content: Html | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Readout:
    """A number beside the buttons.

    Attributes:
        name: name of the number.
        values: value at each moment, (moments,); NaN for no value.
        digits: number of digits after the point; None for three significant digits.
        unit: unit, with a space before it.
    """

    name: str
    values: NDArray[np.float64]
    digits: int | None = None
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """The time of a page.

    Attributes:
        end: last time, in units of the page.
        begin: time at which the page opens.
        rate: units of the page per ms of the viewer at speed 1.
        speeds: speeds that can be chosen.
        speed: index of the initial speed.
        speed_label: meaning of the speeds.
        moments: (n,) ascending times to which the arrow keys move; None if these are 0, 1, ... end and nothing lies
            between them.
        shift: number of moments by which an arrow with shift moves.
        help: explanation of the arrow keys, with `<kbd>` elements.
        label: text before the time.
        scale: factor from a time to the shown time.
        digits: number of digits of the shown time.
        unit: unit of the shown time, with a space before it.
        readouts: numbers beside the buttons.
    """

    end: float
    begin: float
    rate: float
    speeds: Sequence[tuple[str, float]]
    speed: int
    shift: int
    help: str
    speed_label: str = "speed"
    moments: NDArray[np.float64] | None = None
    label: str = ""
    scale: float = 1.0
    digits: int = 0
    unit: str = ""
    readouts: Sequence[Readout] = ()


def closest(speeds: Sequence[tuple[str, float]], speed: float) -> int:
    """Return the index of the listed speed with the smallest ratio to a given speed."""
    return min(range(len(speeds)), key=lambda k: abs(log(speeds[k][1] / speed)))


def evenly(count: int, limit: int) -> int:
    """Return n so that every n-th of `count` items gives at most `limit` items."""
    return max(1, -(-count // limit))


def page(
    generator: str,
    title: str,
    about: Iterable[str],
    timeline: Timeline,
    top: Sequence[Panel | Sequence[Panel]],
    below: Sequence[Panel],
    *,
    columns: str,
    script: str = "",
) -> str:
    """Return the text of a page.

    Args:
        generator: command that makes the page, a mark of the file.
        title: title of the page.
        about: short texts below the title.
        timeline: time of all tracks.
        top: panels beside each other; panels of a sequence are below each other.
        below: panels over the whole width; one of them has the controls.
        columns: widths of the columns of `top` on a wide screen, in the words of CSS.
        script: additional script of the page, with further kinds of tracks as functions in `draws`.
    """
    parts = [tag("div", *map(_panel, p), class_="side") if not isinstance(p, Panel) else _panel(p) for p in top]
    panels = [panel for p in [*top, below] for panel in ([p] if isinstance(p, Panel) else p)]
    controls = _controls(timeline)
    body = tag(
        "main",
        tag("h1", title),
        tag("p", " · ".join(about)),
        tag("div", *parts, id="top", style=f"--columns: {columns}"),
        *(_panel(panel, "wave", controls) for panel in below),
    )
    tracks = [{"kind": track.kind, "name": track.name, **track.data} for panel in panels for track in panel.tracks]
    data = json.dumps({"clock": timeline, "tracks": tracks}, default=_packed).replace("<", "\\u003c")
    code = "\n".join(['"use strict";', html.player_script(), _text("tracks.js"), script, "draw();"])
    return f"""<!doctype html>
<html lang="en">
<head>
{html.head(generator, title)}
<style>
{html.style_sheets("player.css", "tracks.css")}
</style>
</head>
<body>
{body}
<script type="application/json" id="data">{data}</script>
<script>
{code}
</script>
</body>
</html>
"""


def write(file: Path, kind: Kind, subject: str, build: Callable[[], tuple[str, T]]) -> T:
    """Write a page. The name of the file is checked before the page is built.

    Args:
        file: path of the page.
        kind: kind of the file.
        subject: beginning of the message, such as "a lap is written as".
        build: function that returns the page as text, and a result.

    Returns:
        The result.

    Raises:
        ModelError: the name does not end in .html.
        Unwritable: a file of another kind has this name, or the file cannot be written.
    """
    if file.suffix.lower() not in (".html", ".htm"):
        raise ModelError(f"{file}: {subject} a page for a browser: expected a name that ends in .html")
    with output(file, kind) as part:
        text, result = build()
        part.write_text(kind.seal(text), "utf-8")
    return result


def _panel(panel: Panel, class_: str | None = None, controls: Html | None = None) -> Html:
    note = tag("span", panel.note) if panel.note else None
    dynamic = [tag("span", id=f"{track.name}Note") for track in panel.tracks if "notes" in track.data]
    head = tag("h2", panel.title, note, *dynamic) if panel.title else None
    drawings = []
    for track in panel.tracks:
        element, word = ("img", "alt") if track.kind == "frames" else ("canvas", "aria_label")
        shape = "square" if track.square else "fixed" if track.height else None
        style = f"height: {track.height}px" if track.height else None
        drawings.append(tag(element, id=track.name, class_=shape, style=style, **{word: track.label}))
    return tag("section", head, *drawings, panel.content, controls if panel.controls else None, class_=class_)


def _controls(timeline: Timeline) -> Html:
    row = (
        tag("button", "Play", id="play"),
        tag("output", id="now"),
        *(tag("span", f"{number.name} ", tag("output", id=number.name)) for number in timeline.readouts),
        tag("label", f"{timeline.speed_label} ", tag("select", id="speed")),
        tag(
            "span", Html(f"<kbd>space</kbd> plays and pauses, <kbd>←</kbd> <kbd>→</kbd> {timeline.help}"), class_="keys"
        ),
    )
    slider = tag("input", id="time", type="range", min=0, value=0, aria_label="time")
    return join([slider, tag("div", *row, class_="row")])


def _packed(values: Any) -> dict[str, Any] | float:
    """Return a value as JSON. An array becomes `{type: base64 of the bytes}`, with the smallest type of integers."""
    if isinstance(values, Timeline | Readout):
        return {field.name: getattr(values, field.name) for field in fields(values)}
    if isinstance(values, np.generic):
        return float(values)
    array = np.asarray(values)
    if array.dtype.kind == "f":
        array = array.astype("<f4")
    elif array.dtype.kind != "b" and array.dtype != np.int8:
        array = array.astype(np.min_scalar_type(int(array.max(initial=0))))
    name = _TYPES[array.astype("u1").dtype if array.dtype.kind == "b" else array.dtype]
    return {name: base64.b64encode(np.ascontiguousarray(array, f"<{name}").tobytes()).decode("ascii")}


def _text(name: str) -> str:
    return (Path(__file__).parent / name).read_text("utf-8").strip()
