"""Recordings as moving pictures."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from itertools import chain
from string import Template
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import argument, file_path, html, marked, output, sealed, write_text
from neuro_events._events import Events
from neuro_events.parts import together, windows

COLOURS = ("#0072B2", "#D55E00", "#FFFFFF")
"""ON, OFF and background: Okabe and Ito's blue and vermilion, which colour-blind readers tell apart."""
TALL = 240
"""Small sensors are enlarged by a whole number until their longer side has so many px."""
LEAST_FPS, MOST_FPS = 0.1, 50.0
"""A GIF stores a time in 16 bits, in units of 10 ms; programs that show GIFs slow down shorter pauses than 20 ms."""
LARGEST, LARGEST_SCALED = 65_535, 8192
"""px; a GIF stores its sides in 16 bits, and no one enlarges so far on purpose."""
STILL = 25
"""Frames in a row that are the same, one second by default; more are left out."""
WINDOW_US, FRAMES, HELD = 40_000, 25, 1 << 22
"""Where no window is given: its length, and how many windows there shall be at least of a recording that is short and
has not more than so many events, which have to be held for that (55 MB)."""
MARK = "neuro events gif"
GIF = marked("a GIF of 'neuro events gif'", MARK, "replace=True")
MOST_FRAMES = 10_000
"""More are a mistake: seven minutes by default, and a file of hundreds of MB."""


@dataclass(frozen=True, slots=True)
class Gif:
    """What `gif` wrote.

    Attributes:
        frames: how many.
        window_us: time of a frame, us.
        left_out: frames left out, since nothing changed for long.
        fps: frames per second as they are shown; pauses are whole multiples of 10 ms.
        size: width and height of the picture, px.
    """

    frames: int
    window_us: int
    left_out: int
    fps: float
    size: tuple[int, int]


def gif(
    parts: Events | Iterable[Events],
    path: str | os.PathLike[str],
    *,
    fps: float = 25.0,
    window_us: int | None = None,
    colours: tuple[str, str, str] = COLOURS,
    scale: int | None = None,
    name: str = "the recording",
    replace: bool = False,
) -> Gif:
    """Draw a recording as an animated GIF, in constant memory.

    A frame shows the last event of each pixel in a window of time; windows follow each other. Where more than 25 frames
    in a row are the same, as in a pause, the others are left out.

    Args:
        parts: a recording, or its parts in order.
        path: the file to write.
        fps: frames per second, 0.1 to 50; with windows of 1e6 / fps us, time runs as it did.
        window_us: time of a frame, us; None: 40,000, or less so that a short recording gives 25 frames.
        colours: of ON, of OFF and of the background, by name or as ``#rrggbb``.
        scale: px of the picture per px of the sensor; None: so that the picture is at least 240 px high or wide.
        name: what to call the recording in messages.
        replace: whether to replace a file that is no such GIF.

    Raises:
        ModelError: there are no events, more than 10,000 frames, or an argument is wrong, which the message names, or
            the file cannot be written.
        EventFileError: time jumps over more than 10^6 windows.
    """
    from PIL import Image

    replace = argument("replace", replace, kind="boolean")
    fps = argument("fps", fps, unit="frames per second", at_least=LEAST_FPS, at_most=MOST_FPS)
    window_us = argument("window_us", window_us, kind="microseconds", at_least=1, optional=True)
    scale = argument("scale", scale, kind="integer", at_least=1, optional=True)
    palette = [value for colour in (colours[2], colours[1], colours[0]) for value in _rgb(colour)]
    given = iter([parts] if isinstance(parts, Events) else parts)
    first, duration = _beginning(given, WINDOW_US * FRAMES if window_us is None else 0)
    if not first:
        raise ModelError(f"{name} has no events: nothing to draw")
    window_us = window_us or min(WINDOW_US, duration // FRAMES + 1)
    width, height = first[0].sensor_size
    scale = scale or max(1, -(-TALL // max(width, height)))
    if max(width, height) * scale > (LARGEST if scale == 1 else LARGEST_SCALED):
        most = f"{LARGEST} px, or {LARGEST_SCALED} px enlarged"
        raise ModelError(
            f"scale = {scale}: the picture has {width * scale}x{height * scale} px, expected at most {most}"
        )
    drawn = _Frames(windows(chain(first, given), window_us, path=name), (width, height))

    def pictures() -> Iterator[Any]:
        for pixels in drawn:
            picture = Image.fromarray(np.kron(pixels, np.ones((scale, scale), np.uint8)), "P")
            picture.putpalette(palette)
            yield picture

    pause = max(2, round(100 / fps))
    made = pictures()
    with output(path, GIF, replace) as part:
        next(made).save(
            part, "GIF", save_all=True, append_images=made, duration=10 * pause, loop=0, optimize=False, disposal=1,
            comment=MARK,
        )  # fmt: skip
    return Gif(drawn.count, window_us, drawn.left_out, 100 / pause, (width * scale, height * scale))


def _beginning(parts: Iterator[Events], long_us: int) -> tuple[list[Events], int]:
    """The first parts with events, and how long they last, us: all if they do not last so long, else some."""
    held: list[Events] = []
    duration = 0
    for part in parts:
        if len(part):
            held.append(part)
            duration = int(part.t[-1]) - int(held[0].t[0])
            if duration >= long_us:
                break
            if sum(map(len, held)) > HELD:
                return held, long_us
    return held, duration


class _Frames:
    """The pixels of each frame: 0 without event, 1 for OFF, 2 for ON.

    Attributes:
        count: frames so far.
        left_out: frames that were left out.
    """

    def __init__(self, parts: Iterator[Events], size: tuple[int, int]) -> None:
        self.count = self.left_out = 0
        self._parts, self._blank = parts, np.zeros((size[1], size[0]), np.uint8)

    def __iter__(self) -> Iterator[npt.NDArray[np.uint8]]:
        before, same = None, 0
        for events in self._parts:
            pixels = self._blank
            if len(events):
                pixels = pixels.copy()
                pixels[events.y, events.x] = events.p + 1
            same = same + 1 if pixels is before or (before is not None and np.array_equal(pixels, before)) else 1
            before = pixels
            if same > STILL:
                self.left_out += 1
                continue
            if self.count == MOST_FRAMES:
                raise ModelError(
                    f"more than {MOST_FRAMES:,} frames", hint="take longer windows, or split the recording"
                )  # fmt: skip
            self.count += 1
            yield pixels


def _rgb(colour: str) -> tuple[int, ...]:
    from PIL import ImageColor

    try:
        return ImageColor.getrgb(colour)[:3]
    except ValueError:
        raise ModelError(f"unknown colour {colour!r}, expected a name such as white, or #rrggbb") from None


MOST = 500_000
"""Events of a page; 9 bytes each, so a page has at most 6 MB."""
PIXELS = 1 << 26
"""Browsers have no larger canvas."""
PAGE = sealed(
    "a page of 'neuro events view'",
    '<meta name="generator" content="neuro events view">',
    "<!-- digest {} -->",
    "replace=True",
)
BARS = 400
"""Bars of the rate along the time line."""


def view(
    parts: Events | Iterable[Events],
    path: str | os.PathLike[str],
    *,
    title: str,
    most: int = MOST,
    replace: bool = False,
) -> int:
    """Write the page of a recording, in constant memory.

    Args:
        parts: a recording, or its parts in order.
        path: the file to write.
        title: what to call the recording.
        most: events that are shown; of more, one of every 2, 4, 8, ..., from the first on.
        replace: whether to replace a file that is no such page.

    Returns:
        Of how many events one is shown.

    Raises:
        ModelError: there are no events, the sensor has more than 2^26 px, `most` is less than 1, or the file cannot be
            written.
    """
    replace = argument("replace", replace, kind="boolean")
    most = argument("most", most, kind="integer", at_least=1)
    events, total, step = _chosen([parts] if isinstance(parts, Events) else parts, most)
    if events is None:
        raise ModelError(f"{title}: the recording has no events: nothing to show")
    width, height = events.sensor_size
    if width * height > PIXELS:
        raise ModelError(f"{title}: the sensor has {width}x{height} px, expected at most {PIXELS}: too many to show")
    write_text(file_path(path, "path"), page(events, title, total, step), PAGE, replace)
    return step


def _chosen(parts: Iterable[Events], most: int) -> tuple[Events | None, int, int]:
    """An even choice of the events, how many there are, and of how many one is chosen."""
    held: list[Events] = []
    total, step = 0, 1
    for part in parts:
        held.append(part[-total % step :: step])
        total += len(part)
        while sum(map(len, held)) > most:
            step *= 2
            held = [together(held)[::2]]
    held = [part for part in held if len(part)]
    return (together(held) if held else None), total, step


def page(events: Events, title: str, total: int, step: int) -> str:
    """The page as text.

    Args:
        events: what to show, at least one.
        title: what to call the recording.
        total: events of the recording.
        step: of how many events one is shown.
    """
    since = events.t - events.t[0]
    unit = 1 + int(since[-1]) // (1 << 32)
    bars, _ = np.histogram(since, BARS, (0, max(1, int(since[-1]))))
    data: dict[str, Any] = {
        "width": events.sensor_size[0], "height": events.sensor_size[1], "unit": unit, "start": str(events.t[0]),
        "t": _base64(since // unit, "<u4"), "x": _base64(events.x, "<u2"), "y": _base64(events.y, "<u2"),
        "p": _base64(events.p, "u1"), "bars": bars.tolist(), "step": step,
    }  # fmt: skip
    width, height = events.sensor_size
    seconds = int(since[-1]) / 1e6
    message = f"{total:,} events, {width}×{height} px, {seconds:,.3f} s"
    if step > 1:
        message += f" · one of every {step:,} events is shown ({len(events):,})"
    template = Template(files("neuro_events").joinpath("view.html").read_text("utf-8"))
    return template.substitute(
        head=html.head("neuro events view", title),
        script=html.player_script(),
        title=escape(title),
        told=escape(message),
        data=json.dumps(data).replace("<", "\\u003c"),
    )


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
