"""A page on a simulation: it is served by a process of its own, and looked after between two stretches of the run."""

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
POLL_S = 5e-3
"""How often messages are looked for."""
SAMPLE_S = 1e-3
STRETCH_S, LONGEST_MS = 2e-3, 20.0
WATCH_MS = 0.5
"""Time between two samples of the watched state: a window of 1 s on 1,000 pixels shows each spike and its reset."""
KEPT_MS = 500.0
BESIDE_S = 0.05
SEEN_S = 1.0
"""So long after a frame somebody is taken to look."""
SLOW_S = 0.25
PRICE_S = 1.0
SHARE, SAMPLE_SHARE, SLOW_SHARE = 0.025, 0.005, 0.005
"""Of the time that the run takes and waits: what frames may take, the state that is watched, and all that is made
seldom. Where they take more, they come less often."""
START_S = 20.0
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
    """A page in a browser that shows a simulation while it runs, and steers it; needs the extra `live`.

    Whoever runs the simulation calls `tick` between two stretches. The page is served by a process of its own, which
    the simulation never waits for: frames that are not fetched in time are dropped. Who knows `url` can steer the
    simulation, and nothing else: the page passes numbers and names of parts, no code and no path.

    Args:
        sim: the simulation.
        host: the name or address to listen at; others than 127.0.0.1 can be reached from other machines.
        port: 0 for any that is free.
        speed: times real time that `tick` keeps, waiting where the run is ahead; then the page can pause, step and
            change the speed. `math.inf`: as fast as it can. None: `tick` never waits, whoever calls it keeps time.
        restart: makes the simulation anew with another seed, from which on `sim` is that; without it the page shows the
            seed only.
        figures: gives figures that the page shows beside its own, such as latencies, as texts by name.

    Attributes:
        sim: the simulation that is shown.
        url: the address for the browser, with a random token.

    Raises:
        ModelError: the port cannot be listened at, or the extra is not installed.
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
        for word, call in (("restart", restart), ("figures", figures)):
            if call is not None and not callable(call):
                raise ModelError(f"Page: {word} = {call!r:.60}: expected a function")
        host, port = check(HOST, host, "host"), check(PORT, port, "port")
        self.pace = None if speed is None else Pace(check(SPEED, speed, "speed"))
        self.restart, self._figures = restart, figures
        self._waited = self._frame_due = self._sample_used = self._beside_due = 0.0
        self._due = self._slow_due = self._sample_due = self._price_due = self._seen_until = 0.0
        self._wanted = self._unseen = self._ahead = self._stopped = False
        self._taken = 0.0
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
        at = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
        self.url = f"http://{at}:{port}/{token}/"

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Page({self.sim!r}, {self.url!r})"

    def open(self) -> None:
        """Open the page in the browser of this user.

        The browser is given a file that leads to the page. Only this user can read the file, while every user of the
        machine can read the words that a program is started with. The file is removed when the page is closed.
        """
        import webbrowser

        folder = TemporaryDirectory(prefix="neuro-page-", ignore_cleanup_errors=True)
        file = Path(self._files.enter_context(folder)) / "page.html"
        file.touch(mode=0o600)
        file.write_text(REDIRECT.format(url=escape(self.url)), "utf-8")
        webbrowser.open(file.as_uri())

    def close(self) -> None:
        """End the page and its processes; the simulation stays. A second call does nothing."""
        self._files.close()
        self._channel.close()
        beside: Beside | None = getattr(self, "beside", None)
        if beside is not None:
            beside.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def tick(self) -> None:
        """Do what the browsers ask for, and show them what is new; with a speed, wait until the run may go on.

        Without a browser this takes a microsecond or two, with some at most 4 % of the time.
        """
        now = time.perf_counter()
        if now >= self._due and self._channel.open:
            self._attend(now)
        if now < self._seen_until:
            if now >= self._sample_due and (self._ahead or self._used() >= self._sample_used):
                self._sample(now)
            if self.frames.is_forgotten and not self.frames.went_back:
                self.frames.gather()
        if self.pace is None:
            return
        self._ahead = False
        while self._channel.open and not self._stopped and (wait := self.pace.wait_s(self.sim.time)) > 0.0:
            self._ahead = True
            began = time.perf_counter()
            time.sleep(min(wait, POLL_S))
            now = time.perf_counter()
            self._waited += now - began
            if now >= self._due:
                self._attend(now)

    def run(self, ms: float = math.inf) -> None:
        """Run the simulation until a time of the network, and keep no more than a second of what is recorded.

        A numerical instability pauses the run, and the page says so.

        Args:
            ms: the time, a multiple of the resolution; for ever if not given.

        Raises:
            ModelError: the page has no speed, the time is no such multiple, or the process that serves the page has
                ended.
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
        """Let `run` end after the present stretch, from any thread."""
        self._stopped = True

    def _advance(self, ms: float, pace: Pace) -> None:
        before = self.sim.time
        try:
            for number, part in enumerate(self._parts(ms)):
                if number:
                    self.frames.sample()  # `tick` samples at the end of the stretch
                self.sim.run(part)
        except ModelError as error:
            if self.sim.time == before:
                raise
            pace.pause(True)
            self.keep("trouble", {"error": error.message})
            self.tell_state()
        if self.sim.time - self.sim.held > 2 * KEPT_MS:
            self.sim.forget(self.sim.time - KEPT_MS)

    def _parts(self, ms: float) -> Iterator[float]:
        """Divide a stretch of the run, ms; a watched state is sampled every `WATCH_MS` where there is time to wait."""
        clock = Clock(self.sim.program.resolution)
        steps = clock.step(ms, "run")
        is_watched = bool(self.frames.watched) and self._ahead and time.perf_counter() < self._seen_until
        part = max(1, int(WATCH_MS / clock.resolution)) if is_watched else steps
        for begin in range(0, steps, part):
            yield clock.ms(min(part, steps - begin))

    @property
    def _stretch_ms(self) -> float:
        """How long a stretch is: short enough for frames to be smooth, and a multiple of the resolution."""
        assert self.pace is not None
        resolution: float = self.sim.program.resolution
        return max(1, int(min(STRETCH_S * 1e3 * self.pace.speed, LONGEST_MS) / resolution)) * resolution

    # --- the process that serves it

    def _begin(self, settings: dict[str, Any]) -> int:
        """Tell the process what to serve, and wait until it does; the port."""
        self._channel.send(settings)
        until = time.monotonic() + START_S
        while self._channel.open and time.monotonic() < until:
            for head in self._channel.receive():
                if "port" in head:
                    return int(head["port"])
                where = f"{settings['host']}:{settings['port']}"
                raise ModelError(f"the page cannot be served at {where}: {head['error']}", hint="another host or port")
            time.sleep(POLL_S)
        raise ModelError(f"the process that serves the page has ended, or has not begun within {START_S:g} s")

    def _show(self, sim: Simulation) -> None:
        """Show a simulation from its beginning."""
        self.sim = sim
        if (former := getattr(self, "beside", None)) is not None:
            former.close()
        self.frames, self.beside = Frames(sim), Beside(sim)
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
        """Begin anew with another seed."""
        assert self.restart is not None
        self._show(self.restart(seed))
        self.begin()

    def begin(self) -> None:
        """The simulation is at another time or in another state: what is shown begins anew."""
        self.frames.begin()
        self.beside.begin()
        if self.pace is not None:
            self.pace.begin()
        self._measured = (time.perf_counter(), self.sim.time)
        self.keep("begun", {"time": self.sim.time})
        self.keep("trouble", {"error": ""})
        self.look_again()

    def look_again(self, *projections: int) -> None:
        """Read the weights of projections, or of all, anew."""
        every = range(len(self.sim.program.projections))
        self._unread += [k for k in projections or every if k not in self._unread]

    def keep(self, key: str, what: dict[str, Any], fresh: bool = False) -> None:
        """Tell all browsers, also those to come, until another message of that key; `fresh`: forget all others."""
        self._channel.send({"keep": key, "fresh": fresh, **what})

    def tell_value(self, part: str, word: str, values: Floats) -> None:
        """Tell what a parameter of a part is now."""
        self.keep(f"value/{part}/{word}", {"part": part, "word": word, **shown_value(values)})

    def tell_state(self) -> None:
        """Tell what the page can change of the run."""
        pace = self.pace
        state: dict[str, Any] = {"watched": self.frames.watched or None, "silenced": self.commands.silenced}
        if pace is not None:
            state |= {"paused": pace.paused, "speed": min(pace.speed, 1e9)}
        self.keep("state", state)

    # --- between two stretches

    def _attend(self, now: float) -> None:
        """Do what is asked for, and send a frame if one is wanted."""
        self._due = now + POLL_S
        if self.frames.went_back:
            self.begin()
        for head in self._channel.receive():
            if "want" in head:
                self._wanted, self._seen_until = True, now + SEEN_S
                self._unseen |= head["new"]
                if head["first"]:
                    self.frames.begin()
            else:
                reply, body = self.commands.answer(head["asked"])
                self._channel.send({"to": head["of"], **reply}, body)
        self._channel.flush()
        if now >= self._beside_due:
            self._beside_due = now + BESIDE_S
            for job, found in self.beside.found():
                self._found(job, found)
        if self._wanted and self._channel.idle and (self._ahead or self._used() >= self._frame_due):
            if self.sim.time != self.frames.time or (self._unseen and self._is_paused):
                self._send_frame(now)
            if self._used() >= self._slow_due:
                self._seldom(now)

    @property
    def _is_paused(self) -> bool:
        return self.pace is not None and self.pace.paused

    def _used(self) -> float:
        """Seconds that the run took and waited; of one that others pace, those on the wall."""
        return time.perf_counter() if self.pace is None else time.thread_time() + self._waited

    def _sample(self, now: float) -> None:
        began, used = time.thread_time(), self._used()
        self.frames.sample()
        self._sample_due = now + SAMPLE_S
        self._sample_used = used + (time.thread_time() - began) / SAMPLE_SHARE

    def _send_frame(self, now: float) -> None:
        began, used = time.thread_time(), self._used()
        head, body = self.frames.take()
        since, ms = self._measured
        if now - since > 0.5:
            self._speed = (head["time"] - ms) * 1e-3 / (now - since)
            self._measured = now, head["time"]
        self._channel.send(head | {"speed": round(self._speed, 4)}, body)
        self._wanted, self._unseen, self._seen_until = False, False, now + SEEN_S
        before, self._taken = self._taken, time.thread_time() - began
        self._due = now + FRAME_S
        self._frame_due = used + 0.5 * (before + self._taken) / SHARE

    def _seldom(self, now: float) -> None:
        """What is made a few times a second: the weights of one projection, joules, figures."""
        began, used = time.thread_time(), self._used()
        if self._unread or self._learning:
            if self._unread:
                index = self._unread.pop(0)
            else:
                self._next += 1
                index = self._learning[self._next % len(self._learning)]
            weights, name = weights_of(self.sim, index), self.sim.program.projections[index].name
            self.keep(f"weights/{name}", weights)
            if "mean" in weights:
                same = weights["low"] == weights["high"]
                self.keep(
                    f"value/{name}/weight", {"part": name, "word": "weight", "value": weights["mean"], "same": same}
                )
        if now >= self._price_due:
            self._price_due = now + PRICE_S
            self.beside.price()
            if self.beside.refused:
                self.keep("joules", {"refused": self.beside.refused})
        if self._figures is not None:
            self.keep("figures", {"figures": dict(self._figures())})
        self._slow_due = used + max(SLOW_S, (time.thread_time() - began) / SLOW_SHARE)

    def _found(self, job: dict[str, Any], found: Any) -> None:
        """Show what the process beside has computed."""
        if job["do"] == "price":
            if isinstance(found, str):
                self.beside.refused = found
            else:
                self.keep("joules", {"chips": found})
        else:
            of = {"population": job["population"], "neuron": job["neuron"]}
            self.keep("curve", of | ({"refused": found} if isinstance(found, str) else found))


def _serve() -> tuple[subprocess.Popen[bytes], Channel]:
    """The process that serves the page, and the way to it."""
    mine, its = socket.socketpair()
    paths = [os.path.abspath(path) for path in sys.path]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "neuro_live.serving", str(its.fileno())],
        stdin=subprocess.DEVNULL,
        pass_fds=[its.fileno()],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )
    its.close()
    return process, Channel(mine)
