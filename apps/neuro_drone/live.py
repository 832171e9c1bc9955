"""A drone that flies in real time: the world in one process, the controller in another, events over the loopback."""

from __future__ import annotations

import multiprocessing
import signal
import socket
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from math import inf
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro import ClosedLoop, ModelError, Simulation
from neuro.apps import Environments
from neuro.realtime import Histogram
from neuro_drone.controllers.pilot import ControllerPilot
from neuro_drone.env import CELLS, DroneEnv, count
from neuro_drone.evaluate import Flights, FlightTest, Lap, Start, begun, fly_lap
from neuro_drone.geometry import CameraView
from neuro_drone.model import Model
from neuro_drone.scenario import Scenario
from neuro_events import Events, listen, send

if TYPE_CHECKING:
    from neuro_live import Page


Floats = npt.NDArray[np.float64]
FORMAT = "faery13"
_LOOK = struct.Struct("<?qq")  # whether an episode begins, number of the step, events that were sent so far
_ANSWER = struct.Struct("<q3d")  # number of the step, action
_HOST = "127.0.0.1"
_LOST = 0.25
"""Share of a step for which events that were sent are waited for."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveTest:
    """What came of laps that were flown in real time.

    Attributes:
        tried: the laps, as of a test.
        latency: from the receipt of a step's first events to the sending of its action.
        missed: steps at whose end no action had come, so that the one before went on.
        steps: of all laps.
        lost: events that were sent and not received.
    """

    tried: FlightTest
    latency: Histogram
    missed: int
    steps: int
    lost: int


@dataclass(slots=True)
class _Radio:
    """The controller as the world has it: events go out, and at the end of a step the action is what has come by then.

    As in a test, an action holds for the whole step after its look. It is asked for at the end of that step, so a step
    stands still for no answer.
    """

    url: str
    socket: socket.socket
    step_s: float
    missed: int = 0
    steps: int = 0
    _sent: int = 0
    _begins: bool = True
    _due: float = 0.0
    _t_us: int = 0
    _last_us: int = 0
    _action: Floats = field(default_factory=lambda: np.zeros(3))

    def begin(self, copies: int, block: int) -> None:
        """A lap begins; the camera's clock goes on."""
        self._begins, self._action, self._t_us = True, np.zeros(3), self._last_us

    def act(self, observations: Floats, infos: Sequence[Mapping[str, Any]]) -> Floats:
        """Send the events of the last step, wait until this one is over, and take the action that has come."""
        events: Events = infos[0]["events"]
        if self._begins:
            self._due = time.monotonic()
        if len(events):
            shifted = Events(events.t + self._t_us, events.x, events.y, events.p, events.sensor_size)
            self._last_us = int(shifted.t[-1])
            send(self.url, shifted, format=FORMAT, speed=inf)
        self._sent += len(events)
        self.steps += 1
        self.socket.send(_LOOK.pack(self._begins, self.steps, self._sent))
        self._begins = False
        self._due = max(self._due + self.step_s, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))
        number = 0
        while number < self.steps:
            try:
                number, *action = _ANSWER.unpack(self.socket.recv(_ANSWER.size, socket.MSG_DONTWAIT))
            except BlockingIOError:
                self.missed += 1
                break
            self._action = np.array(action)
        return self._action[None, : infos[0]["supervised_error"].size]


def _world(
    scenario: Scenario, starts: Sequence[Start], url: str, answers: int, speed: float, report: Connection
) -> None:
    """Fly laps in real time, in a process of its own, which leaves Ctrl-C to its parent and ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
            radio.connect((_HOST, answers))
            begins = [begun(start, index) for index, start in enumerate(starts)]
            env = Flights(scenario, [begins[0], *begins])
            pilot: Any = _Radio(url, radio, scenario.step / 1000.0 / speed)
            loop = ClosedLoop(pilot, Environments(env), learns=False)
            env.reset()
            env.step(np.zeros(scenario.axes))  # all that a step needs is in memory when the laps begin
            for start in starts:
                report.send(fly_lap(loop, env, start))
            report.send((pilot.missed, pilot.steps))
    except Exception as error:
        with suppress(OSError):
            report.send(f"{type(error).__name__}: {error}")


def fly_live(
    model: Model,
    starts: Sequence[Start],
    *,
    scenario: Scenario | None = None,
    backend: str = "event",
    speed: float = 1.0,
    report: Callable[[Lap], None] | None = None,
    page: Callable[[Simulation, Callable[[], dict[str, str]]], Page] | None = None,
) -> LiveTest:
    """Fly one lap from each start in real time, with frozen weights.

    Args:
        model: what was learnt.
        starts: of the laps.
        scenario: another one than that of the training.
        backend: what runs the controller's network.
        speed: how many times as fast as in real time.
        report: called after each lap.
        page: makes a page on the controller's network, which has figures to show; it is closed at the end.

    Raises:
        ModelError: a start cannot be, the backend refuses the network, the controller is none and cannot be shown, or
            the world's process fails.
    """
    world = scenario or model.scenario
    loop = model.loop(DroneEnv(world), backend=backend)
    if model.controller == "oracle":
        raise ModelError("controller 'oracle' sees the true error, which no camera sends: expected another one")
    sim: Simulation | None = None if isinstance(loop.pilot, ControllerPilot) else loop.sim
    if page is not None and sim is None:
        raise ModelError("the controller is no network: expected a spiking one, which a page shows")
    size = CameraView(fov=world.camera.fov, tilt=world.camera.tilt).size
    laps: list[Lap] = []
    looks = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with ExitStack() as stack:
        stream = stack.enter_context(listen(f"udp://{_HOST}:0", format=FORMAT, sensor=(size, size)))
        stack.enter_context(looks).bind((_HOST, 0))
        pilot = _Pilot(loop.pilot, stream, looks, size, _LOST * world.step / 1000.0 / speed)
        shown = None if page is None or sim is None else stack.enter_context(page(sim, pilot.figures))
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe(duplex=False)
        words = (world, tuple(starts), stream.url, looks.getsockname()[1], speed, theirs)
        process = context.Process(target=_world, args=words, daemon=True)
        process.start()
        theirs.close()
        try:
            while True:
                pilot.answer()
                if shown is not None:
                    shown.tick()
                ended = not process.is_alive()
                while ours.poll():
                    told = ours.recv()
                    if isinstance(told, Lap):
                        laps.append(told)
                        if report is not None:
                            report(told)
                    elif isinstance(told, str):
                        raise ModelError(f"the world's process failed: {told}")
                    else:
                        missed, steps = told
                        return LiveTest(FlightTest(tuple(laps)), pilot.latency, missed, steps, pilot.lost)
                if ended:
                    raise ModelError("the world's process ended before its laps")
        finally:
            process.terminate()
            process.join()
            ours.close()


class _Pilot:
    """The controller's end: looks come, actions go."""

    def __init__(self, controller: Any, stream: Any, looks: socket.socket, size: int, patience_s: float) -> None:
        self._controller, self._stream, self._looks, self._patience_s = controller, stream, looks, patience_s
        self._shift = (size // CELLS).bit_length() - 1
        self._counts = np.zeros((CELLS, CELLS), dtype=np.int64)
        self.latency, self.lost, self._taken = Histogram(), 0, 0
        looks.settimeout(0.1)
        controller.begin(1, 0)
        self._act()  # all that an action needs is in memory when the laps begin

    def _act(self) -> Floats:
        counts = self._counts.astype(np.float64).reshape(1, -1)
        return np.asarray(self._controller.act(counts, ({"counts": self._counts},))[0])

    def figures(self) -> dict[str, str]:
        """What a page shows of it."""
        times = ", ".join(self.latency.texts)
        return {"event to action: p50, p99, largest": f"{times} ms", "events lost": f"{self.lost:,}"}

    def answer(self) -> None:
        """Wait a little for a look, and answer it."""
        try:
            message, world = self._looks.recvfrom(_LOOK.size)
        except TimeoutError:
            return
        began = time.monotonic_ns()
        begins, number, sent = _LOOK.unpack(message)
        self._counts[...] = 0
        deadline = time.monotonic() + self._patience_s
        while True:
            events = self._stream.take()
            began = min(began, self._stream.received_ns or began)
            count(events.x, events.y, self._shift, self._counts)
            self._taken += len(events)
            left = deadline - time.monotonic()
            if self._taken >= sent or left <= 0:
                break
            self._stream.wait(left)
        self.lost, self._taken = self.lost + max(0, sent - self._taken), max(sent, self._taken)
        if begins:
            self._controller.begin(1, 0)
        action, found = np.zeros(3), self._act()
        action[: len(found)] = found
        self._looks.sendto(_ANSWER.pack(number, *action.tolist()), world)
        self.latency.add(time.monotonic_ns() - began)
