"""A browser page of a simulation, which is served by a second process and updated between two pieces of the run."""

from __future__ import annotations

import math
import os
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from neuro import ModelError, Simulation
from neuro.apps import Clock, Quantity, check, needed
from neuro.extend import Floats
from neuro_live.beside import Beside
from neuro_live.channel import Channel
from neuro_live.commands import SPEED, Commands, Pace
from neuro_live.facts import about, shown_value
from neuro_live.frames import Frames, weights_of

FRAME_S = 1 / 40
"""Shortest interval between two frames, s."""
POLL_S = 5e-3
"""Interval between two checks for messages, s."""
SAMPLE_S = 1e-3
"""Shortest interval between two samples of the watched state, s."""
STRETCH_S, LONGEST_MS = 2e-3, 20.0
"""Duration of a piece of the run in s of real time, and its upper bound in ms of network time."""
WATCH_MS = 0.5
"""Interval between two samples of the watched state: a window of 1 s on 1,000 pixels shows each spike and its reset."""
KEPT_MS = 500.0
"""Time for which recordings are kept in memory, ms."""
BESIDE_S = 0.05
"""Interval between two checks for results of slow computations, s."""
SEEN_S = 1.0
"""Time for which a browser counts as watching after its last request for a frame, s."""
SLOW_S = 0.25
"""Shortest interval between two slow updates, s of the run."""
PRICE_S = 1.0
"""Interval between two requests for the energy of the run, s."""
SHARE, SAMPLE_SHARE, SLOW_SHARE = 0.025, 0.005, 0.005
"""Share of the time of the run that may be used for frames, for samples of the watched state, and for slow updates.
Updates that need more time become rarer."""
START_S = 20.0
"""Longest time for the start of the second process, s."""
REDIRECT = """<!doctype html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={url}">
<title>neuro</title>
<a href="{url}">The page of the network</a>
"""

PORT = Quantity(kind="integer", at_least=0, at_most=65535)
HOST = Quantity(kind="name")


class Page:
    """A browser page that shows and controls a simulation while it runs; needs the extra `live`.

    The code that runs the simulation calls `tick` between two pieces of the run. A second process serves the page. The
    simulation never waits for this process: frames that no browser fetches in time are dropped. Everyone who knows
    `url` can control the simulation but nothing else, because requests contain only numbers and names of parts, never
    code or paths.

    Args:
        sim: the simulation.
        host: name or address to listen at. Other machines can reach every address except 127.0.0.1.
        port: port to listen at; 0 for any free port.
        speed: multiple of real time to which `tick` slows the run; the page can then pause, step and change the speed.
            `math.inf` is as fast as possible. With None, `tick` never waits, and its caller controls the speed.
        restart: function that returns a new simulation with another seed, which replaces `sim`. Without it the page
            displays the seed but cannot change it.
        figures: function that returns further figures for the page, such as latencies, as texts by name.

    Attributes:
        sim: the simulation on the page.
        url: address for the browser, with a random token.

    Raises:
        ModelError: the port is not available, or the extra is not installed.
    """

    def __init__(
        self,
        sim: Simulation,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        speed: float | None = None,
        restart: Callable[[int], Simulation] | None = None,
        figures: Callable[[], Mapping[str, str]] | None = None,
    ) -> None:
        needed("websockets", "live", "a page is served by websockets, which is not installed")
        if not isinstance(sim, Simulation):
            raise ModelError(f"Page: found {sim!r}: expected a Simulation")
        for name, function in (("restart", restart), ("figures", figures)):
            if function is not None and not callable(function):
                raise ModelError(f"Page: {name} = {function!r:.60}: expected a function")
        host, port = check(HOST, host, "host"), check(PORT, port, "port")
        self.pace = None if speed is None else Pace(check(SPEED, speed, "speed"))
        self.restart, self._figures = restart, figures
        # Times of the clock, s: when an update is due, and until when a browser counts as watching.
        self._due = self._sample_due = self._price_due = self._beside_due = self._seen_until = 0.0
        # Times of the run, s (see `_run_time_s`): when an update is due.
        self._frame_due = self._slow_due = self._sample_run_due = 0.0
        self._waited = 0.0
        # `_ahead`: whether the last call of `tick` waited, because the run was ahead of its speed.
        self._frame_wanted = self._has_new_browser = self._ahead = self._stopped = False
        self._last_frame_s = 0.0
        self._measured = (time.perf_counter(), sim.time)
        self._speed = 0.0
        self._process, self._channel = _serve()
        self._files = ExitStack()
        try:
            token = secrets.token_urlsafe(24)
            port = self._begin({"host": host, "port": port, "token": token})
            self._show(sim)
        except BaseException:
            self.close()
            raise
        address = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
        self.url = f"http://{address}:{port}/{token}/"

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Page({self.sim!r}, {self.url!r})"

    def open(self) -> None:
        """Open the page in the user's browser.

        The browser opens a file that redirects to the page. Only this user can read the file, whereas every user of the
        machine can read the command lines of programs. The file is deleted when the page is closed.
        """
        import webbrowser

        folder = TemporaryDirectory(prefix="neuro-page-", ignore_cleanup_errors=True)
        file = Path(self._files.enter_context(folder)) / "page.html"
        file.touch(mode=0o600)
        file.write_text(REDIRECT.format(url=escape(self.url)), "utf-8")
        webbrowser.open(file.as_uri())

    def close(self) -> None:
        """Close the page and its processes, but not the simulation. A second call has no effect."""
        self._files.close()
        self._channel.close()
        helper: Beside | None = getattr(self, "helper", None)
        if helper is not None:
            helper.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def tick(self) -> None:
        """Execute the browsers' requests and send updates; with a speed, wait until the run is due to continue.

        A call takes 1 to 2 us without a browser. With browsers, all calls together take at most 4 % of the time.
        """
        now = time.perf_counter()
        if now >= self._due and self._channel.open:
            self._handle_requests(now)
        if now < self._seen_until:
            if now >= self._sample_due and (self._ahead or self._run_time_s() >= self._sample_run_due):
                self._sample(now)
            if self.frames.is_forgotten and not self.frames.went_back:
                self.frames.gather()
        if self.pace is None:
            return
        self._ahead = False
        while self._channel.open and not self._stopped and (wait := self.pace.wait_s(self.sim.time)) > 0.0:
            self._ahead = True
            wait_start = time.perf_counter()
            time.sleep(min(wait, POLL_S))
            now = time.perf_counter()
            self._waited += now - wait_start
            if now >= self._due:
                self._handle_requests(now)

    def run(self, ms: float = math.inf) -> None:
        """Run the simulation until a network time, and keep at most a second of the recordings.

        A numerical instability pauses the run and is reported on the page.

        Args:
            ms: end of the run, a multiple of the resolution; by default no end.

        Raises:
            ModelError: the page has no speed, the time is not a multiple of the resolution, or the process that serves
                the page has ended.
        """
        if self.pace is None:
            raise ModelError("Page.run: found no speed: expected Page(sim, speed=1.0)")
        clock = Clock(self.sim.program.resolution)
        end = clock.ms(clock.step(ms, "run"))
        self._stopped = False
        while self.sim.time < end and not self._stopped:
            self._advance(min(self._stretch_ms, end - self.sim.time), self.pace)
            self.tick()
            if not self._channel.open:
                raise ModelError("the process that serves the page has ended")

    def stop(self) -> None:
        """End `run` after its present piece; may be called from any thread."""
        self._stopped = True

    def _advance(self, ms: float, pace: Pace) -> None:
        previous = self.sim.time
        try:
            for number, part in enumerate(self._parts(ms)):
                if number:
                    self.frames.sample()  # `tick` samples at the end of the stretch
                self.sim.run(part)
        except ModelError as error:
            if self.sim.time == previous:
                raise
            pace.pause(True)
            self.keep("trouble", {"error": error.message})
            self.tell_state()
        if self.sim.time - self.sim.held > 2 * KEPT_MS:
            self.sim.forget(self.sim.time - KEPT_MS)

    def _parts(self, ms: float) -> Iterator[float]:
        """Yield the lengths of the parts of a piece of the run of `ms`.

        A part lasts `WATCH_MS` if a browser watches a state and the run is ahead of its speed: the state is sampled
        after each part. Otherwise the piece is one part.
        """
        clock = Clock(self.sim.program.resolution)
        steps = clock.step(ms, "run")
        is_watched = bool(self.frames.watched) and self._ahead and time.perf_counter() < self._seen_until
        part = max(1, int(WATCH_MS / clock.resolution)) if is_watched else steps
        for begin in range(0, steps, part):
            yield clock.ms(min(part, steps - begin))

    @property
    def _stretch_ms(self) -> float:
        """Length of a piece of the run in ms, short enough for smooth frames and a multiple of the resolution."""
        assert self.pace is not None
        resolution: float = self.sim.program.resolution
        return max(1, int(min(STRETCH_S * 1e3 * self.pace.speed, LONGEST_MS) / resolution)) * resolution

    # --- the process that serves the page

    def _begin(self, settings: dict[str, Any]) -> int:
        """Send the settings to the second process, wait until it listens, and return the port."""
        self._channel.send(settings)
        deadline = time.monotonic() + START_S
        while self._channel.open and time.monotonic() < deadline:
            for head in self._channel.receive():
                if "port" in head:
                    return int(head["port"])
                url = f"{settings['host']}:{settings['port']}"
                raise ModelError(f"the page cannot be served at {url}: {head['error']}", hint="another host or port")
            time.sleep(POLL_S)
        raise ModelError(f"the process that serves the page has ended, or has not begun within {START_S:g} s")

    def _show(self, sim: Simulation) -> None:
        """Make the page show another simulation."""
        self.sim = sim
        if (previous := getattr(self, "helper", None)) is not None:
            previous.close()
        self.frames, self.helper = Frames(sim), Beside(sim)
        self.commands = Commands(self)
        self._learning = [k for k, part in enumerate(sim.program.projections) if part.synapse.learns]
        self._unread = list(range(len(sim.program.projections)))
        self._next = 0
        program = sim.program
        first = next((part for part in program.populations if part.kind == "neuron" and sim.states(part.name)), None)
        if first is not None and first.size:
            self.frames.watch(first.name, 0, sim.states(first.name)[0])
        paced = {"paced": self.pace is not None, "seeds": self.restart is not None}
        self.keep("about", about(sim) | paced | {"traces": self.frames.traces}, fresh=True)
        self.tell_state()

    def show_again(self, seed: int) -> None:
        """Replace the simulation by one with another seed."""
        assert self.restart is not None
        self._show(self.restart(seed))
        self.begin()

    def begin(self) -> None:
        """Restart all displays after the simulation was reset or restored to another state."""
        self.frames.begin()
        self.helper.begin()
        if self.pace is not None:
            self.pace.begin()
        self._measured = (time.perf_counter(), self.sim.time)
        self.keep("begun", {"time": self.sim.time})
        self.keep("trouble", {"error": ""})
        self.look_again()

    def look_again(self, *projections: int) -> None:
        """Schedule new reads of the weights of some projections, or of all."""
        all_indices = range(len(self.sim.program.projections))
        self._unread += [k for k in projections or all_indices if k not in self._unread]

    def keep(self, key: str, content: dict[str, Any], fresh: bool = False) -> None:
        """Send a message to all present and future browsers, until another message with the key replaces it.

        Args:
            key: name of the message.
            content: fields of the message.
            fresh: whether to delete the messages of all keys first.
        """
        self._channel.send({"keep": key, "fresh": fresh, **content})

    def tell_value(self, part: str, word: str, values: Floats) -> None:
        """Send the present values of a parameter of a part."""
        self.keep(f"value/{part}/{word}", {"part": part, "word": word, **shown_value(values)})

    def tell_state(self) -> None:
        """Send the watched state, the silenced populations, the speed of the run, and whether the run is paused."""
        pace = self.pace
        state: dict[str, Any] = {"watched": self.frames.watched or None, "silenced": self.commands.silenced}
        if pace is not None:
            state |= {"paused": pace.paused, "speed": min(pace.speed, 1e9)}
        self.keep("state", state)

    # --- between two pieces of the run

    def _handle_requests(self, now: float) -> None:
        """Execute requests, and send a frame if a browser is waiting for one."""
        self._due = now + POLL_S
        if self.frames.went_back:
            self.begin()
        for head in self._channel.receive():
            if "want" in head:
                self._frame_wanted, self._seen_until = True, now + SEEN_S
                self._has_new_browser |= head["new"]
                if head["first"]:
                    self.frames.begin()
            else:
                reply, body = self.commands.answer(head["asked"])
                self._channel.send({"to": head["of"], **reply}, body)
        self._channel.flush()
        if now >= self._beside_due:
            self._beside_due = now + BESIDE_S
            for job, result in self.helper.results():
                self._show_result(job, result)
        if self._frame_wanted and self._channel.idle and (self._ahead or self._run_time_s() >= self._frame_due):
            if self.sim.time != self.frames.time or (self._has_new_browser and self._is_paused):
                self._send_frame(now)
            if self._run_time_s() >= self._slow_due:
                self._send_slow_updates(now)

    @property
    def _is_paused(self) -> bool:
        return self.pace is not None and self.pace.paused

    def _run_time_s(self) -> float:
        """Return the time of the run in s: CPU time and waits, or wall time if the page does not control the speed."""
        return time.perf_counter() if self.pace is None else time.thread_time() + self._waited

    def _sample(self, now: float) -> None:
        start, used = time.thread_time(), self._run_time_s()
        self.frames.sample()
        self._sample_due = now + SAMPLE_S
        self._sample_run_due = used + (time.thread_time() - start) / SAMPLE_SHARE

    def _send_frame(self, now: float) -> None:
        start, used = time.thread_time(), self._run_time_s()
        head, body = self.frames.take()
        last_s, last_ms = self._measured
        if now - last_s > 0.5:
            self._speed = (head["time"] - last_ms) * 1e-3 / (now - last_s)
            self._measured = now, head["time"]
        self._channel.send(head | {"speed": round(self._speed, 4)}, body)
        self._frame_wanted, self._has_new_browser, self._seen_until = False, False, now + SEEN_S
        previous_s, self._last_frame_s = self._last_frame_s, time.thread_time() - start
        self._due = now + FRAME_S
        self._frame_due = used + 0.5 * (previous_s + self._last_frame_s) / SHARE

    def _send_slow_updates(self, now: float) -> None:
        """Send the slow updates, a few times a second: the weights of one projection, the energy, the figures."""
        start, used = time.thread_time(), self._run_time_s()
        if self._unread or self._learning:
            if self._unread:
                index = self._unread.pop(0)
            else:
                self._next += 1
                index = self._learning[self._next % len(self._learning)]
            weights, name = weights_of(self.sim, index), self.sim.program.projections[index].name
            self.keep(f"weights/{name}", weights)
            if "mean" in weights:
                equal = weights["low"] == weights["high"]
                self.keep(
                    f"value/{name}/weight", {"part": name, "word": "weight", "value": weights["mean"], "same": equal}
                )
        if now >= self._price_due:
            self._price_due = now + PRICE_S
            self.helper.price()
            if self.helper.refused:
                self.keep("joules", {"refused": self.helper.refused})
        if self._figures is not None:
            self.keep("figures", {"figures": dict(self._figures())})
        self._slow_due = used + max(SLOW_S, (time.thread_time() - start) / SLOW_SHARE)

    def _show_result(self, job: dict[str, Any], result: Any) -> None:
        """Send the result of a slow computation. A result of type str is the message of an error."""
        if job["do"] == "price":
            if isinstance(result, str):
                self.helper.refused = result
            else:
                self.keep("joules", {"chips": result})
        else:
            neuron = {"population": job["population"], "neuron": job["neuron"]}
            self.keep("curve", neuron | ({"refused": result} if isinstance(result, str) else result))


def _serve() -> tuple[subprocess.Popen[bytes], Channel]:
    """Start the process that serves the page; return the process and the channel to it."""
    own_end, other_end = socket.socketpair()
    paths = [os.path.abspath(path) for path in sys.path]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "neuro_live.serving", str(other_end.fileno())],
        stdin=subprocess.DEVNULL,
        pass_fds=[other_end.fileno()],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )
    other_end.close()
    return process, Channel(own_end)
