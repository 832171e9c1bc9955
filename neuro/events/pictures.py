"""Recordings as moving pictures."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from neuro.aside import aside
from neuro.errors import ModelError
from neuro.events._events import Events
from neuro.events.files import windows

COLOURS = ("#0072B2", "#D55E00", "#FFFFFF")
"""ON, OFF and background: Okabe and Ito's blue and vermilion, which colour-blind readers tell apart."""
TALL = 240
"""Small sensors are enlarged by a whole number until their longer side has so many px."""
MOST_FPS = 50.0
"""Programs that show GIFs slow down shorter pauses than 20 ms."""


@dataclass(frozen=True, slots=True)
class Gif:
    """What `gif` wrote.

    Attributes:
        frames: how many.
        fps: frames per second as they are shown; pauses are whole multiples of 10 ms.
        size: width and height of the picture, px.
    """

    frames: int
    fps: float
    size: tuple[int, int]


def gif(
    parts: Events | Iterable[Events],
    path: str | os.PathLike[str],
    *,
    fps: float = 25.0,
    window_us: int = 40_000,
    colours: tuple[str, str, str] = COLOURS,
    scale: int | None = None,
) -> Gif:
    """Draw a recording as an animated GIF, in constant memory.

    A frame shows the last event of each pixel in a window of time; windows follow each other.

    Args:
        parts: a recording, or its parts in order.
        path: the file to write.
        fps: frames per second, up to 50; with a window of 1e6 / fps us, time runs as it did.
        window_us: time of a frame, us.
        colours: of ON, of OFF and of the background, by name or as ``#rrggbb``.
        scale: px of the picture per px of the sensor; None: so that the picture is at least 240 px high or wide.

    Raises:
        ModelError: there are no events, or an argument is wrong; the message says which.
    """
    from PIL import Image

    if not 0 < fps <= MOST_FPS:
        raise ModelError(f"fps = {fps!r}: expected more than 0 and at most {MOST_FPS:g} frames per second")
    if window_us < 1 or (scale is not None and scale < 1):
        raise ModelError(f"window_us = {window_us!r}, scale = {scale!r}: expected whole numbers >= 1")
    palette = [value for colour in (colours[2], colours[1], colours[0]) for value in _rgb(colour)]
    given = iter([parts] if isinstance(parts, Events) else parts)
    first = next((part for part in given if len(part)), None)
    if first is None:
        raise ModelError("the recording has no events: nothing to draw")
    width, height = first.sensor_size
    scale = scale or max(1, -(-TALL // max(width, height)))
    count = 0

    def frames() -> Iterator[Any]:
        nonlocal count
        for events in windows(chain([first], given), window_us):
            pixels = np.zeros((height, width), np.uint8)
            pixels[events.y, events.x] = events.p + 1
            picture = Image.fromarray(np.kron(pixels, np.ones((scale, scale), np.uint8)), "P")
            picture.putpalette(palette)
            count += 1
            yield picture

    pause = max(2, round(100 / fps))
    pictures = frames()
    with aside(Path(path)) as part:
        next(pictures).save(
            part, "GIF", save_all=True, append_images=pictures, duration=10 * pause, loop=0, optimize=False, disposal=1
        )
    return Gif(count, 100 / pause, (width * scale, height * scale))


def _rgb(colour: str) -> tuple[int, ...]:
    from PIL import ImageColor

    try:
        return ImageColor.getrgb(colour)[:3]
    except ValueError:
        raise ModelError(f"unknown colour {colour!r}, expected a name such as white, or #rrggbb") from None
