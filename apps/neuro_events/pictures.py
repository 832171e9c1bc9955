"""Recordings as animated GIFs and as pages with a player."""

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
from neuro_events.parts import joined_parts, windows

COLOURS = ("#0072B2", "#D55E00", "#FFFFFF")
"""Colours of ON, OFF and background: Okabe and Ito's blue and vermilion, which colour-blind readers can distinguish."""
TALL = 240
"""Smallest length of a picture's longer side, px. Small sensors are enlarged by a whole factor to reach this length."""
LEAST_FPS, MOST_FPS = 0.1, 50.0
"""Range of frames per second. A GIF stores delays in 16 bits in units of 10 ms; viewers lengthen delays below 20 ms."""
LARGEST, LARGEST_SCALED = 65_535, 8192
"""Largest side of a picture, px, without and with enlargement. A GIF stores its sides in 16 bits; the second limit
catches a mistaken `scale`."""
STILL = 25
"""Largest number of equal frames in a row, one second by default. Further equal frames are skipped."""
WINDOW_US, FRAMES = 40_000, 25
"""Default length of a window, us. A recording that is shorter than 25 such windows gets 25 shorter windows."""
LONGEST_LOOK_AHEAD = 1 << 22
"""Number of events (55 MB) that are held at most to find out whether a recording is short."""
MARK = "neuro events gif"
GIF = marked("a GIF of 'neuro events gif'", MARK, "replace=True")
MOST_FRAMES = 10_000
"""Largest number of frames. By default they last seven minutes, and the file has hundreds of MB."""


@dataclass(frozen=True, slots=True)
class Gif:
    """Properties of the file that `gif` wrote.

    Attributes:
        frames: number of frames.
        window_us: time per frame, us.
        left_out: number of frames that were skipped because they repeat the frames before.
        fps: frames per second as shown; delays are multiples of 10 ms.
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

    A frame shows the last event of each pixel in a time window; the windows are consecutive. If more than 25 frames in
    a row are equal, as in a pause, the further ones are skipped.

    Args:
        parts: a recording, or its parts in order.
        path: the file to write.
        fps: frames per second, 0.1 to 50. With windows of 1e6 / fps us the GIF plays in real time.
        window_us: time per frame, us. None: 40,000, or less so that a short recording has 25 frames.
        colours: colours of ON, OFF and background, as names or ``#rrggbb``.
        scale: side of a sensor pixel in the picture, px. None: the longer side of the picture has at least 240 px.
        name: name of the recording in messages.
        replace: replace an existing file that is not a GIF of this function.

    Raises:
        ModelError: no events, more than 10,000 frames, an invalid argument (the message names it), or the file cannot
            be written.
        EventFileError: time jumps over more than 10^6 windows.
    """
    from PIL import Image

    replace = argument("replace", replace, kind="boolean")
    fps = argument("fps", fps, unit="frames per second", at_least=LEAST_FPS, at_most=MOST_FPS)
    window_us = argument("window_us", window_us, kind="microseconds", at_least=1, optional=True)
    scale = argument("scale", scale, kind="integer", at_least=1, optional=True)
    palette = [value for colour in (colours[2], colours[1], colours[0]) for value in _rgb(colour)]
    batches = iter([parts] if isinstance(parts, Events) else parts)
    first, duration = _beginning(batches, WINDOW_US * FRAMES if window_us is None else 0)
    if not first:
        raise ModelError(f"{name} has no events: nothing to draw")
    window_us = window_us or min(WINDOW_US, duration // FRAMES + 1)
    width, height = first[0].sensor_size
    scale = scale or max(1, -(-TALL // max(width, height)))
    if max(width, height) * scale > (LARGEST if scale == 1 else LARGEST_SCALED):
        limit = f"{LARGEST} px, or {LARGEST_SCALED} px enlarged"
        raise ModelError(
            f"scale = {scale}: the picture has {width * scale}x{height * scale} px, expected at most {limit}"
        )
    frames = _Frames(windows(chain(first, batches), window_us, path=name), (width, height))

    def pictures() -> Iterator[Any]:
        for pixels in frames:
            picture = Image.fromarray(np.kron(pixels, np.ones((scale, scale), np.uint8)), "P")
            picture.putpalette(palette)
            yield picture

    delay = max(2, round(100 / fps))
    images = pictures()
    with output(path, GIF, replace) as part:
        next(images).save(
            part, "GIF", save_all=True, append_images=images, duration=10 * delay, loop=0, optimize=False, disposal=1,
            comment=MARK,
        )  # fmt: skip
    return Gif(frames.count, window_us, frames.left_out, 100 / delay, (width * scale, height * scale))


def _beginning(parts: Iterator[Events], enough_us: int) -> tuple[list[Events], int]:
    """Return the first non-empty parts, up to a duration of `enough_us` or more, and the duration of the parts, us.

    All parts are returned if the recording is shorter than `enough_us`. Reading also ends after `LONGEST_LOOK_AHEAD`
    events. The recording then counts as long, and `enough_us` is returned as its duration.
    """
    pending: list[Events] = []
    duration = 0
    for part in parts:
        if len(part):
            pending.append(part)
            duration = int(part.t[-1]) - int(pending[0].t[0])
            if duration >= enough_us:
                break
            if sum(map(len, pending)) > LONGEST_LOOK_AHEAD:
                return pending, enough_us
    return pending, duration


class _Frames:
    """Iterator over the pixels of each frame: 0 without an event, 1 for OFF, 2 for ON.

    Attributes:
        count: number of frames so far.
        left_out: number of skipped frames.
    """

    def __init__(self, parts: Iterator[Events], size: tuple[int, int]) -> None:
        self.count = self.left_out = 0
        self._parts, self._blank = parts, np.zeros((size[1], size[0]), np.uint8)

    def __iter__(self) -> Iterator[npt.NDArray[np.uint8]]:
        previous, n_equal = None, 0
        for events in self._parts:
            pixels = self._blank
            if len(events):
                pixels = pixels.copy()
                pixels[events.y, events.x] = events.p + 1
            n_equal = (
                n_equal + 1 if pixels is previous or (previous is not None and np.array_equal(pixels, previous)) else 1
            )
            previous = pixels
            if n_equal > STILL:
                self.left_out += 1
                continue
            if self.count == MOST_FRAMES:
                raise ModelError(
                    f"more than {MOST_FRAMES:,} frames", hint="use longer windows, or split the recording"
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
"""Default number of events on a page; at 9 bytes each, a page has at most 6 MB."""
PIXELS = 1 << 26
"""Largest canvas of common browsers, px."""
PAGE = sealed(
    "a page of 'neuro events view'",
    '<meta name="generator" content="neuro events view">',
    "<!-- digest {} -->",
    "replace=True",
)
BARS = 400
"""Number of bars in the chart of the event rate."""


def view(
    parts: Events | Iterable[Events],
    path: str | os.PathLike[str],
    *,
    title: str,
    most: int = MOST,
    replace: bool = False,
) -> int:
    """Write a page that plays a recording, in constant memory.

    Args:
        parts: a recording, or its parts in order.
        path: the file to write.
        title: name of the recording.
        most: largest number of events on the page. A longer recording is thinned to one of every 2, 4, 8, ... events,
            beginning with the first.
        replace: replace an existing file that is not such a page.

    Returns:
        The step n: one of every n events is shown.

    Raises:
        ModelError: no events, a sensor of more than 2^26 px, `most` below 1, or the file cannot be written.
    """
    replace = argument("replace", replace, kind="boolean")
    most = argument("most", most, kind="integer", at_least=1)
    events, total, step = _thin([parts] if isinstance(parts, Events) else parts, most)
    if events is None:
        raise ModelError(f"{title}: the recording has no events: nothing to show")
    width, height = events.sensor_size
    if width * height > PIXELS:
        raise ModelError(f"{title}: the sensor has {width}x{height} px, expected at most {PIXELS}: too many to show")
    write_text(file_path(path, "path"), page(events, title, total, step), PAGE, replace)
    return step


def _thin(parts: Iterable[Events], most: int) -> tuple[Events | None, int, int]:
    """Return evenly thinned events, the total number of events, and the step n (one of every n events is kept).

    The step doubles whenever more than `most` events are held. Example: 10 events and most = 4 keep events 0, 4 and 8.
    """
    selected: list[Events] = []
    total, step = 0, 1
    for part in parts:
        selected.append(part[-total % step :: step])  # the events whose number in the recording is a multiple of step
        total += len(part)
        while sum(map(len, selected)) > most:
            step *= 2
            selected = [joined_parts(selected)[::2]]
    selected = [part for part in selected if len(part)]
    return (joined_parts(selected) if selected else None), total, step


def page(events: Events, title: str, total: int, step: int) -> str:
    """Return the page as text.

    Args:
        events: the events to show, at least one.
        title: name of the recording.
        total: number of events in the recording.
        step: one of every `step` events is shown.
    """
    elapsed = events.t - events.t[0]
    unit = 1 + int(elapsed[-1]) // (1 << 32)
    bars, _ = np.histogram(elapsed, BARS, (0, max(1, int(elapsed[-1]))))
    data: dict[str, Any] = {
        "width": events.sensor_size[0], "height": events.sensor_size[1], "unit": unit, "start": str(events.t[0]),
        "t": _base64(elapsed // unit, "<u4"), "x": _base64(events.x, "<u2"), "y": _base64(events.y, "<u2"),
        "p": _base64(events.p, "u1"), "bars": bars.tolist(), "step": step,
    }  # fmt: skip
    width, height = events.sensor_size
    seconds = int(elapsed[-1]) / 1e6
    summary = f"{total:,} events, {width}×{height} px, {seconds:,.3f} s"
    if step > 1:
        summary += f" · 1 of every {step:,} events is shown ({len(events):,})"
    template = Template(files("neuro_events").joinpath("view.html").read_text("utf-8"))
    return template.substitute(
        head=html.head("neuro events view", title),
        style=html.style_sheets(),
        script=html.player_script(),
        title=escape(title),
        summary=escape(summary),
        data=json.dumps(data).replace("<", "\\u003c"),
    )


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
