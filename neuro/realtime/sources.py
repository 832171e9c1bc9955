"""Live sources of events: division into ticks, and conversion to the network's time."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.cameras import CameraInput
from neuro.core.errors import ModelError
from neuro.core.extras import app
from neuro.run.simulation import Simulation

if TYPE_CHECKING:
    from neuro_events import Events

_NONE = np.zeros(0, dtype=np.int64)


class Source(Protocol):
    """Source of live events, such as `neuro.events.listen` or a `Player`.

    A source may also have: `received_ns`, the times at which the events last taken were received, in ns of
    `time.monotonic_ns` (an array, or a number for all); `sensor_size`, width and height in px; `counts`, a mapping or
    a dataclass of losses and damage; and `take_before(ns)`, which replaces `take` and leaves events from that time on
    in the source. If a tick is late, the next tick then still gets its own events, even without times of receipt.
    """

    def take(self) -> Events:
        """Return all events since the last call, in the order of arrival, without waiting."""


class Inlet:
    """An event camera of a network, with the source of its events.

    An event acts a tick after it was received. The first event of a tick keeps its time of receipt within the tick; the
    others follow by the differences of their time stamps, up to the end of the tick.

    Args:
        sim: the simulation.
        name: name of the population.
        source: source of the events.

    Attributes:
        name: name of the population.
        taken: number of events taken from the source.
        fed: number of events fed to the network.
        dropped: number of events of skipped ticks.

    Raises:
        ModelError: the population does not exist or cannot be fed, or the source has another sensor size.
    """

    def __init__(self, sim: Simulation, name: str, source: Any) -> None:
        if not callable(getattr(source, "take", None)):
            raise ModelError(f"inputs: source of '{name}' is {source!r:.60}: expected an object with 'take'")
        neurons = sim.handles.neurons(name)
        camera = neurons.part.stream
        if neurons.view is not None or not isinstance(camera, CameraInput):
            raise ModelError(f"inputs: '{name}' is {neurons.part.model_name}: expected an event_camera")
        model = camera.model
        if any(getattr(model, word) is not None for word in ("file", "events", "stream")):
            raise ModelError(f"inputs: '{name}' plays a recording: expected an event_camera without a recording")
        if model.start:
            raise ModelError(f"inputs: '{name}' starts at {model.start:g} ms: expected 0")
        if (size := getattr(source, "sensor_size", None)) is not None and model.visible_shape(
            tuple(size)
        ) != neurons.part.shape:
            shapes = f"{list(model.visible_shape(tuple(size)))} of its source: expected {list(neurons.part.shape)}"
            raise ModelError(f"inputs: '{name}' would have the shape {shapes}")
        self.name, self._sim, self._source, self._camera = name, sim, source, camera
        self._events = app("neuro_events._events", "the type of events")
        self._take_before: Callable[[int], Events] | None = getattr(source, "take_before", None)
        self._waiting: deque[tuple[Events, NDArray[np.int64]]] = deque()
        self.taken = self.fed = self.dropped = 0

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of the source, e.g. of lost datagrams."""
        reported: Any = getattr(self._source, "counts", None)
        if is_dataclass(reported) and not isinstance(reported, type):
            reported = asdict(reported)
        counts = {str(k): v for k, v in reported.items() if v is not None} if isinstance(reported, Mapping) else {}
        for word, count in counts.items():
            if not isinstance(count, int | np.integer):
                message = f"counts of the source of '{self.name}' has {word} = {count!r:.60}"
                raise ModelError(f"inputs: {message}: expected a whole number")
        return {word: int(count) for word, count in counts.items()}

    def rehearse(self) -> None:
        """Feed zero events, to load and compile all that `feed` needs."""
        if (size := getattr(self._source, "sensor_size", None)) is not None:
            self._sim.feed(self.name, self._events.Events(*self._events.empty_columns(0), tuple(size)))

    def begin(self) -> None:
        """Discard all events so far."""
        self._source.take()
        self._waiting.clear()

    def take(self, begin_ns: int, end_ns: int) -> tuple[Events | None, NDArray[np.int64]]:
        """Return the events that were received between two moments, and their times; earlier events are dropped.

        Raises:
            ModelError: the source returns other objects than events, or times that do not match the events.
        """
        if begin_ns and self._take_before is not None:  # the source may not know their times of receipt
            self._wait_for(self._take_before(begin_ns))
        self._wait_for(self._source.take() if self._take_before is None else self._take_before(end_ns))
        tick_parts = []
        while self._waiting and self._waiting[0][1][0] < end_ns:
            events, received = self._waiting.popleft()
            if received[0] < begin_ns:
                n_early = int(np.searchsorted(received, begin_ns))
                self.dropped += n_early
                events, received = events[n_early:], received[n_early:]
            if len(events) and received[-1] >= end_ns:
                end = int(np.searchsorted(received, end_ns))
                self._waiting.appendleft((events[end:], received[end:]))
                events, received = events[:end], received[:end]
            if len(events):
                tick_parts.append((events, received))
        if len(tick_parts) < 2:
            return tick_parts[0] if tick_parts else (None, _NONE)
        parts, times = zip(*tick_parts, strict=True)
        columns = self._events.joined_columns(part._columns for part in parts)
        return self._events.Events._trusted(*columns, parts[0].sensor_size, {}), np.concatenate(times)

    def _wait_for(self, events: Events) -> None:
        """Queue events of the source, with the times of receipt, until the tick in which the events act."""
        if not isinstance(events, self._events.Events):
            raise ModelError(f"inputs: source of '{self.name}' gave {events!r:.60}: expected Events")
        if len(events):
            self.taken += len(events)
            received = getattr(self._source, "received_ns", None)
            moments = np.asarray(time.monotonic_ns() if received is None else received)
            if moments.dtype.kind not in "iu" or moments.shape not in ((), (len(events),)):
                message = f"received_ns of the source of '{self.name}' is {received!r:.60}"
                raise ModelError(f"inputs: {message}: expected whole ns, one for all or each of {len(events):,} events")
            self._waiting.append((events, moments if moments.ndim else np.full(len(events), moments)))

    def feed(self, events: Events, received: NDArray[np.int64], begin_ns: int, step: int, steps: int) -> None:
        """Feed the events of a tick to the camera, for the next steps of the network.

        Args:
            events: events of the tick.
            received: time of receipt of each event.
            begin_ns: begin of the tick.
            step: last finished step.
            steps: number of steps of a tick.
        """
        first_us = self._camera.first_us(step)
        if steps == 1:
            t = np.full(len(events), first_us)
        else:
            last_us = self._camera.first_us(step + steps) - 1
            begin_us = first_us + (int(received[0]) - begin_ns) // 1000
            t = np.clip(events.t + (begin_us - int(events.t[0])), first_us, last_us)
        shifted = self._events.Events._trusted(t, events.x, events.y, events.p, events.sensor_size, {})
        if steps > 1 and (t[1:] < t[:-1]).any():
            shifted = shifted[np.argsort(t, kind="stable")]
        self._sim.feed(self.name, shifted)
        self.fed += len(events)
