"""Event cameras of a network: the conversion of recorded events to spikes of a population of pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from neuro.compiler.shapes import Shape
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.extras import LazyModule, app
from neuro.model.network import Network
from neuro.model.neurons import event_camera
from neuro.model.parts import AUTO, Population, naming_the_part
from neuro.program.program import Ints, Stretch

camera_kernel = LazyModule("neuro.compiler.camera_kernel")

MOST = 1 << 17
"""Largest number of events that are converted to spikes in one call."""
_FINEST = 10**6
"""Largest denominator of the fraction of a ms that approximates the resolution, so that steps are exact."""
_NONE = np.zeros(0, dtype=np.int64)


def cameras_of(net: Network, parts: Sequence[Population], clock: Clock) -> dict[str, CameraInput]:
    """Open the recordings of the event cameras of a network; return the cameras by population.

    Args:
        net: the network.
        parts: populations of the network that are cameras.
        clock: clock of the network.

    Raises:
        ModelError: a recording cannot be played, or its sensor does not fit the shape of the population.
    """
    cameras = {}
    for part in parts:
        if isinstance(part.model, event_camera):
            with naming_the_part(part):
                cameras[part.name] = CameraInput(part, part.model, clock)
                cameras[part.name].check_events()
                if net.trials_section is not None:
                    message = "an event_camera in a network with trials, which get their input from the caller"
                    raise ModelError(f"{message}: expected a spike_generator", hint="sim.trials(times, ids, offsets)")
    return cameras


class CameraInput:
    """A population of pixels that emits the events of a recording as spikes.

    Args:
        part: the population.
        model: model of the population.
        clock: clock of the network.

    Attributes:
        shape: shape of the population.
        model: model of the population.
        sensor_size: width and height of the sensor in px; without a recording, the smallest sensor for the shape.
        repeatable: whether the recording can be played several times.
        identity: identity of the model and the recording.
    """

    def __init__(self, part: Population, model: event_camera, clock: Clock) -> None:
        self._part, self.model = part, model
        self._played = model.played()
        self._eyes: dict[tuple[int, int, int], Eye] = {}
        self._sensor = None if self._played is None else self._played.sensor_size
        self.repeatable = self._played is None or self._played.repeatable
        ratio = Fraction(clock.resolution).limit_denominator(_FINEST) * 1000
        self._step_us = ratio.numerator, ratio.denominator
        self._offset = round(model.offset * 1000.0)
        self._start, self._stop = (clock.step(getattr(model, w), f"{model.name}.{w}") for w in ("start", "stop"))
        self.shape = self._shape_of(part.shape)
        self.sensor_size = self._sensor or self._visible_size()
        self._origin = 0 if self._played is None else self._played.first()
        if model.origin is not None:
            self._origin = int(model.origin)

    @property
    def identity(self) -> str:
        """Text that determines the spikes: parameters and content of the recording, but not its path."""
        parameters = {word: value for word, value in self.model.parameters().items() if word not in ("file", "events")}
        return f"{parameters} {'' if self._played is None else self._played.identity}"

    def check_events(self) -> None:
        """Raise an error if the recording can be read already, and has no events after its beginning."""
        model = self.model
        word = "offset" if model.offset else "origin"
        if self._played is None or self._origin is None or self._played.first() is None or not getattr(model, word):
            return
        begin = self._origin + self._offset
        if not any(len(part) and int(part.t[-1]) >= begin for part in self._played.parts(begin, self.sensor_size)):
            unit = model.quantities()[word].unit
            message = f"{model.name}.{word} = {getattr(model, word):.7g} {unit}"
            raise ModelError(f"{message}: the recording has no event after that", path=(model.name, word))

    def _shape_of(self, declared: tuple[int | str, ...]) -> Shape:
        """Return the shape for the sensor. A declared shape must agree."""
        if self._sensor is None:
            if AUTO in declared:
                hint = "write the numbers: [2, height, width], or [height, width] unless the polarities are split"
                if self._played is not None and isinstance(self._played, app("neuro_events.playing", "").OfEvents):
                    hint = f"give the sensor, neuro.events.Events(t, x, y, p, (width, height)); or {hint}"
                message = "no sensor is known before playback" if self._played is None else self._played.no_sensor
                raise ModelError(f"shape {_as_yaml(declared)}: {message}", hint=hint, path=("shape",))
            numbers = tuple(int(n) for n in declared)
            if len(numbers) != 2 + self._split or (self._split and numbers[0] != 2):
                expected = "[2, height, width]" if self._split else "[height, width]"
                message = f"shape {list(numbers)}: expected {expected} with polarity: {self.model.polarity}"
                raise ModelError(message, path=("shape",), about=("polarity",))
            return numbers
        shape = self.model.visible_shape(self._sensor)
        fits = len(declared) == len(shape) and all(word in (AUTO, n) for word, n in zip(declared, shape, strict=True))
        if not fits and declared != (AUTO,):
            width, height = self._sensor
            message = f"shape {_as_yaml(declared)}: expected {list(shape)}, because the sensor is {width}x{height} px"
            raise ModelError(message, hint="'shape: auto' takes it from the recording", path=("shape",))
        return shape

    def _visible_size(self) -> tuple[int, int]:
        """Return width and height in px of the visible area, from the shape, if the sensor is unknown."""
        rows, columns = (n * self.model.scale for n in self.shape[-2:])
        crop = self.model.crop
        ends = (None, None) if crop is None else (crop.x, crop.y)
        width, height = (n if side is None else side[1] for n, side in zip((columns, rows), ends, strict=True))
        return width, height

    @property
    def _split(self) -> bool:
        return self.model.polarity == "split"

    def after(self, step: int) -> Iterator[Stretch]:
        """Yield all spikes of later steps. The last step is held back until all of its events are read."""
        with naming_the_part(self._part):
            steps = ids = _NONE
            for events in self._read(step):
                new = self._spikes(events, step)
                steps, ids = np.concatenate((steps, new[0])), np.concatenate((ids, new[1]))
                last = self._step(int(events.t[-1]))
                complete = int(np.searchsorted(steps, last))
                yield Stretch(last - 1, steps[:complete], ids[:complete])
                steps, ids = steps[complete:], ids[complete:]
            yield Stretch(NEVER, steps, ids)

    def _read(self, step: int) -> Iterator[Any]:
        """Yield the events of later steps, up to the first batch beyond the end."""
        if self._played is None or step >= self._stop:
            return
        for events in self._played.parts(self._begin(step), self.sensor_size):
            for k in range(0, len(events), MOST):
                yield events[k : k + MOST]
            if len(events) and self._step(int(events.t[-1])) > self._stop:
                return

    def spikes_of(self, events: Any) -> tuple[Ints, Ints]:
        """Return steps and neurons of Events, a structured array, or an iterable of these."""
        if isinstance(events, (str, PathLike)):
            raise ModelError(f"events: found {str(events)!r}: expected Events", hint="neuro.events.load reads a file")
        if self._origin is None:
            raise ModelError("the recording has not begun: expected 'origin'", hint="set 'origin', or run first")
        begin = self._origin + self._offset
        event_arrays = []
        playing = app("neuro_events.playing", "the type of events")
        batches = (
            [events] if isinstance(events, playing.Events) else playing.played(events).parts(None, self.sensor_size)
        )
        for events_array in batches:
            if len(events_array) and events_array.t[0] < begin:
                raise ModelError(f"an event at {events_array.t[0]} us: expected {begin} us or later, the beginning")
            event_arrays.append(self._spikes(events_array, -NEVER))
        if len(event_arrays) == 1:
            return event_arrays[0]
        steps, ids = (np.concatenate([_NONE, *(events_array[k] for events_array in event_arrays)]) for k in (0, 1))
        return steps, ids

    def first_us(self, step: int) -> int:
        """Return the earliest time, in us, of an event that is emitted after this step."""
        numerator, denominator = self._step_us
        since = max(0, step - self._start) * numerator
        return (self._origin or 0) + self._offset - (-since // denominator)

    def _begin(self, step: int) -> int | None:
        """Return the first time, in us, to read for the spikes after this step; None to read everything."""
        if self._origin is None or (step <= self._start and not self._offset and self.model.origin is None):
            return None
        return self.first_us(step)

    def _step(self, t: int) -> int:
        """Return the step that emits an event, from the time of the event in us."""
        numerator, denominator = self._step_us
        return self._start + (t - (self._origin or 0) - self._offset) * denominator // numerator + 1

    def _spikes(self, events: Any, after: int) -> tuple[Ints, Ints]:
        """Return steps and neurons of the visible events, in steps after this one."""
        width, height = self._sensor or events.sensor_size
        if events.sensor_size != (width, height):
            size = "{}x{}".format(*events.sensor_size)
            raise ModelError(f"events of a {size} sensor: expected {width}x{height}, the size of the recording")
        if self._origin is None and len(events):
            self._origin = int(events.t[0])
        steps, ids = np.empty(len(events), np.int64), np.empty(len(events), np.int64)
        n = camera_kernel.see(events.t, events.x, events.y, events.p, self._eye(width, height), after, steps, ids)
        if n < 0:
            t, x, y = (column[-1 - n] for column in (events.t, events.x, events.y))
            raise ModelError(f"event at x = {x}, y = {y}, {t} us: expected it within the shape {list(self.shape)}")
        return steps[:n], ids[:n]

    def _eye(self, width: int, height: int) -> Eye:
        """Return the visible area of a sensor of this width and height, for the kernel."""
        begin = (self._origin or 0) + self._offset
        if (width, height, begin) not in self._eyes:
            model, (rows, columns) = self.model, self.shape[-2:]
            with naming_the_part(self._part):
                (left, right), (top, bottom) = model.sides(width, height)
            polarity = {"on": 1, "off": 0}.get(model.polarity, -1)
            polarity_stride = rows * columns if self._split else 0
            clock = (begin, *self._step_us, self._start, min(self._stop, NEVER))
            eye = Eye(*clock, left, right, top, bottom, model.scale, rows, columns, polarity, polarity_stride)
            self._eyes = {(width, height, begin): eye}
        return self._eyes[width, height, begin]


def _as_yaml(shape: tuple[int | str, ...]) -> str:
    """Return a shape in YAML notation."""
    return str(shape[0]) if len(shape) == 1 else f"[{', '.join(map(str, shape))}]"


class Eye(NamedTuple):
    """Visible area of a sensor, and conversion from times to steps, for the kernel.

    Attributes:
        begin: the first time of the recording, us.
        numerator, denominator: us in a step, as a ratio.
        start: the step after which the recording begins.
        stop: the last step.
        left, right, top, bottom: visible columns left <= x < right and rows top <= y < bottom.
        scale: side of the squares of pixels that share a neuron.
        rows, columns: size of the population.
        polarity: the visible polarity, 0 or 1; -1: both.
        polarity_stride: distance between the neurons of the two polarities; 0 if both share the neurons.
    """

    begin: int
    numerator: int
    denominator: int
    start: int
    stop: int
    left: int
    right: int
    top: int
    bottom: int
    scale: int
    rows: int
    columns: int
    polarity: int
    polarity_stride: int
