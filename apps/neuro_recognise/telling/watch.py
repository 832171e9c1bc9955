"""A recording and what a recogniser makes of it as one page for a browser: events, views, scores, the decision.

All data lie in the page as base64 of little-endian arrays, so it needs nothing else; no screen is needed to make it.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import html, output, sealed
from neuro.events import Events, load
from neuro_recognise.deciding import ASSUMES, ASSURANCE, Decision
from neuro_recognise.method import SILENT, Pictures, View
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.report import MOMENTS

MOST = 1_000_000
"""Events, and spikes of a view, of a page; of more an even choice is shown."""
LONGEST_MS = 4000.0
"""Of a recording; what comes later is not shown, since time is counted in ms from the first event."""
FINER = 3
"""Moments of a page for each of `MOMENTS`, where no moments were learnt."""

PAGE = sealed("a page of 'neuro recognise'", '<meta name="generator" content="neuro recognise">', "<!-- digest {} -->")


def watch(
    recogniser: Recogniser,
    recording: Path,
    out: Path,
    allow: float | None = None,
    backend: str = "event",
    assurance: float = ASSURANCE,
) -> str:
    """Write the page of a recording.

    Args:
        recogniser: what was learnt.
        recording: a file of any readable format.
        out: the page.
        allow: share of wrong decisions for which the page says when it could be stopped.
        backend: runs networks.
        assurance: of an allowed error, see `Recogniser.session`.

    Returns:
        What came of it, in a few words.

    Raises:
        ModelError: the page is not called .html or cannot be written, the allowed error cannot be met, or the
            recording is empty or does not fit.
        EventFileError: the recording is damaged.
    """
    check_page(out)
    with output(out, PAGE) as part:
        events = watchable(recording)
        first = int(events.t[0])
        seen = events[: int(np.searchsorted(events.t, first + round(1000 * LONGEST_MS), "right"))]
        said = decisions(recogniser, seen, allow, backend, assurance)
        views = recogniser.method.views(seen, recogniser.learnt, recogniser.classes)
        part.write_text(PAGE.seal(page(recogniser, recording.name, seen, said, views, allow)), "utf-8")
    return told(recogniser, said, allow)


def watchable(recording: Path) -> Events:
    """The events of a file.

    Raises:
        ModelError: there are none.
        EventFileError: it is damaged.
    """
    events = load(recording)
    if not len(events):
        raise ModelError(f"{recording}: the recording has no events: nothing to watch")
    return events


def check_page(out: Path) -> None:
    """Refuse a name that is not that of a page.

    Raises:
        ModelError: it ends otherwise.
    """
    if out.suffix.lower() not in (".html", ".htm"):
        raise ModelError(f"{out}: what is watched is a page for a browser: expected a name that ends in .html")


def decisions(
    recogniser: Recogniser, events: Events, allow: float | None, backend: str, assurance: float = ASSURANCE
) -> list[Decision]:
    """What is decided of a recording while it goes on: at the moments that were learnt, else at 60."""
    length_ms = max(1.0, (int(events.t[-1]) - int(events.t[0])) / 1000.0)
    every_ms = recogniser.early.held.times_us[0] / 1000.0 if recogniser.early else length_ms / (FINER * MOMENTS)
    window_ms = length_ms + every_ms
    session = recogniser.session(
        every_ms=every_ms, allow=allow, assurance=assurance, window_ms=window_ms, backend=backend
    )
    return session.feed(events) + session.end()


def told(recogniser: Recogniser, said: Sequence[Decision], allow: float | None) -> str:
    """What is decided, and when."""
    stop = next((one for one in said if one.settled), None)
    one = stop or said[-1]
    name = "silent" if one.label == SILENT else recogniser.classes[one.label]
    if stop is not None:
        return f"{name}, settled after {stop.after_ms:.0f} of {said[-1].after_ms:.0f} ms for an error of {allow:.1%}"
    if one.label == SILENT:
        return f"{name}, after all {one.after_ms:.0f} ms"
    # The moments of `neuro recognise predict`, so that both report the same time.
    asked = said if recogniser.early else said[FINER - 1 :: FINER]
    since = one
    for decision in reversed(asked):
        if decision.label != one.label:
            break
        since = decision
    return f"{name}, unchanged since {since.after_ms:.0f} of {one.after_ms:.0f} ms"


def page(
    recogniser: Recogniser,
    title: str,
    events: Events,
    said: Sequence[Decision],
    views: Sequence[View] = (),
    allow: float | None = None,
) -> str:
    """The page as text.

    Args:
        recogniser: what decided.
        title: what to call the recording.
        events: at least one.
        said: the decisions, at least one.
        views: what the method makes of the recording.
        allow: the allowed error, None where none was asked.
    """
    seen, about = shown(events)
    data = seen | _said(recogniser, said) | {"views": [_view(one) for one in views]}
    return filled(
        f"{title} by {recogniser.method.called()}",
        [told(recogniser, said, allow), recogniser.method.title, *about, *([] if allow is None else [ASSUMES])],
        data,
    )


def shown(events: Events) -> tuple[dict[str, Any], list[str]]:
    """The events of a page as data, and a few words on them; of many an even choice."""
    every = max(1, -(-len(events) // MOST))
    width, height = events.sensor_size
    about = [f"{len(events):,} events, {width}×{height} px"]
    about += [f"one of every {every} events is shown"] if every > 1 else []
    some, first = events[::every], int(events.t[0]) if len(events) else 0
    data = {
        "width": width, "height": height, "end": (int(events.t[-1]) - first) / 1000.0 if len(events) else 0.0,
        "t": _base64(some.t - first, "<u4"), "x": _base64(some.x, "<u2"), "y": _base64(some.y, "<u2"),
        "p": _base64(some.p, "u1"),
    }  # fmt: skip
    return data, about


def filled(title: str, about: Sequence[str], data: Mapping[str, Any]) -> str:
    """The text of a page.

    Args:
        title: of the page.
        about: a few words each, that stand below it.
        data: events as of `shown`, with decisions and views, or with boxes.
    """
    template = Template(files("neuro_recognise.telling").joinpath("watch.html").read_text("utf-8"))
    return template.substitute(
        head=html.head("neuro recognise", title),
        style=html.player_style(),
        title=escape(title),
        told=escape(" · ".join(about)),
        data=json.dumps(data).replace("<", "\\u003c"),
    )


def _said(recogniser: Recogniser, said: Sequence[Decision]) -> dict[str, Any]:
    return {
        "classes": list(recogniser.classes), "at": _base64([one.after_ms for one in said], "<f4"),
        "scores": _base64(np.stack([one.scores for one in said]), "<f4"), "labels": [one.label for one in said],
        "confidence": _base64([one.confidence for one in said], "<f4"),
        "stop": next((k for k, one in enumerate(said) if one.settled), -1),
    }  # fmt: skip


def _view(view: View) -> dict[str, Any]:
    words = {"name": view.name, "at": _base64(view.at_ms, "<f4"), "told": list(view.told)}
    if isinstance(view, Pictures):
        most = float(view.images.max(initial=0.0)) or 1.0
        shades = np.clip(np.rint(255.0 * view.images / most), 0, 255)
        _, rows, columns = view.images.shape
        return words | {"rows": rows, "columns": columns, "images": _base64(shades, "u1")}
    every = max(1, -(-len(view.times) // MOST))
    ends = -(-view.offsets // every)
    times, ids = _base64(view.times[::every], "<f4"), _base64(view.ids[::every], "<u4")
    return words | {
        "size": view.size, "bands": list(view.bands), "length": view.length_ms, "ends": _base64(ends, "<u4"),
        "times": times, "ids": ids,
    }  # fmt: skip


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
