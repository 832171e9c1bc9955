"""A lap as one page for a browser: the world, the camera's events, spikes and actions side by side.

`fly` flies a lap and keeps all that was seen, thought and done; `page` is that as text, `watch` does both.

"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import html, player, sealed
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Flights, Start, begun, fly_lap
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

TALL, EDGE = 216, 86
"""Height of the raster, and width of the names beside it, px."""
COLOURS = ("a", "b", "c", "d", "e", "f")
"""Of the motors."""
CAMERA = html.Html(
    '<i style="background:var(--on)"></i>brighter <i style="background:var(--off);margin-left:4px"></i>darker '
    '<i style="border:1.5px solid var(--target);border-radius:50%;margin-left:6px"></i>true place'
)
TRAINING = html.Html(
    'by steps: <i style="background:var(--d)"></i>error, weights frozen, short flights from afar: what was learnt '
    '<b style="color:var(--target);margin-left:6px">×</b> target lost in one of them '
    '<i style="background:var(--soft);margin-left:4px"></i>mean reward of a step of episodes with learning on: '
    "dopamine steers, and exploration disturbs"
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


class _Filmed(Flights):
    """A lap of which all is kept, by the names of `Flight`."""

    def reset(self, **words: Any) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin the lap."""
        self.kept: dict[str, list[Any]] = {}
        self.seen: list[neuro.events.Events] = []
        answer = super().reset(**words)
        self._keep(np.zeros(self.scenario.axes))
        return answer

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """See `DroneEnv`."""
        answer = super().step(action)
        self._keep(np.array(action))
        return answer

    def _keep(self, action: npt.NDArray[Any]) -> None:
        info = self.last[-1]
        measured = {"targets": info["target"], "errors": info["error_px"], "actions": action, "counts": info["counts"]}
        for name, value in (_where(self) | measured).items():
            self.kept.setdefault(name, []).append(value)
        self.seen.append(info["events"])


def fly(model: Model, start: Start, backend: str = "event") -> Flight:
    """Fly a lap with frozen weights.

    Args:
        model: what flies; spikes of a network, also those of its inputs, are all kept.
        start: where.
        backend: what runs the controller's network.

    Raises:
        ModelError: the start cannot be, or the backend refuses the network.
    """
    env, listened = _Filmed(model.scenario, [begun(start)]), model
    if model.network:
        net = unpacked(model.network)
        for name, population in net.populations.items():
            if isinstance(population.model, neuro.poisson_generator):
                net.probe(f"heard_{name}", population)
        listened = replace(model, network=packed(net))
    loop = listened.loop(env, backend=backend, record=True)
    lap = fly_lap(loop, env, start)
    env.close()
    kept = env.kept
    whole: dict[str, Any] = {name: np.array(values) for name, values in kept.items() if name != "balls"}
    balls = np.array([ball for ball in kept["balls"] if ball is not None]).reshape(-1, 2)
    whole |= {name: np.concatenate([getattr(part, name) for part in env.seen]) for name in "xyp"}
    each, recorded = np.array([len(part) for part in env.seen]), []
    if model.network:
        recorded = [(part, loop.sim.spikes(part.name)) for part in loop.sim.program.populations if part.records]
    spikes = tuple(FlightSpikes(part.name, part.size, *trains) for part, trains in recorded)
    whole |= {"path": env.task.path.points, "spikes": spikes, "balls": balls, "events": each}
    return Flight(model, start, **whole, lap=lap.lap, lost=lap.lost, backend=backend)


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
    line = isinstance(model.scenario.task, Line)
    begin = Start(start or ((20.0, 10.0) if line else (-30.0, -30.0)), 1 if line else 0, course.lap(0, line))

    def make() -> tuple[str, str]:
        flight = fly(model, begin, backend)
        return page(flight), outcome(flight)

    return player.write(file, PAGE, "a lap is written as", make)


def outcome(flight: Flight) -> str:
    """Return duration, error and end of a lap in a few words."""
    end = "a lap that counts" if flight.lap else "the target was lost" if flight.lost else "no lap that counts"
    seconds = (len(flight.errors) - 1) * flight.model.scenario.step / 1000.0
    return f"{seconds:.1f} s, mean error {flight.errors[1:].mean():.2f} px, {end}"


def page(flight: Flight) -> str:
    """The page as text."""
    model, world = flight.model, flight.model.scenario
    taught = f"after {model.steps:,} steps of training (seed {model.seed})" if model.steps else "which does not learn"
    thinned = player.evenly(len(flight.x), MOST)
    about = [f"{model.controller}, {taught}", "weights frozen, no dopamine", str(flight.start.path), outcome(flight)]
    about += [f"network on {flight.backend}"] if flight.spikes and flight.backend != "event" else []
    about += [f"one of every {thinned} events is shown"] if thinned > 1 else []
    steps, window = len(flight.errors) - 1, max(3000.0, 20 * world.step) / world.step
    timeline = player.Timeline(
        end=steps,
        begin=min(steps, round(window)),
        rate=1.0 / world.step,
        speeds=[(f"{speed:g}×", speed) for speed in (0.1, 0.25, 0.5, 1, 2, 5, 10)],
        speed=3,
        shift=round(1000 / world.step),
        help="move by a step, with <kbd>shift</kbd> by a second",
        scale=world.step / 1000.0,
        digits=2,
        unit=" s",
        readouts=[player.Readout("error", flight.errors, 1, " px")],
    )
    spikes = "Spikes and actions" if flight.spikes else "Fields and actions"
    note = f"of the last {window * world.step / 1000:g} s"
    note += "" if flight.spikes else "; this controller has no spiking neurons"
    below = [
        player.Panel(spikes, [_raster(flight, window), _actions(flight, window)], note),
        player.Panel("Error", [_errors(flight)], "of the whole lap, px; click to go there", controls=True),
    ]
    if len(model.history.get("returns", ())):
        below.append(player.Panel("Training", [_training(model)], TRAINING))
    script = files("neuro_drone").joinpath("watch.js").read_text("utf-8")
    columns = "1fr 1fr 216px"
    title = f"{model.controller} in {world.name}"
    return player.page(
        "neuro drone watch", title, about, timeline, _top(flight, thinned), below, columns=columns, script=script
    )


def _top(flight: Flight, thinned: int) -> list[player.Panel | list[player.Panel]]:
    """World, camera, fields and stick."""
    world, names = flight.model.scenario, motors(flight.model.scenario)
    seen = {
        "path": flight.path[:: max(1, len(flight.path) // POINTS)].ravel(), "poses": flight.poses.ravel(),
        "foot": flight.footprints.ravel(), "balls": flight.balls.ravel(), "heights": flight.heights,
        "winds": flight.winds.ravel(), "loads": flight.loads, "climbs": world.axes > 2, "step": world.step,
        "ball": world.task.radius if isinstance(world.task, Ball) else 0,
        "width": world.task.width if isinstance(world.task, Line) else 0,
    }  # fmt: skip
    ends = np.concatenate(([0], np.cumsum(flight.events)))
    place = 2 * (128 * flight.y.astype(int) + flight.x) + flight.p
    camera = {
        "width": 128, "height": 128, "place": place[::thinned], "first": -(-ends // thinned), "unit": 1, "span": 4,
        "fade": [1, 0.45, 0.25, 0.13], "targets": flight.targets.ravel(),
        "talls": np.nan_to_num(flight.talls, posinf=0.0),
    }  # fmt: skip
    shades = np.rint(255 * np.minimum(1.0, flight.counts / _busy(flight))).astype(np.uint8).ravel()
    fields = {"rows": 8, "columns": 8, "values": shades, "shade": ["faint", "accent", 1], "tiles": True}
    stick = {"actions": flight.actions.ravel(), "axes": world.axes, "motors": names}
    return [
        player.Panel(
            "World",
            [player.Track("world", "world", "drone, camera and target from above", seen, square=True)],
            "from above",
        ),
        player.Panel(
            "Event camera", [player.Track("camera", "camera", "events of the camera", camera, square=True)], CAMERA
        ),
        [
            player.Panel(
                "Fields", [player.Track("image", "fields", "events in 8 x 8 fields", fields, square=True)], "events"
            ),
            player.Panel("Action", [player.Track("stick", "stick", "action", stick, square=True)]),
        ],
    ]


def _busy(flight: Flight) -> int:
    """Events of the fullest field, exceeded in a tenth of the steps: its shade is the darkest."""
    fullest = np.sort(flight.counts.max(axis=(1, 2)))
    return max(1, int(fullest[int(0.9 * len(fullest))]))


def _raster(flight: Flight, window: float) -> player.Track:
    """Spikes of all populations; of a controller without neurons the events of the fields."""
    world, names = flight.model.scenario, motors(flight.model.scenario)
    if not flight.spikes:
        counts = flight.counts.reshape(len(flight.counts), -1)
        steps, ids = counts.nonzero()
        level = np.rint(255 * np.minimum(1.0, 0.2 + 0.8 * counts[steps, ids] / _busy(flight))).astype(np.uint8)
        strip = {"name": "fields", "size": 64, "height": TALL, "times": steps, "ids": ids, "level": level, "each": 1}
        return player.Track(
            "raster", "raster", "events of the fields", {"strips": [strip], "window": window, "edge": EDGE}
        )
    strips, pilots = list[dict[str, Any]](), [one.name == "motors" and one.size == len(names) for one in flight.spikes]
    roots = [0.0 if pilot else np.sqrt(one.size) for one, pilot in zip(flight.spikes, pilots, strict=True)]
    weights = np.array(
        [0.4 if pilot else 0.6 * root / (sum(roots) or 1.0) for pilot, root in zip(pilots, roots, strict=True)]
    )
    for one, pilot, share in zip(flight.spikes, pilots, weights / weights.sum(), strict=True):
        every = player.evenly(len(one.times), MOST)
        strip = {
            "name": one.name, "size": one.size, "height": share * (TALL + 8) - 8,
            "times": one.times[::every] / world.step, "ids": one.ids[::every],
        }  # fmt: skip
        strips.append(strip | ({"labels": names, "colours": COLOURS} if pilot else {}))
    return player.Track("raster", "raster", "spikes", {"strips": strips, "window": window, "edge": EDGE})


def _actions(flight: Flight, window: float) -> player.Track:
    names = motors(flight.model.scenario)[::2]
    lines = [
        {"y": actions, "style": "steps", "colour": COLOURS[2 * axis], "width": 1.8, "name": names[axis]}
        for axis, actions in enumerate(flight.actions.T)
    ]
    lane = {"low": -1, "high": 1, "zero": True, "lines": lines}
    return player.Track("curve", "actions", "actions along time", {"lanes": [lane], "window": window, "edge": EDGE}, 76)


def _errors(flight: Flight) -> player.Track:
    line = {"y": flight.errors, "style": "area", "colour": "accent"}
    lane = {"low": 0, "high": max(10.0, flight.errors.max()), "marks": 3, "unit": " px", "lines": [line]}
    data = {"lanes": [lane], "edge": EDGE, "cursor": "ink", "click": True, "fades": True}
    return player.Track("curve", "lap", "error along the lap", data, 54)


def _training(model: Model) -> player.Track:
    """Errors with frozen weights along the training, and the mean reward of a step of each episode."""
    history, curve = model.history, model.curve
    tested, frozen, lost = (np.asarray(curve.get(name, ()), float) for name in ("steps", "error_px", "lost"))
    rewards = {"x": history["steps"], "y": history["returns"] / history["lengths"], "style": "dots", "colour": "soft"}
    lines = [
        {"x": tested, "y": frozen, "style": "rings", "colour": "d", "width": 1.8},
        {"x": tested[lost > 0], "y": frozen[lost > 0], "style": "crosses", "colour": "target", "width": 1.8},
    ]
    lanes = [
        {"low": 0, "high": max(10.0, frozen.max(initial=0.0)), "marks": 3, "unit": " px", "lines": lines},
        {"low": 0, "high": 1, "marks": 2, "lines": [rewards]},
    ]
    data = {"lanes": lanes, "edge": EDGE, "end": model.steps, "axis": "steps"}
    return player.Track("curve", "training", "error and reward along the training", data, 160)
