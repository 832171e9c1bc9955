"""Pages that play something in a browser: tracks along one time, with buttons, keys and a time to drag.

All data lie in the page, arrays as base64 of little-endian numbers, so it needs nothing else; no screen is needed to
make it. The script `tracks.js` draws each kind of track.
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
            curve (lines along time), bars (numbers by moment), or one that the script of the page adds.
        name: of the element that it is drawn in.
        label: the text for screen readers.
        data: what is drawn, by the names that `tracks.js` reads; arrays are packed. With `at`, (moments,) times, the
            track has moments of its own. `notes` are texts for the title: before the first moment, then of each.
        height: px; 0 if it follows from the data.
        square: the drawing is as high as it is wide.
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
        title: of the box.
        tracks: in it.
        note: text or an element beside the title, such as a key of colours.
        controls: the box has the buttons, too.
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
        name: of it.
        values: (moments,), NaN where there is none.
        digits: after the point; None shows three significant digits.
        unit: with a space before it.
    """

    name: str
    values: NDArray[np.float64]
    digits: int | None = None
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """The time of a page.

    Attributes:
        end: the last time, in units of the page.
        begin: where the page opens.
        rate: units that pass in a ms of the viewer at speed 1.
        speeds: that can be chosen.
        speed: index of the one chosen first.
        speed_label: what the speeds are.
        moments: (n,) ascending times to which the arrow keys move; None if these are 0, 1, ... end and nothing lies
            between them.
        shift: moments by which an arrow moves with shift.
        help: what the arrow keys do, with `<kbd>` elements.
        label: words before the time.
        scale: by which a time is multiplied to be shown.
        digits: of the time shown.
        unit: of the time shown, with a space before it.
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
    """Return the index of the speed with the smallest ratio to a wanted one."""
    return min(range(len(speeds)), key=lambda k: abs(log(speeds[k][1] / speed)))


def evenly(many: int, most: int) -> int:
    """Return n, so that one of every n of so many things gives at most so many."""
    return max(1, -(-many // most))


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
        generator: the command that makes it, by which the file is known.
        title: of the page.
        about: a few words each, below the title.
        timeline: of all tracks.
        top: panels beside each other; those of a sequence stand below each other.
        below: panels over the whole width; one of them has the controls.
        columns: widths of the columns of `top` on a wide screen, in the words of CSS.
        script: what the page adds to the script: kinds of tracks as functions in `draws`.
    """
    parts = [tag("div", *map(_panel, one), class_="side") if not isinstance(one, Panel) else _panel(one) for one in top]
    panels = [each for one in [*top, below] for each in ([one] if isinstance(one, Panel) else one)]
    controls = _controls(timeline)
    body = tag(
        "main",
        tag("h1", title),
        tag("p", " · ".join(about)),
        tag("div", *parts, id="top", style=f"--columns: {columns}"),
        *(_panel(one, "wave", controls) for one in below),
    )
    tracks = [{"kind": one.kind, "name": one.name, **one.data} for panel in panels for one in panel.tracks]
    words = json.dumps({"clock": timeline, "tracks": tracks}, default=_packed).replace("<", "\\u003c")
    code = "\n".join(['"use strict";', html.player_script(), _text("tracks.js"), script, "draw();"])
    return f"""<!doctype html>
<html lang="en">
<head>
{html.head(generator, title)}
<style>
{html.player_style()}
{_text("tracks.css")}
</style>
</head>
<body>
{body}
<script type="application/json" id="data">{words}</script>
<script>
{code}
</script>
</body>
</html>
"""


def write(file: Path, kind: Kind, what: str, make: Callable[[], tuple[str, T]]) -> T:
    """Write a page; the name of the file is checked before the page is made.

    Args:
        file: path of the page.
        kind: kind of the file.
        what: subject for the message, such as "a lap is written as".
        make: function that returns the page as text, and a result.

    Returns:
        the result.

    Raises:
        ModelError: the name does not end in .html.
        Unwritable: a file of another kind has this name, or the file cannot be written.
    """
    if file.suffix.lower() not in (".html", ".htm"):
        raise ModelError(f"{file}: {what} a page for a browser: expected a name that ends in .html")
    with output(file, kind) as part:
        text, result = make()
        part.write_text(kind.seal(text), "utf-8")
    return result


def _panel(one: Panel, class_: str | None = None, controls: Html | None = None) -> Html:
    note = tag("span", one.note) if one.note else None
    dynamic = [tag("span", id=f"{each.name}Note") for each in one.tracks if "notes" in each.data]
    head = tag("h2", one.title, note, *dynamic) if one.title else None
    drawings = []
    for each in one.tracks:
        element, word = ("img", "alt") if each.kind == "frames" else ("canvas", "aria_label")
        shape = "square" if each.square else "fixed" if each.height else None
        style = f"height: {each.height}px" if each.height else None
        drawings.append(tag(element, id=each.name, class_=shape, style=style, **{word: each.label}))
    return tag("section", head, *drawings, one.content, controls if one.controls else None, class_=class_)


def _controls(timeline: Timeline) -> Html:
    row = (
        tag("button", "Play", id="play"),
        tag("output", id="now"),
        *(tag("span", f"{one.name} ", tag("output", id=one.name)) for one in timeline.readouts),
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
        return {one.name: getattr(values, one.name) for one in fields(values)}
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
