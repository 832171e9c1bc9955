"""A recording as one page for a browser, with a time line to move along; the page needs nothing else.

Events lie in the page as base64 of little-endian arrays: time since the first event (uint32, in units that make it
fit), column and row (uint16), polarity (uint8). Of very many an even choice is shown, and the page says so.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Iterable
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from neuro.core import html
from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.core.outputs import sealed, write_text
from neuro.core.paths import file_path
from neuro.events._events import Events
from neuro.events.parts import together

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
    template = Template(files("neuro.events").joinpath("view.html").read_text("utf-8"))
    return template.substitute(
        head=html.head("neuro events view", title),
        script=html.player_script(),
        title=escape(title),
        told=escape(message),
        data=json.dumps(data).replace("<", "\\u003c"),
    )


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
