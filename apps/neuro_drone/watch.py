"""A lap as one page for a browser: the world, the camera's events, spikes and actions side by side.

`fly` flies and records a lap, `page` makes the HTML text, and `watch` does both.
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
from neuro_drone.evaluate import Flights, Start, fly_lap, reset_arguments
from neuro_drone.geometry import CameraView
from neuro_drone.model import Model, pack_network, unpack_network
from neuro_drone.parts import Ball, Line
from neuro_drone.paths import VARIED, FlightCourse
from neuro_drone.report import motors

MOST = 3_000_000
"""Largest number of events, and of spikes of a population, on a page. Of larger numbers, every n-th is shown."""

PAGE = sealed(
    "a page of 'neuro drone watch'", '<meta name="generator" content="neuro drone watch">', "<!-- digest {} -->"
)

TALL, EDGE = 216, 86
"""Height of the raster and width of the names beside it, px."""
COLOURS = ("item2", "item1", "item3", "item4", "item5", "soft")
"""Colours of the motors, by their names in the page's style."""
CAMERA = html.Html(
    '<i style="background:var(--on)"></i>brighter <i style="background:var(--off);margin-left:4px"></i>darker '
    '<i style="border:1.5px solid var(--bad);border-radius:50%;margin-left:6px"></i>true position'
)
TRAINING = html.Html(
    'by steps: <i style="background:var(--item4)"></i>error with frozen weights in short flights from far starts '
    '<b style="color:var(--bad);margin-left:6px">×</b> target lost in one of them '
    '<i style="background:var(--soft);margin-left:4px"></i>mean reward per step of episodes with learning on, '
    "where the dopamine also steers and exploration disturbs"
)

POINTS = 600
"""Largest number of points of the drawn path."""

FAR = 6.0
"""Largest distance of the drawn footprint from the camera, m. Towards the horizon, the true footprint is infinite."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightSpikes:
    """Spikes of one population.

    Attributes:
        name: name of the population.
        size: number of neurons.
        times: (n,), times of the spikes since the start, ms.
        ids: (n,), neurons of the spikes.
    """

    name: str
    size: int
    times: npt.NDArray[np.float64]
    ids: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """The record of a lap with n steps. The first step is the start, which has no action.

    Attributes:
        model: the model that flew.
        start: the start of the lap.
        path: (m, 2), path of the target, m.
        poses: (n, 3), position and heading of the drone, m and rad.
        heights: (n,), height of the drone, m.
        winds: (n, 2), wind during the step, m/s.
        loads: (n,), mass of the load, kg.
        footprints: (n, 4, 2), corners of the camera's view of the ground, clockwise from the far left, m.
        balls: (n, 2), position of the ball, m; empty for a line.
        talls: (n,), height of the ball's picture, px; 0 for a line.
        targets: (n, 2), column and row of the target in the picture, px.
        errors: (n,), error, px.
        actions: (n, axes); the action of the start is 0.
        counts: (n, 8, 8), events of the fields.
        events: (n,), number of events of each step, in the order of x, y and p.
        x, y, p: column, row and polarity of all events.
        spikes: spikes of all populations of the controller; empty without a spiking network.
        lap: True if the lap counts.
        lost: True if the target was lost.
        backend: backend of the controller's network.
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


class _RecordedFlight(Flights):
    """An environment that records every step of a lap under the names of `Flight`'s attributes."""

    def reset(self, **options: Any) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin the lap."""
        self.values: dict[str, list[Any]] = {}
        self.events: list[neuro.events.Events] = []
        result = super().reset(**options)
        self._record(np.zeros(self.scenario.axes))
        return result

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """See `DroneEnv`."""
        result = super().step(action)
        self._record(np.array(action))
        return result

    def _record(self, action: npt.NDArray[Any]) -> None:
        info = self.last[-1]
        results = {"targets": info["target"], "errors": info["error_px"], "actions": action, "counts": info["counts"]}
        for name, value in (_world_state(self) | results).items():
            self.values.setdefault(name, []).append(value)
        self.events.append(info["events"])


def fly(model: Model, start: Start, backend: str = "event") -> Flight:
    """Fly a lap with frozen weights and record it.

    Args:
        model: the trained model. All spikes of a network are recorded, also those of its inputs.
        start: start of the lap.
        backend: backend of the controller's network.

    Raises:
        ModelError: the start is impossible, or the backend refuses the network.
    """
    env, probed_model = _RecordedFlight(model.scenario, [reset_arguments(start)]), model
    if model.network:
        net = unpack_network(model.network)
        for name, population in net.populations.items():
            if isinstance(population.model, neuro.poisson_generator):
                net.probe(f"heard_{name}", population)
        probed_model = replace(model, network=pack_network(net))
    loop = probed_model.loop(env, backend=backend, record=True)
    lap = fly_lap(loop, env, start)
    env.close()
    arrays: dict[str, Any] = {name: np.array(values) for name, values in env.values.items() if name != "balls"}
    balls = np.array([ball for ball in env.values["balls"] if ball is not None]).reshape(-1, 2)
    arrays |= {name: np.concatenate([getattr(part, name) for part in env.events]) for name in "xyp"}
    counts, recordings = np.array([len(part) for part in env.events]), []
    if model.network:
        recordings = [(part, loop.sim.spikes(part.name)) for part in loop.sim.program.populations if part.records]
    spikes = tuple(FlightSpikes(part.name, part.size, *trains) for part, trains in recordings)
    arrays |= {"path": env.task.path.points, "spikes": spikes, "balls": balls, "events": counts}
    return Flight(model, start, **arrays, lap=lap.lap, lost=lap.lost, backend=backend)


def _world_state(env: DroneEnv) -> dict[str, Any]:
    """Return the state of the world after a step, under the names of `Flight`'s attributes."""
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
    """Return the corners of a camera's view of the ground up to `FAR`, clockwise from the far left, m."""
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
        model: the trained model, flown with frozen weights.
        file: file of the page.
        start: initial error on each axis; default -30 px on both, for a line 20 px and 10 degrees. With three axes the
            third may be left out and is then 0.
        backend: backend of the controller's network.
        course: paths of a test. The lap has the first of these paths.

    Returns:
        The result of the lap as text, see `outcome`.

    Raises:
        ModelError: the file is not called .html or cannot be written, the start is impossible, or the backend refuses
            the network.
    """
    line = isinstance(model.scenario.task, Line)
    lap_start = Start(start or ((20.0, 10.0) if line else (-30.0, -30.0)), 1 if line else 0, course.lap(0, line))

    def make() -> tuple[str, str]:
        flight = fly(model, lap_start, backend)
        return page(flight), outcome(flight)

    return player.write(file, PAGE, "a lap is written as", make)


def outcome(flight: Flight) -> str:
    """Return duration, error and end of a lap as text."""
    end = "a lap that counts" if flight.lap else "the target was lost" if flight.lost else "no lap that counts"
    seconds = (len(flight.errors) - 1) * flight.model.scenario.step / 1000.0
    return f"{seconds:.1f} s, mean error {flight.errors[1:].mean():.2f} px, {end}"


def page(flight: Flight) -> str:
    """Return the page as HTML text."""
    model, world = flight.model, flight.model.scenario
    training = f"after {model.steps:,} steps of training (seed {model.seed})" if model.steps else "which does not learn"
    stride = player.evenly(len(flight.x), MOST)
    notes = [f"{model.controller}, {training}", "weights frozen, no dopamine", str(flight.start.path), outcome(flight)]
    notes += [f"network on {flight.backend}"] if flight.spikes and flight.backend != "event" else []
    notes += [f"one of every {stride} events is shown"] if stride > 1 else []
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
    lower_panels = [
        player.Panel(spikes, [_raster(flight, window), _actions(flight, window)], note),
        player.Panel("Error", [_errors(flight)], "of the whole lap, px; click to move the time", controls=True),
    ]
    if len(model.history.get("returns", ())):
        lower_panels.append(player.Panel("Training", [_training(model)], TRAINING))
    script = files("neuro_drone").joinpath("watch.js").read_text("utf-8")
    columns = "1fr 1fr 216px"
    title = f"{model.controller} in {world.name}"
    return player.page(
        "neuro drone watch", title, notes, timeline, _top(flight, stride), lower_panels, columns=columns, script=script
    )


def _top(flight: Flight, stride: int) -> list[player.Panel | list[player.Panel]]:
    """Return the panels of world, camera, fields and action. The camera shows one of every `stride` events."""
    world, names = flight.model.scenario, motors(flight.model.scenario)
    world_data = {
        "path": flight.path[:: max(1, len(flight.path) // POINTS)].ravel(), "poses": flight.poses.ravel(),
        "foot": flight.footprints.ravel(), "balls": flight.balls.ravel(), "heights": flight.heights,
        "winds": flight.winds.ravel(), "loads": flight.loads, "climbs": world.axes > 2, "step": world.step,
        "ball": world.task.radius if isinstance(world.task, Ball) else 0,
        "width": world.task.width if isinstance(world.task, Line) else 0,
    }  # fmt: skip
    ends = np.concatenate(([0], np.cumsum(flight.events)))
    pixels = 2 * (128 * flight.y.astype(int) + flight.x) + flight.p
    camera = {
        "width": 128, "height": 128, "place": pixels[::stride], "first": -(-ends // stride), "unit": 1, "span": 4,
        "fade": [1, 0.45, 0.25, 0.13], "targets": flight.targets.ravel(),
        "talls": np.nan_to_num(flight.talls, posinf=0.0),
    }  # fmt: skip
    shades = np.rint(255 * np.minimum(1.0, flight.counts / _busy(flight))).astype(np.uint8).ravel()
    fields = {"rows": 8, "columns": 8, "values": shades, "shade": ["faint", "accent", 1], "tiles": True}
    stick = {"actions": flight.actions.ravel(), "axes": world.axes, "motors": names}
    return [
        player.Panel(
            "World",
            [player.Track("world", "world", "drone, camera and target from above", world_data, square=True)],
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
    """Return the number of events from which a field has the full shade.

    The fullest field of a step has more events in a tenth of the steps only.
    """
    fullest = np.sort(flight.counts.max(axis=(1, 2)))
    return max(1, int(fullest[int(0.9 * len(fullest))]))


def _raster(flight: Flight, window: float) -> player.Track:
    """Return the raster of the spikes of all populations. A controller without spiking neurons has a raster of events.

    Args:
        flight: the record of a lap.
        window: visible time, in control steps.
    """
    world, names = flight.model.scenario, motors(flight.model.scenario)
    if not flight.spikes:
        counts = flight.counts.reshape(len(flight.counts), -1)
        steps, ids = counts.nonzero()
        level = np.rint(255 * np.minimum(1.0, 0.2 + 0.8 * counts[steps, ids] / _busy(flight))).astype(np.uint8)
        strip = {"name": "fields", "size": 64, "height": TALL, "times": steps, "ids": ids, "level": level, "each": 1}
        return player.Track(
            "raster", "raster", "events of the fields", {"strips": [strip], "window": window, "edge": EDGE}
        )
    strips, is_motor = list[dict[str, Any]](), [p.name == "motors" and p.size == len(names) for p in flight.spikes]
    # The motors have 0.4 of the height; the others share 0.6 by the square roots of their sizes.
    roots = [0.0 if motor else np.sqrt(part.size) for part, motor in zip(flight.spikes, is_motor, strict=True)]
    weights = np.array(
        [0.4 if motor else 0.6 * root / (sum(roots) or 1.0) for motor, root in zip(is_motor, roots, strict=True)]
    )
    for part, motor, share in zip(flight.spikes, is_motor, weights / weights.sum(), strict=True):
        sample = player.evenly(len(part.times), MOST)
        strip = {
            "name": part.name, "size": part.size, "height": share * (TALL + 8) - 8,
            "times": part.times[::sample] / world.step, "ids": part.ids[::sample],
        }  # fmt: skip
        strips.append(strip | ({"labels": names, "colours": COLOURS} if motor else {}))
    return player.Track("raster", "raster", "spikes", {"strips": strips, "window": window, "edge": EDGE})


def _actions(flight: Flight, window: float) -> player.Track:
    names = motors(flight.model.scenario)[::2]
    lines = [
        {"y": actions, "style": "steps", "colour": COLOURS[2 * axis], "width": 1.8, "name": names[axis]}
        for axis, actions in enumerate(flight.actions.T)
    ]
    lane = {"low": -1, "high": 1, "zero": True, "lines": lines}
    return player.Track("curve", "actions", "actions over time", {"lanes": [lane], "window": window, "edge": EDGE}, 76)


def _errors(flight: Flight) -> player.Track:
    line = {"y": flight.errors, "style": "area", "colour": "accent"}
    lane = {"low": 0, "high": max(10.0, flight.errors.max()), "marks": 3, "unit": " px", "lines": [line]}
    data = {"lanes": [lane], "edge": EDGE, "cursor": "ink", "click": True, "fades": True}
    return player.Track("curve", "lap", "error over the lap", data, 54)


def _training(model: Model) -> player.Track:
    """Return the plot of the error with frozen weights during the training, and of the mean reward per step."""
    history, curve = model.history, model.curve
    test_steps, frozen_px, lost = (np.asarray(curve.get(name, ()), float) for name in ("steps", "error_px", "lost"))
    rewards = {"x": history["steps"], "y": history["returns"] / history["lengths"], "style": "dots", "colour": "soft"}
    lines = [
        {"x": test_steps, "y": frozen_px, "style": "rings", "colour": "item4", "width": 1.8},
        {"x": test_steps[lost > 0], "y": frozen_px[lost > 0], "style": "crosses", "colour": "bad", "width": 1.8},
    ]
    lanes = [
        {"low": 0, "high": max(10.0, frozen_px.max(initial=0.0)), "marks": 3, "unit": " px", "lines": lines},
        {"low": 0, "high": 1, "marks": 2, "lines": [rewards]},
    ]
    data = {"lanes": lanes, "edge": EDGE, "end": model.steps, "axis": "steps"}
    return player.Track("curve", "training", "error and reward over the training", data, 160)
