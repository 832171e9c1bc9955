"""An HTML page that plays a recording with the output of a recogniser: events, views, scores and the decision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import html, player, sealed
from neuro_events import Events, load
from neuro_recognise.deciding import ASSUMES, ASSURANCE, Decision
from neuro_recognise.method import SILENT, Pictures, View
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.report import MOMENTS

MOST = 1_000_000
"""Largest number of events on a page, and of spikes in a view. Larger numbers are subsampled evenly."""
LONGEST_MS = 4000.0
"""Longest duration that is shown, counted from the first event, ms."""
FINER = 3
"""Number of decisions of a page, as a multiple of `MOMENTS`, if `learn_early` has not set the moments."""

TALL = 340
"""Height of the panels in the upper row, px."""
HELP = "move by a moment, with <kbd>shift</kbd> by ten"

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
        recogniser: trained recogniser.
        recording: event file of any readable format.
        out: file of the page.
        allow: largest share of wrong decisions; the page marks the time at which it is met.
        backend: backend that runs networks.
        assurance: assurance of the allowed error, see `Recogniser.session`.

    Returns:
        A summary of the decision in a few words.

    Raises:
        ModelError: the page's name does not end in .html, the page cannot be written, the allowed error cannot be met,
            or the recording is empty or does not fit.
        EventFileError: the recording is damaged.
    """

    def make() -> tuple[str, str]:
        events = watchable(recording)
        first_events = events[: int(np.searchsorted(events.t, int(events.t[0]) + round(1000 * LONGEST_MS), "right"))]
        decided = decisions(recogniser, first_events, allow, backend, assurance)
        views = recogniser.method.views(first_events, recogniser.learnt, recogniser.classes)
        text = page(recogniser, recording.name, first_events, decided, views, allow)
        return text, summary(recogniser, decided, allow)

    return write(out, make)


def write(out: Path, make: Callable[[], tuple[str, str]]) -> str:
    """Write a page, whose name must end in .html, and return its summary."""
    return player.write(out, PAGE, "what is watched is", make)


def watchable(recording: Path) -> Events:
    """Load the events of a file.

    Raises:
        ModelError: the recording has no events.
        EventFileError: the file is damaged.
    """
    events = load(recording)
    if not len(events):
        raise ModelError(f"{recording}: the recording has no events: nothing to watch")
    return events


def decisions(
    recogniser: Recogniser, events: Events, allow: float | None, backend: str, assurance: float = ASSURANCE
) -> list[Decision]:
    """Return the decisions of a recording at the moments of `learn_early`, or else at 60 evenly spaced moments."""
    length_ms = max(1.0, (int(events.t[-1]) - int(events.t[0])) / 1000.0)
    every_ms = recogniser.early.held.times_us[0] / 1000.0 if recogniser.early else length_ms / (FINER * MOMENTS)
    window_ms = length_ms + every_ms
    session = recogniser.session(
        every_ms=every_ms, allow=allow, assurance=assurance, window_ms=window_ms, backend=backend
    )
    return session.feed(events) + session.end()


def summary(recogniser: Recogniser, decisions: Sequence[Decision], allow: float | None) -> str:
    """Return the decision and its time in a few words."""
    stop = next((decision for decision in decisions if decision.settled), None)
    final = stop or decisions[-1]
    name = "silent" if final.label == SILENT else recogniser.classes[final.label]
    if stop is not None:
        return (
            f"{name}, settled after {stop.after_ms:.0f} of {decisions[-1].after_ms:.0f} ms for an error of {allow:.1%}"
        )
    if final.label == SILENT:
        return f"{name}, after all {final.after_ms:.0f} ms"
    # The moments of `neuro recognise predict`, so that both report the same time.
    comparable = decisions if recogniser.early else decisions[FINER - 1 :: FINER]
    last_change = final
    for decision in reversed(comparable):
        if decision.label != final.label:
            break
        last_change = decision
    return f"{name}, unchanged since {last_change.after_ms:.0f} of {final.after_ms:.0f} ms"


def page(
    recogniser: Recogniser,
    title: str,
    events: Events,
    decisions: Sequence[Decision],
    views: Sequence[View] = (),
    allow: float | None = None,
) -> str:
    """Return the page as text.

    Args:
        recogniser: recogniser that decided.
        title: name of the recording.
        events: events of the recording, at least one.
        decisions: decisions over time, at least one.
        views: intermediate results of the method.
        allow: allowed share of wrong decisions; None if there is no limit.
    """
    decision, stop = (
        np.array([decision_k.after_ms for decision_k in decisions]),
        next((k for k, decision_k in enumerate(decisions) if decision_k.settled), None),
    )
    scores = np.stack([decision_k.scores for decision_k in decisions]).astype(np.float64)
    scores[~np.isfinite(scores)] = np.nan
    finite = np.isfinite(scores).sum(axis=1, keepdims=True)
    scores -= np.nansum(scores, axis=1, keepdims=True) / np.maximum(
        finite, 1
    )  # the mean is subtracted because votes grow for all classes over time
    low, high = (float(np.nanmin(scores)), float(np.nanmax(scores))) if finite.any() else (0.0, 1.0)
    end = max(1.0, length_ms(events), float(decision[-1]))
    track, notes = event_track(events, end, 10, 20.0)
    lit = np.array([decision_k.label for decision_k in decisions])[:, None] == np.arange(len(recogniser.classes))
    bars = {
        "labels": [name[:12] for name in recogniser.classes], "values": scores.ravel(), "lit": lit.ravel(),
        "low": [min(0.0, low)], "high": [high], "notes": _notes(recogniser, decisions, stop),
    }  # fmt: skip
    top = [
        player.Panel(
            "Events", [player.Track("events", "events", "events of the sensor", track, TALL)], span_note(track["span"])
        ),
        *(_view(view, f"view{k}") for k, view in enumerate(views)),
        player.Panel(
            "Scores now, less their mean", [player.Track("bars", "bars", "scores of the classes now", bars, TALL)]
        ),
    ]
    winner = decisions[-1 if stop is None else stop].label
    order = [k for k in range(len(recogniser.classes)) if k != winner] + ([winner] if winner >= 0 else [])
    lines = [
        {"x": decision, "y": scores[:, k], "name": recogniser.classes[k], "colour": "accent" if k == winner else "grey",
         "width": 2.6 if k == winner else 1.2}
        for k in order
    ]  # fmt: skip
    curve: dict[str, Any] = {
        "lanes": [{"low": low, "high": high, "lines": lines}], "edge": 4, "right": 70, "axis": "ms", "fades": True,
        "cursor": "ink", "click": True,
    }  # fmt: skip
    note = "scores of all classes over time, less their mean; the coloured line is the decided class"
    if stop is not None:
        curve["stop"] = {"at": decision[stop], "text": f"settled: {recogniser.classes[winner]}"}
        note += ", dashed where it is settled"
    below = player.Panel(
        "Scores", [player.Track("curve", "curve", "scores along time", curve, 210)], note, controls=True
    )
    texts = [
        summary(recogniser, decisions, allow),
        recogniser.method.title,
        *notes,
        *([] if allow is None else [ASSUMES]),
    ]
    columns = f"repeat({len(top)}, minmax(0, 1fr))"
    title = f"{title} by {recogniser.method.called()}"
    return played(title, texts, end, decision, top, below, columns, help_=f"{HELP}; click the scores to go there")


def played(
    title: str,
    about: Sequence[str],
    end: float,
    moments: npt.NDArray[np.float64],
    top: Sequence[player.Panel],
    below: player.Panel,
    columns: str,
    *,
    script: str = "",
    help_: str = HELP,
) -> str:
    """Return the text of a page whose time is in ms; see `neuro.apps.player.page`."""
    speeds = [(f"1/{part}×" if part > 1 else "1×", 1 / part) for part in (1000, 300, 100, 30, 10, 3, 1)]
    speed = player.closest(speeds, end / 8000)  # a recording takes about eight seconds
    timeline = player.Timeline(end, end / 3, 1.0, speeds, speed, 10, help_, moments=moments, digits=1, unit=" ms")
    return player.page("neuro recognise", title, about, timeline, top, [below], columns=columns, script=script)


def event_track(events: Events, end: float, parts: float, most: float) -> tuple[dict[str, Any], list[str]]:
    """Return the events as a track of a page, evenly subsampled if there are many, and a few words about them.

    Args:
        events: all events.
        end: duration of the page, ms.
        parts: each moment shows the events of the time before it, which is at most `end` / `parts`.
        most: longest time that a moment shows, ms.
    """
    stride = player.evenly(len(events), MOST)
    width, height = events.sensor_size
    notes = [f"{len(events):,} events, {width}×{height} px"]
    notes += [f"one of every {stride} events is shown"] if stride > 1 else []
    shown_events, first = events[::stride], int(events.t[0]) if len(events) else 0
    data = {
        "width": width, "height": height, "t": shown_events.t - first, "unit": 0.001,
        "place": 2 * (shown_events.y.astype(np.int64) * width + shown_events.x) + shown_events.p,
        "span": max(1.0, min(most, end / parts)), "fade": np.linspace(1.0, 0.25, 9).tolist(),
    }  # fmt: skip
    return data, notes


def length_ms(events: Events) -> float:
    """Return the time from the first to the last event, ms; 0 without events."""
    return (int(events.t[-1]) - int(events.t[0])) / 1000.0 if len(events) else 0.0


def span_note(span: float) -> html.Html:
    """Return the colour key of a panel of events."""
    return html.Html(
        '<i style="background:var(--on)"></i>brighter <i style="background:var(--off);margin-left:4px"></i>darker, '
        f"of the last <output>{span:.{0 if span >= 10 else 1}f} ms</output>"
    )


def _notes(recogniser: Recogniser, decisions: Sequence[Decision], stop: int | None) -> list[str]:
    """Return the text before the first moment, and the text at each moment."""
    notes = ["nothing decided yet"]
    for k, decision in enumerate(decisions):
        sure = f", {100 * decision.confidence:.0f} % sure" if np.isfinite(decision.confidence) else ""
        settled = ", settled" if stop is not None and k >= stop else ""
        notes.append("silent" if decision.label < 0 else f"says {recogniser.classes[decision.label]}{sure}{settled}")
    return notes


def _view(view: View, name: str) -> player.Panel:
    count = len(view.at_ms)
    texts = [f"{k + 1} of {count}, from {start_ms:.0f} ms" for k, start_ms in enumerate(view.at_ms)]
    notes = [" · ".join(pair) for pair in zip(texts, view.captions, strict=True)] if len(view.captions) else texts
    data: dict[str, Any] = {"at": view.at_ms, "notes": ["none yet", *notes]}
    if isinstance(view, Pictures):
        shades = np.clip(np.rint(255.0 * view.images / (float(view.images.max(initial=0.0)) or 1.0)), 0, 255)
        _, rows, columns = view.images.shape
        data |= {"rows": rows, "columns": columns, "values": shades.astype(np.uint8).ravel()}
        data["shade"] = ["paper", "ink", 0.5]
        return player.Panel(view.name, [player.Track("image", name, view.name, data, TALL)])
    stride = player.evenly(len(view.times), MOST)
    strip = {
        "name": "neurons", "size": view.size, "times": view.times[::stride], "ids": view.size - 1 - view.ids[::stride],
        "labels": list(view.bands)[::-1],
    }  # fmt: skip
    data |= {"strips": [strip], "window": view.length_ms, "ends": -(-view.offsets // stride)}
    return player.Panel(view.name, [player.Track("raster", name, view.name, data, TALL)])
