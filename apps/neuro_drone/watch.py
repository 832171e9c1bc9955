"""A lap as one page for a browser: the world, the camera's events, spikes and actions side by side.

All data lie in the page as base64 of little-endian arrays, so it needs nothing else; no screen is needed to make it.
"""

from __future__ import annotations

import base64
import json
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import html, output, sealed
from neuro_drone.evaluate import Start
from neuro_drone.flight import Flight, FlightSpikes, fly
from neuro_drone.model import Model
from neuro_drone.parts import Ball, Line
from neuro_drone.paths import VARIED, FlightCourse
from neuro_drone.pictures import motors

__all__ = ["page", "watch"]

MOST = 3_000_000
"""Events, and spikes of a population, of a page; of more an even choice is shown."""

PAGE = sealed(
    "a page of 'neuro drone watch'", '<meta name="generator" content="neuro drone watch">', "<!-- digest {} -->"
)

POINTS = 600
"""Points of the path."""


def watch(
    model: Model,
    file: Path,
    start: tuple[float, ...] | None = None,
    backend: str = "event",
    course: FlightCourse = VARIED,
) -> str:
    """Fly a lap and write the page.

    Args:
        model: what flies, with frozen weights.
        file: the page.
        start: error on each axis at the beginning; if not given -30 px on both, of a line 20 px and 10 degrees. Of
            three axes the third may be left out, it is then 0.
        backend: what runs the controller's network.
        course: whose first path is flown.

    Returns:
        What came of the lap, in a few words.

    Raises:
        ModelError: the file is not called .html or cannot be written, the start cannot be, or the backend refuses
            the network.
    """
    if file.suffix.lower() not in (".html", ".htm"):
        raise ModelError(f"{file}: a lap is written as a page for a browser: expected a name that ends in .html")
    line = isinstance(model.scenario.task, Line)
    begin = Start(start or ((20.0, 10.0) if line else (-30.0, -30.0)), 1 if line else 0, course.lap(0, line))
    with output(file, PAGE) as part:
        flight = fly(model, begin, backend)
        part.write_text(PAGE.seal(page(flight)), "utf-8")
    return told(flight)


def told(flight: Flight) -> str:
    """What came of a lap."""
    end = "a lap that counts" if flight.lap else "the target was lost" if flight.lost else "no lap that counts"
    seconds = (len(flight.errors) - 1) * flight.model.scenario.step / 1000.0
    return f"{seconds:.1f} s, mean error {flight.errors[1:].mean():.2f} px, {end}"


def page(flight: Flight) -> str:
    """The page as text."""
    model, world = flight.model, flight.model.scenario
    taught = f"after {model.steps:,} steps of training (seed {model.seed})" if model.steps else "which does not learn"
    thinned = -(-len(flight.x) // MOST)
    about = [f"{model.controller}, {taught}", "weights frozen, no dopamine", str(flight.start.path), told(flight)]
    about += [f"network on {flight.backend}"] if flight.spikes and flight.backend != "event" else []
    about += [f"one of every {thinned} events is shown"] if thinned > 1 else []
    template = Template(files("neuro_drone").joinpath("watch.html").read_text("utf-8"))
    title = f"{model.controller} in {world.name}"
    return template.substitute(
        head=html.head("neuro drone watch", title),
        style=html.player_style(),
        title=escape(title),
        told=escape(" · ".join(about)),
        data=json.dumps(_data(flight, max(1, thinned))).replace("<", "\\u003c"),
    )


def _data(flight: Flight, thinned: int) -> dict[str, Any]:
    world = flight.model.scenario
    ends = np.concatenate(([0], np.cumsum(flight.events)))
    packed = (flight.x.astype(int) | flight.y.astype(int) << 7 | flight.p.astype(int) << 14)[::thinned]
    names = ("poses", "heights", "winds", "loads", "footprints", "balls", "talls", "targets", "errors", "actions")
    return {
        "step": world.step, "steps": len(flight.errors) - 1, "motors": motors(world),
        "ball": world.task.radius if isinstance(world.task, Ball) else 0,
        "width": world.task.width if isinstance(world.task, Line) else 0,
        "path": _base64(flight.path[:: max(1, len(flight.path) // POINTS)], "<f4"),
        **{name: _base64(np.nan_to_num(getattr(flight, name), posinf=0.0), "<f4") for name in names},
        "counts": _base64(np.minimum(flight.counts, 65535), "<u2"),
        "events": _base64(packed, "<u2"), "first": _base64(-(-ends // thinned), "<u4"),
        "spikes": [_spikes(one) for one in flight.spikes],
        "training": _training(flight.model),
    }  # fmt: skip


def _training(model: Model) -> dict[str, Any]:
    """Errors along the training: of episodes, by the steps at their end, and with frozen weights; empty without one."""
    history, curve = model.history, model.curve
    if not len(history.get("steps", ())):
        return {}
    told = {"steps": _base64(np.cumsum(history["steps"]), "<f4"), "error": _base64(history["error_px"], "<f4")}
    if len(curve.get("steps", ())):
        told |= {"tested": _base64(curve["steps"], "<f4"), "frozen": _base64(curve["error_px"], "<f4")}
        told |= {"lost": _base64(curve["lost"], "<u2")}
    return told


def _spikes(one: FlightSpikes) -> dict[str, Any]:
    every = max(1, -(-len(one.times) // MOST))
    times, ids = _base64(one.times[::every], "<f4"), _base64(one.ids[::every], "<u2")
    return {"name": one.name, "size": one.size, "times": times, "ids": ids}


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
