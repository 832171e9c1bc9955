"""A lap as one page for a browser: the world, the camera's events, spikes and actions side by side.

`fly` flies a lap and keeps all that was seen, thought and done; `page` is that as text, `watch` does both.

All data lie in the page as base64 of little-endian arrays, so it needs nothing else; no screen is needed to make it.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, replace
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.apps import html, output, sealed
from neuro_drone.controllers import Controller
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, begin
from neuro_drone.geometry import CameraView
from neuro_drone.model import Model, packed, unpacked
from neuro_drone.parts import Ball, Line
from neuro_drone.paths import VARIED, FlightCourse
from neuro_drone.report import motors

MOST = 3_000_000
"""Events, and spikes of a population, of a page; of more an even choice is shown."""

PAGE = sealed(
    "a page of 'neuro drone watch'", '<meta name="generator" content="neuro drone watch">', "<!-- digest {} -->"
)

POINTS = 600
"""Points of the path."""

FAR = 6.0
"""How far away the ground is drawn that the camera sees, m; towards the horizon it would have no end."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightSpikes:
    """Of one population.

    Attributes:
        name: of it.
        size: neurons.
        times: ms since the start, (n,).
        ids: (n,) neurons.
    """

    name: str
    size: int
    times: npt.NDArray[np.float64]
    ids: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """What happened in each step of a lap, from the start (without an action) on.

    Attributes:
        model: that flew.
        start: where it began.
        path: (m, 2) the target's way, m.
        poses: (n, 3) place and heading of the drone, m and rad.
        heights: (n,) of the drone, m.
        winds: (n, 2) in which it flew to there, m/s.
        loads: (n,) that it carried, kg.
        footprints: (n, 4, 2) corners of what the camera sees of the ground, clockwise from the far left, m.
        balls: (n, 2) the ball's place, m; empty for a line.
        talls: (n,) how tall its picture is, px; 0 for a line.
        targets: (n, 2) column and row of the target in the picture, px.
        errors: (n,) px.
        actions: (n, axes); that of the start is 0.
        counts: (n, 8, 8) events of the fields.
        events: (n,) of each step, in x, y and p.
        x, y, p: column, row and polarity of all events.
        spikes: of all populations of the controller, if it has any.
        lap: whether the lap counts.
        lost: whether the target was lost.
        backend: what ran the controller's network.
    """

    model: Model
    start: Start
    path: npt.NDArray[np.float64]
    poses: npt.NDArray[np.float64]
    heights: npt.NDArray[np.float64]
    winds: npt.NDArray[np.float64]
    loads: npt.NDArray[np.float64]
    footprints: npt.NDArray[np.float64]
    balls: npt.NDArray[np.float64]
    talls: npt.NDArray[np.float64]
    targets: npt.NDArray[np.float64]
    errors: npt.NDArray[np.float64]
    actions: npt.NDArray[np.float64]
    counts: npt.NDArray[np.int64]
    events: npt.NDArray[np.int64]
    x: npt.NDArray[Any]
    y: npt.NDArray[Any]
    p: npt.NDArray[Any]
    spikes: tuple[FlightSpikes, ...]
    lap: bool
    lost: bool
    backend: str = "event"


class _Keeping:
    """A simulation that forgets no spikes, so that they can be had after a lap."""

    def __init__(self, sim: neuro.Simulation) -> None:
        self._sim = sim

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sim, name)

    def forget(self, before: float) -> None:
        """Forget nothing."""


def listening(model: Model, backend: str = "event") -> Controller:
    """A frozen controller whose spikes, also those of its inputs, are all recorded and kept.

    Args:
        model: what was learnt; of a controller without a network it is as `Model.frozen`.
        backend: what runs the network.
    """
    if not model.network:
        return model.frozen(None, backend)
    net = unpacked(model.network)
    for name, population in net.populations.items():
        if isinstance(population.model, neuro.poisson_generator):
            net.probe(f"heard_{name}", population)
    pilot = replace(model, network=packed(net)).frozen(None, backend)
    pilot.sim = _Keeping(pilot.sim)  # type: ignore[attr-defined]
    return pilot


def fly(model: Model, start: Start, backend: str = "event") -> Flight:
    """Fly a lap with frozen weights.

    Args:
        model: what flies.
        start: where.
        backend: what runs the controller's network.

    Raises:
        ModelError: the start cannot be, or the backend refuses the network.
    """
    pilot, env = listening(model, backend), DroneEnv(model.scenario)
    info = begin(env, start)
    pilot.begin()
    kept: dict[str, list[Any]] = {}
    seen: list[neuro.events.Events] = []
    action, over = np.zeros(model.scenario.axes), False
    while True:
        measured = {"targets": info["target"], "errors": info["error_px"], "actions": action, "counts": info["counts"]}
        for name, value in (_where(env) | measured).items():
            kept.setdefault(name, []).append(value)
        seen.append(info["events"])
        if over:
            break
        action = np.array(pilot.act(info["counts"], info))
        _, _, lost, end, info = env.step(action)
        over = lost or end
    env.close()
    whole: dict[str, Any] = {name: np.array(values) for name, values in kept.items() if name != "balls"}
    balls = np.array([ball for ball in kept["balls"] if ball is not None]).reshape(-1, 2)
    whole |= {name: np.concatenate([getattr(part, name) for part in seen]) for name in "xyp"}
    each = np.array([len(part) for part in seen])
    whole |= {"path": env.task.path.points, "spikes": _heard(pilot), "balls": balls, "events": each}
    return Flight(model, start, **whole, lap=bool(info["lap"]), lost=bool(info["lost"]), backend=backend)


def _where(env: DroneEnv) -> dict[str, Any]:
    """How the world is now, by the names of `Flight`."""
    ball, pose, weather = env.task.scene().ball, env.body.pose, env.weather
    return {
        "poses": (pose.x, pose.y, pose.yaw),
        "heights": pose.z,
        "winds": weather.wind,
        "loads": weather.load,
        "footprints": footprint(env.view),
        "balls": ball and ball[:2],
        "talls": env.view.tall(*ball) if ball else 0.0,
    }


def footprint(view: CameraView) -> list[tuple[float, float]]:
    """Corners of what a camera sees of the ground up to `FAR`, clockwise from the far left."""
    low, high = -0.5, view.size - 0.5
    x, y, _ = view.place()
    for row in np.arange(low, high, 2.0).tolist():
        far = view.ground(view.middle, row)
        if far is not None and np.hypot(far[0] - x, far[1] - y) <= FAR:
            break
    corners = [view.ground(u, v) for u, v in ((low, row), (high, row), (high, high), (low, high))]
    return [corner or (x, y) for corner in corners]


def _heard(pilot: Controller) -> tuple[FlightSpikes, ...]:
    sim = getattr(pilot, "sim", None)
    if sim is None:
        return ()
    return tuple(FlightSpikes(p.name, p.size, *sim.spikes(p.name)) for p in sim.program.populations if p.records)


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
        script=html.player_script(),
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
    course = {"steps": _base64(np.cumsum(history["steps"]), "<f4"), "error": _base64(history["error_px"], "<f4")}
    if len(curve.get("steps", ())):
        course |= {"tested": _base64(curve["steps"], "<f4"), "frozen": _base64(curve["error_px"], "<f4")}
        course |= {"lost": _base64(curve["lost"], "<u2")}
    return course


def _spikes(one: FlightSpikes) -> dict[str, Any]:
    every = max(1, -(-len(one.times) // MOST))
    times, ids = _base64(one.times[::every], "<f4"), _base64(one.ids[::every], "<u2")
    return {"name": one.name, "size": one.size, "times": times, "ids": ids}


def _base64(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")
