"""Populations that emit the events of a recording or a stream of an event camera as spikes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from neuro.core.choice import Choice
from neuro.core.errors import ModelError, here
from neuro.core.extras import app
from neuro.core.quantities import quantity
from neuro.core.values import shown
from neuro.model.neurons.base import Generator

if TYPE_CHECKING:
    from neuro_events.playing import Played

_READER = "the reader of recordings"


@dataclass(frozen=True, kw_only=True, eq=False)
class crop(Choice):
    """A rectangle of a sensor. All pixels of an axis are used if it has no range."""

    kind: ClassVar[str] = "crop"
    x: Any = quantity(None, "px", "first column and last column + 1", kind="shape", at_least=0)
    y: Any = quantity(None, "px", "first row and last row + 1", kind="shape", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for word in ("x", "y"):
            sides = getattr(self, word)
            if sides is not None and (len(sides) != 2 or sides[0] >= sides[1]):
                message = f"crop.{word} = {shown(sides)}: expected [first, last + 1]"
                raise ModelError(message, where=here(), path=(word,))

    def sides(self, width: int, height: int) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return the columns and the rows of the rectangle, each as (first, last + 1), for a sensor of this size in px.

        Raises:
            ModelError: the rectangle reaches beyond the sensor.
        """
        for word, limit in (("x", width), ("y", height)):
            sides = getattr(self, word)
            if sides is not None and sides[1] > limit:
                message = (
                    f"crop.{word} = {shown(sides)}: expected within [0, {limit}], the sensor is {width}x{height} px"
                )
                raise ModelError(message, path=("crop", word))
        return self.x or (0, width), self.y or (0, height)


@dataclass(frozen=True, kw_only=True, eq=False)
class event_camera(Generator):
    """Generator of the events of a recording as spikes, at the times of the recording.

    While the network runs, the population behaves as a `spike_generator`.

    With the polarity `split` the population has the shape [2, height, width], OFF before ON, otherwise [height, width].
    The shape `auto` is read from the recording. An event at time t of the recording is emitted in the step of `start` +
    t, and an event at t = 0 in the first step after `start`. Several events of a neuron in one step make a spike of
    that multiplicity. The recording is read while the network runs, a few 100,000 events ahead. Without a recording,
    the population emits the events given to `sim.feed`. With a stream, events are received from the first step on, and
    the network waits for them.
    """

    equation: ClassVar[str] = "emits in step floor((t - origin - offset) / h) + 1 after start"
    source: ClassVar[str] = "events of a recording, t in us"
    role: ClassVar[str] = "streamed"

    file: Any = quantity(None, "", "file of the recording, in any format of `neuro.events`", kind="file")
    events: Any = quantity(
        None,
        "",
        "in Python: Events, a structured array, a list or iterator of these, or a function that returns one",
        kind="events",
    )
    stream: str | None = quantity(
        None, "", "address of a stream, see `neuro.events.listen`, e.g. udp://127.0.0.1:3333", kind="name"
    )
    format: str | None = quantity(
        None, "", "format, required for streams, and for files without a known content or ending", kind="name"
    )
    sensor: Any = quantity(None, "px", "width and height of a stream's sensor", kind="shape", at_least=1)
    until_silent: float = quantity(
        5000.0, "ms", "time without events after which a stream ends, once it has begun", above=0, infinite=True
    )
    first_within: float = quantity(
        math.inf, "ms", "time without a first event after which a stream ends", above=0, infinite=True
    )
    polarity: str = quantity(
        "split",
        "",
        "split: separate neurons per polarity; merge: shared neurons; on, off: one polarity only",
        kind="word",
        words=("split", "merge", "on", "off"),
    )
    crop: Any = quantity(None, "", "part of the sensor to use, e.g. {x: [10, 100], y: [0, 50]}", kind="part", part=crop)
    scale: int = quantity(
        1,
        "px",
        "side length of the square of pixels per neuron; 2 halves width and height",
        kind="integer",
        at_least=1,
    )
    origin: float | None = quantity(
        None, "us", "time stamp at which the recording begins; by default that of the first event", whole=True
    )
    offset: float = quantity(0.0, "ms", "duration to skip at the beginning", at_least=0)
    start: float = quantity(0.0, "ms", "simulated time at which the recording begins", at_least=0)
    stop: float = quantity(math.inf, "ms", "simulated time after which nothing is emitted", at_least=0, infinite=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        sources = [word for word in ("file", "events", "stream") if getattr(self, word) is not None]
        if len(sources) > 1:
            found_words = f"both '{sources[0]}' and '{sources[1]}'"
            raise ModelError(f"event_camera: found {found_words}: expected one of them", where=here())
        if self.stream is None and self.sensor is not None:
            message = "event_camera: found 'sensor' without 'stream': expected it for streams only"
            raise ModelError(message, where=here(), path=("sensor",), missing="stream")
        try:
            if self.stream is not None:
                app("neuro_events.streams", _READER).check_stream(self.stream, self.format, self.sensor)
            if self.events is not None:
                played = app("neuro_events.playing", _READER).played
                object.__setattr__(self, "events", played(self.events))
        except ModelError as error:
            raise error.at(here(), "event_camera") from None
        if abs(self.offset * 1000.0 - round(self.offset * 1000.0)) > 1e-6:
            message = f"event_camera.offset = {self.offset:.12g} ms: expected a multiple of 0.001 ms"
            raise ModelError(message, where=here(), path=("offset",))

    def visible_shape(self, sensor: tuple[int, int]) -> tuple[int, ...]:
        """Return the shape of the visible part of a sensor of this width and height in px.

        Raises:
            ModelError: the crop reaches beyond the sensor.
        """
        columns, rows = self.sides(*sensor)
        height, width = (-(-(last - first) // self.scale) for first, last in (rows, columns))
        return (2, height, width) if self.polarity == "split" else (height, width)

    def sides(self, width: int, height: int) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return the visible columns and rows of a sensor of this size in px, each as (first, last + 1)."""
        if self.crop is None:
            return (0, width), (0, height)
        return self.crop.sides(width, height)  # type: ignore[no-any-return]

    def sizes(self, shape: tuple[int | str, ...]) -> tuple[int | str, ...]:
        """Return the shape. If it is `auto` and no recording gives the size yet, only the number of axes is known."""
        if "auto" not in shape:
            return shape
        try:
            played = self.played()
            if played is not None and played.sensor_size is not None:
                return self.visible_shape(played.sensor_size)
        except ModelError:  # reported when the network is compiled
            pass
        unknown = (2, "auto", "auto") if self.polarity == "split" else ("auto", "auto")
        return shape if len(shape) == len(unknown) else unknown

    def played(self) -> Played | None:
        """Return the recording, or None for events given to `sim.feed`.

        Raises:
            EventFileError: the file does not exist, or its beginning is damaged.
            ModelError: the package that reads recordings is not installed.
        """
        if self.stream is not None:
            seconds = (self.until_silent / 1000.0, self.first_within / 1000.0)
            streams = app("neuro_events.streams", _READER)
            return streams.OfStream(self.stream, self.format, self.sensor, *seconds)  # type: ignore[no-any-return]
        if self.file is None:
            return self.events  # type: ignore[no-any-return]
        return app("neuro_events.playing", _READER).of_file(self.file, self.format)  # type: ignore[no-any-return]
