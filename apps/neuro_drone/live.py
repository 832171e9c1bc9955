"""Flight in real time: the world in one process, the controller in another, events sent over the loopback."""

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
from neuro_drone.evaluate import Flights, FlightTest, Lap, Start, fly_lap, reset_arguments
from neuro_drone.geometry import CameraView
from neuro_drone.model import Model
from neuro_drone.scenario import Scenario
from neuro_events import Events, listen, send

if TYPE_CHECKING:
    from neuro_live import Page


Floats = npt.NDArray[np.float64]
FORMAT = "faery13"
# A "look" is the world's message at the end of a step: whether an episode begins, step, number of events sent so far.
_LOOK = struct.Struct("<?qq")
_ANSWER = struct.Struct("<q3d")  # message of the controller: step, action
_HOST = "127.0.0.1"
_MAX_WAIT = 0.25
"""Longest wait for the events of a step, as a share of the step. Events that arrive later are lost."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveTest:
    """The results of laps in real time.

    Attributes:
        test: the laps as the result of a test.
        latency: time from the arrival of a step's first events to the sending of its action.
        missed: steps without an action in time, in which the previous action continued.
        steps: control steps of all laps.
        lost: events that were sent and not received.
    """

    test: FlightTest
    latency: Histogram
    missed: int
    steps: int
    lost: int


@dataclass(slots=True)
class _Radio:
    """The world's end of the link: sends events, and at the end of a step uses the last action that has arrived.

    As in a test, an action holds for the whole step after its events. The world reads the action at the end of that
    step in real time, so it never waits for an action.

    Attributes:
        url: address for the events.
        socket: socket for looks and for actions.
        step_s: duration of a step, s.
        missed: steps without an action in time.
        steps: steps so far.
    """

    url: str
    socket: socket.socket
    step_s: float
    missed: int = 0
    steps: int = 0
    _n_events: int = 0
    _begins: bool = True
    _step_end: float = 0.0  # on the monotonic clock, s
    _t_us: int = 0  # added to the times of a lap's events
    _last_us: int = 0  # time of the last event sent
    _action: Floats = field(default_factory=lambda: np.zeros(3))

    def begin(self, copies: int, block: int) -> None:
        """Begin a lap; the camera's clock continues."""
        self._begins, self._action, self._t_us = True, np.zeros(3), self._last_us

    def act(self, observations: Floats, infos: Sequence[Mapping[str, Any]]) -> Floats:
        """Send the events of the last step, wait until the current step ends, and return the last action received."""
        events: Events = infos[0]["events"]
        if self._begins:
            self._step_end = time.monotonic()
        if len(events):
            shifted = Events(events.t + self._t_us, events.x, events.y, events.p, events.sensor_size)
            self._last_us = int(shifted.t[-1])
            send(self.url, shifted, format=FORMAT, speed=inf)
        self._n_events += len(events)
        self.steps += 1
        self.socket.send(_LOOK.pack(self._begins, self.steps, self._n_events))
        self._begins = False
        self._step_end = max(self._step_end + self.step_s, time.monotonic())
        time.sleep(max(0.0, self._step_end - time.monotonic()))
        number = 0
        while number < self.steps:
            try:
                number, *action = _ANSWER.unpack(self.socket.recv(_ANSWER.size, socket.MSG_DONTWAIT))
            except BlockingIOError:
                self.missed += 1
                break
            self._action = np.array(action)
        return self._action[None, : infos[0]["supervised_error"].size]


def _world(scenario: Scenario, starts: Sequence[Start], url: str, port: int, speed: float, report: Connection) -> None:
    """Fly laps in real time in a separate process, which ignores Ctrl-C and ends with its parent.

    Args:
        scenario: scenario of the laps.
        starts: starts of the laps.
        url: address for the events.
        port: port of the controller's socket for looks and actions.
        speed: factor on real time.
        report: end of a pipe for each `Lap`, then the missed and all steps, or an error as text.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
            radio.connect((_HOST, port))
            reset_calls = [reset_arguments(start, index) for index, start in enumerate(starts)]
            env = Flights(scenario, [reset_calls[0], *reset_calls])
            pilot: Any = _Radio(url, radio, scenario.step / 1000.0 / speed)
            loop = ClosedLoop(pilot, Environments(env), learns=False)
            env.reset()
            env.step(np.zeros(scenario.axes))  # compiles the kernels before the laps begin
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
        model: the trained model.
        starts: starts of the laps.
        scenario: scenario of the laps; default the scenario of the training.
        backend: backend of the controller's network.
        speed: factor on real time; 2 is twice as fast.
        report: called after each lap.
        page: function that opens a page of the controller's network. Its arguments are the simulation, and a function
            that returns the figures to show. The page is closed at the end.

    Raises:
        ModelError: a start is impossible, the backend refuses the network, a page is requested for a controller without
            a network, or the world's process fails.
    """
    world = scenario or model.scenario
    loop = model.loop(DroneEnv(world), backend=backend)
    if model.controller == "oracle":
        raise ModelError("controller 'oracle' needs the true error, which no camera sends: expected another controller")
    sim: Simulation | None = None if isinstance(loop.pilot, ControllerPilot) else loop.sim
    if page is not None and sim is None:
        raise ModelError(f"controller '{model.controller}' is no spiking network: expected one for a page")
    size = CameraView(fov=world.camera.fov, tilt=world.camera.tilt).size
    laps: list[Lap] = []
    looks = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with ExitStack() as stack:
        stream = stack.enter_context(listen(f"udp://{_HOST}:0", format=FORMAT, sensor=(size, size)))
        stack.enter_context(looks).bind((_HOST, 0))
        pilot = _Pilot(loop.pilot, stream, looks, size, _MAX_WAIT * world.step / 1000.0 / speed)
        open_page = None if page is None or sim is None else stack.enter_context(page(sim, pilot.figures))
        context = multiprocessing.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        arguments = (world, tuple(starts), stream.url, looks.getsockname()[1], speed, sender)
        process = context.Process(target=_world, args=arguments, daemon=True)
        process.start()
        sender.close()
        try:
            while True:
                pilot.answer()
                if open_page is not None:
                    open_page.tick()
                ended = not process.is_alive()
                while receiver.poll():
                    message = receiver.recv()
                    if isinstance(message, Lap):
                        laps.append(message)
                        if report is not None:
                            report(message)
                    elif isinstance(message, str):
                        raise ModelError(f"the world's process failed: {message}")
                    else:
                        missed, steps = message
                        return LiveTest(FlightTest(tuple(laps)), pilot.latency, missed, steps, pilot.lost)
                if ended:
                    raise ModelError("the world's process ended before its laps")
        finally:
            process.terminate()
            process.join()
            receiver.close()


class _Pilot:
    """The controller's end of the link: receives events and looks, and sends actions.

    Args:
        controller: pilot of the closed loop.
        stream: stream of the events.
        looks: socket for looks and actions.
        size: width and height of the picture, px.
        patience_s: longest wait for the events of a look, s.

    Attributes:
        latency: times from the arrival of events to the sending of the action.
        lost: events that were sent and not received.
    """

    def __init__(self, controller: Any, stream: Any, looks: socket.socket, size: int, patience_s: float) -> None:
        self._controller, self._stream, self._looks, self._patience_s = controller, stream, looks, patience_s
        self._shift = (size // CELLS).bit_length() - 1
        self._counts = np.zeros((CELLS, CELLS), dtype=np.int64)
        self.latency, self.lost, self._received = Histogram(), 0, 0
        looks.settimeout(0.1)
        controller.begin(1, 0)
        self._act()  # compiles the kernels before the laps begin

    def _act(self) -> Floats:
        counts = self._counts.astype(np.float64).reshape(1, -1)
        return np.asarray(self._controller.act(counts, ({"counts": self._counts},))[0])

    def figures(self) -> dict[str, str]:
        """Return the figures for a page."""
        times = ", ".join(self.latency.texts)
        return {"event to action: p50, p99, largest": f"{times} ms", "events lost": f"{self.lost:,}"}

    def answer(self) -> None:
        """Wait up to 0.1 s for a look, and answer it with an action."""
        try:
            message, world = self._looks.recvfrom(_LOOK.size)
        except TimeoutError:
            return
        first_ns = time.monotonic_ns()
        episode_begins, step, n_sent = _LOOK.unpack(message)
        self._counts[...] = 0
        deadline = time.monotonic() + self._patience_s
        while True:
            events = self._stream.take()
            first_ns = min(first_ns, self._stream.received_ns or first_ns)
            count(events.x, events.y, self._shift, self._counts)
            self._received += len(events)
            remaining_s = deadline - time.monotonic()
            if self._received >= n_sent or remaining_s <= 0:
                break
            self._stream.wait(remaining_s)
        self.lost, self._received = self.lost + max(0, n_sent - self._received), max(n_sent, self._received)
        if episode_begins:
            self._controller.begin(1, 0)
        message_action, action = np.zeros(3), self._act()
        message_action[: len(action)] = action
        self._looks.sendto(_ANSWER.pack(step, *message_action.tolist()), world)
        self.latency.add(time.monotonic_ns() - first_ns)
