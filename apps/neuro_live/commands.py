"""Requests of browsers, and the speed of the run.

A request contains only numbers and names of parts, all of which are checked, and neither code nor paths.
"""

from __future__ import annotations

import io
import math
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from neuro import ModelError, Simulation
from neuro.apps import Quantity, check, driver, outgoing, unknown
from neuro.extend import Floats
from neuro_live.beside import Beside
from neuro_live.facts import is_signal, present, settable_words, sliders
from neuro_live.frames import Frames

LATE_S = 0.2
"""Delay in s above which a run does not catch up but continues from the present time."""
SPEED = Quantity(doc="times real time", above=0.0, infinite=True)


class Pace:
    """Computes the waiting times of a run at a given speed.

    Args:
        speed: multiple of real time; infinite for as fast as possible.

    Attributes:
        paused: whether the run waits for `pause(False)` or `step`.
    """

    def __init__(self, speed: float) -> None:
        self.speed, self.paused = speed, False
        self._steps = 0
        self._clock_start: tuple[float, float] | None = None

    def set(self, speed: float) -> None:
        """Change the speed."""
        self.speed, self._clock_start = speed, None

    def pause(self, paused: bool) -> None:
        """Pause or resume the run."""
        self.paused, self._steps, self._clock_start = paused, 0, None

    def step(self) -> None:
        """Pause after one more piece of the run."""
        if not self.paused:
            self.pause(True)
        self._steps += 1

    def begin(self) -> None:
        """Restart the clock after the network's time was changed."""
        self._clock_start = None

    def wait_s(self, ms: float) -> float:
        """Return the longest wait in s before the network may run on from time `ms`; 0 or less for no wait."""
        if self.paused:
            if not self._steps:
                return math.inf
            self._steps -= 1
            return 0.0
        now = time.perf_counter()
        if self._clock_start is None or math.isinf(self.speed):
            self._clock_start = now, ms
        wait = self._clock_start[0] + (ms - self._clock_start[1]) * 1e-3 / self.speed - now
        if wait < -LATE_S:
            self._clock_start = now, ms
        return wait


Request = dict[str, Any]
Answer = tuple[dict[str, Any], bytes]

LARGEST_FILE = 256 << 20
"""Largest state that a browser may download, bytes."""
MOST_OWED_S, PAID = 1.0, 0.2
"""Limit of the time used by requests: a budget of 1 s, which refills by 0.2 s per second."""
_NAME = Quantity(kind="name")
_NUMBER = Quantity()
_NEURON = Quantity(kind="integer", at_least=0)
_SEED = Quantity(kind="integer", at_least=0)
_FLAG = Quantity(kind="boolean")


class Steered(Protocol):
    """The methods and attributes of a page that requests use."""

    sim: Simulation
    pace: Pace | None
    restart: Callable[[int], Simulation] | None
    frames: Frames
    helper: Beside

    def begin(self) -> None:
        """Restart all displays."""

    def show_again(self, seed: int) -> None:
        """Replace the simulation by one with another seed."""

    def look_again(self, *projections: int) -> None:
        """Schedule new reads of weights."""

    def keep(self, key: str, content: dict[str, Any]) -> None:
        """Send a message to all browsers."""

    def tell_value(self, part: str, word: str, values: Floats) -> None:
        """Send the values of a parameter."""

    def tell_state(self) -> None:
        """Send the state of the run."""


class Commands:
    """Executes the requests of browsers between two pieces of a run.

    Args:
        page: the page of the simulation.
    """

    def __init__(self, page: Steered) -> None:
        self._page, self._sim = page, page.sim
        self._used_s, self._refilled_at = 0.0, time.monotonic()
        self._saved_weights: dict[str, dict[int, Floats]] = {}
        paced = ("pause", "resume", "step", "speed", "reset") if page.pace is not None else ()
        seeds = ("seed",) if page.restart is not None else ()
        names = (
            *paced,
            *seeds,
            "sliders",
            "set",
            "silence",
            "restore",
            "activate",
            "watch",
            "curve",
            "save",
            "network",
        )
        self._known: dict[str, Callable[[Request], Answer | None]] = {name: getattr(self, f"_{name}") for name in names}

    @property
    def silenced(self) -> list[str]:
        """Names of the silenced populations."""
        return list(self._saved_weights)

    def answer(self, request: Request) -> Answer:
        """Execute a request; return the reply, and the content of a file or b""."""
        number, start = request.get("id", 0), time.monotonic()
        self._used_s = max(0.0, self._used_s - (start - self._refilled_at) * PAID)
        try:
            name = check(_NAME, request.get("do"), "do")
            if name not in self._known:
                raise unknown("command", name, self._known)
            if self._used_s > MOST_OWED_S:
                raise ModelError("too many requests, which slow down the simulation: try again later")
            head, body = self._known[name](request) or ({}, b"")
            return {"id": number, **head}, body
        except ModelError as error:
            hint = f" ({error.hint})" if error.hint else ""
            return {"id": number, "error": f"{error.message}{hint}"}, b""
        finally:
            self._refilled_at = time.monotonic()
            self._used_s = min(2.0 * MOST_OWED_S, self._used_s + self._refilled_at - start)

    # the run

    def _pause(self, request: Request) -> None:
        self._set_paused(True)

    def _resume(self, request: Request) -> None:
        self._set_paused(False)

    def _set_paused(self, paused: bool) -> None:
        assert self._page.pace is not None
        self._page.pace.pause(paused)
        self._page.tell_state()

    def _step(self, request: Request) -> None:
        assert self._page.pace is not None
        self._page.pace.step()
        self._page.tell_state()

    def _speed(self, request: Request) -> None:
        assert self._page.pace is not None
        speed = check(SPEED, request.get("value"), "speed")
        self._page.pace.set(float("inf") if speed >= 1e9 else speed)
        self._page.tell_state()

    def _reset(self, request: Request) -> None:
        weights = check(_FLAG, request.get("weights", False), "weights")
        self._sim.reset(weights=weights)
        if weights:
            self._saved_weights.clear()
        self._page.begin()
        self._page.tell_state()

    def _seed(self, request: Request) -> None:
        self._page.show_again(check(_SEED, request.get("value"), "seed"))

    # the parts of the network

    def _sliders(self, request: Request) -> Answer:
        return {"sliders": sliders(self._sim, self._part(request))}, b""

    def _set(self, request: Request) -> None:
        """Set a parameter of a part, the weight of a projection, or a signal."""
        part, word, sim = self._part(request), self._text(request, "word"), self._sim
        value = request.get("value")
        if not isinstance(value, bool):
            value = check(_NUMBER, value, f"{part}.{word}")
        names = settable_words(sim, part)
        if word not in names:
            raise unknown("parameter", word, names).at(None, f"'{part}'")
        if is_signal(sim, part):
            sim.signal(part, value)
            self._page.tell_value(part, word, np.array([value]))
            return
        sim.set(part, {word: value})
        self._page.tell_value(part, word, present(sim, part, word))
        if word == "weight":
            self._page.look_again(sim.handles.projection(part))

    def _silence(self, request: Request) -> None:
        part = self._population(request)
        if part in self._saved_weights:
            return
        indices = outgoing(self._sim.program, self._sim.handles.neurons(part))
        weights = {index: self._sim._engine.get_synapses(index, "weight") for index in indices}
        self._sim.silence(part)
        self._saved_weights[part] = weights
        self._page.look_again(*indices)
        self._page.tell_state()

    def _restore(self, request: Request) -> None:
        """Restore the weights from before the population was silenced."""
        part = self._population(request)
        for index, weights in self._saved_weights.pop(part, {}).items():
            self._sim.set_weights(self._sim.program.projections[index].name, weights)
            self._page.look_again(index)
        self._page.tell_state()

    def _activate(self, request: Request) -> None:
        part = self._population(request)
        self._sim.activate(part, check(_NUMBER, request.get("rate"), "rate"))
        generators = driver(self._sim.program, self._sim.handles.neurons(part)).part.name
        self._page.tell_value(generators, "rate", self._sim.get(generators, "rate"))

    def _watch(self, request: Request) -> None:
        neuron = check(_NEURON, request.get("neuron"), "neuron")
        self._page.frames.watch(self._population(request), neuron, self._text(request, "state"))
        self._page.tell_state()

    def _curve(self, request: Request) -> None:
        self._page.helper.curve(self._population(request), check(_NEURON, request.get("neuron"), "neuron"))

    # files

    def _save(self, request: Request) -> Answer:
        with tempfile.TemporaryDirectory(prefix="neuro-live-") as folder:
            path = Path(folder) / "state.h5"
            self._sim.save(path)
            if path.stat().st_size > LARGEST_FILE:
                message = f"the state has {path.stat().st_size:,} bytes: expected at most {LARGEST_FILE:,}"
                raise ModelError(message, hint="sim.save(path) in the program writes the state to a file")
            return {"file": f"{self._sim.program.name}-{self._sim.time:g}ms.h5"}, path.read_bytes()

    def _network(self, request: Request) -> Answer:
        """Return the network with its learnt weights as YAML, or as a zip of YAML and arrays if arrays are large."""
        name = self._sim.program.name
        with tempfile.TemporaryDirectory(prefix="neuro-live-") as folder:
            self._sim.network().save(Path(folder) / "network.yaml")
            files = sorted(Path(folder).iterdir())
            if len(files) == 1:
                return {"file": f"{name}.yaml"}, files[0].read_bytes()
            content = io.BytesIO()
            with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
                for file in files:
                    archive.write(file, file.name)
            return {"file": f"{name}.zip"}, content.getvalue()

    # fields of a request

    def _text(self, request: Request, word: str) -> str:
        name: str = check(_NAME, request.get(word), word)
        return name

    def _population(self, request: Request) -> str:
        name, names = self._text(request, "population"), [part.name for part in self._sim.program.populations]
        if name not in names:
            raise unknown("population", name, names)
        return name

    def _part(self, request: Request) -> str:
        """Return the name of a population, projection or signal. The text of a view is refused."""
        program, name = self._sim.program, self._text(request, "part")
        names = [part.name for part in (*program.populations, *program.projections, *program.signals)]
        if name not in names:
            raise unknown("part", name, names)
        return name
