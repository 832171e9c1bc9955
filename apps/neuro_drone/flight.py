"""A lap with all that was seen, thought and done, for the page that shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro_drone.controllers import Controller
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, begin
from neuro_drone.geometry import CameraView
from neuro_drone.model import Model, packed, unpacked

__all__ = ["Flight", "FlightSpikes", "fly", "listening"]

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
        told = {"targets": info["target"], "errors": info["error_px"], "actions": action, "counts": info["counts"]}
        for name, value in (_where(env) | told).items():
            kept.setdefault(name, []).append(value)
        seen.append(info["events"])
        if over:
            break
        action = np.array(pilot.act(info["counts"], info))
        _, _, lost, end, info = env.step(action)
        over = lost or end
    env.close()
    rows = {name: np.array(values) for name, values in kept.items() if name != "balls"}
    balls = np.array([ball for ball in kept["balls"] if ball is not None]).reshape(-1, 2)
    columns = {name: np.concatenate([getattr(part, name) for part in seen]) for name in "xyp"}
    each = np.array([len(part) for part in seen])
    way, spikes, lap = env.task.path.points, _spikes(pilot), bool(info["lap"])
    return Flight(
        model,
        start,
        way,
        balls=balls,
        events=each,
        spikes=spikes,
        lap=lap,
        lost=bool(info["lost"]),
        backend=backend,
        **rows,
        **columns,
    )


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


def _spikes(pilot: Controller) -> tuple[FlightSpikes, ...]:
    sim = getattr(pilot, "sim", None)
    if sim is None:
        return ()
    return tuple(FlightSpikes(p.name, p.size, *sim.spikes(p.name)) for p in sim.program.populations if p.records)
