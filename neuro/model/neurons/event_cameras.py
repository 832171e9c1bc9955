"""A recording of an event camera, or what one sends, as spikes."""

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
    """A rectangle of a sensor; what is not given is whole."""

    kind: ClassVar[str] = "crop"
    x: Any = quantity(None, "px", "first column and the one after the last", kind="shape", at_least=0)
    y: Any = quantity(None, "px", "first row and the one after the last", kind="shape", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for word in ("x", "y"):
            sides = getattr(self, word)
            if sides is not None and (len(sides) != 2 or sides[0] >= sides[1]):
                message = f"crop.{word} = {shown(sides)}: expected [first, the one after the last]"
                raise ModelError(message, where=here(), path=(word,))

    def sides(self, width: int, height: int) -> tuple[tuple[int, int], tuple[int, int]]:
        """Columns and rows that are kept of a sensor, each as the first and the one after the last.

        Raises:
            ModelError: they reach beyond it.
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
    """Emits the events of a recording as spikes, in the recording's own time; while running it is a `spike_generator`.

    Its shape is [2, height, width] with `split` polarities, OFF before ON, else [height, width]; `auto` takes it from
    the recording. An event t after the beginning is emitted in the step of `start` + t: with t = 0 in the first one
    after `start`. Several events of a neuron in one step make a spike of that multiplicity. The recording is read while
    the network runs, a few 100,000 events ahead. Without a recording it emits what `sim.feed` gives it. A stream is
    listened to from the first step on, and the network waits for its events.
    """

    equation: ClassVar[str] = "emits in step floor((t - origin - offset) / h) + 1 after start"
    source: ClassVar[str] = "the events of a recording, t in us"
    role: ClassVar[str] = "streamed"

    file: Any = quantity(None, "", "the recording, in any format of `neuro.events`", kind="file")
    events: Any = quantity(
        None,
        "",
        "in Python, instead: Events, a structured array, a list or an iterator of them, or a function that makes one",
        kind="events",
    )
    stream: str | None = quantity(
        None, "", "instead: the address of a stream, as of `neuro.events.listen`: udp://127.0.0.1:3333", kind="name"
    )
    format: str | None = quantity(
        None, "", "its format, where neither content nor ending shows it; of a stream always", kind="name"
    )
    sensor: Any = quantity(None, "px", "of a stream: width and height", kind="shape", at_least=1)
    until_silent: float = quantity(
        5000.0, "ms", "a stream is over when nothing has come for so long after something had", above=0, infinite=True
    )
    first_within: float = quantity(
        math.inf, "ms", "a stream is over when nothing at all has come for so long", above=0, infinite=True
    )
    polarity: str = quantity(
        "split",
        "",
        "each polarity has neurons of its own, both have the same, or one is left out",
        kind="word",
        words=("split", "merge", "on", "off"),
    )
    crop: Any = quantity(
        None, "", "the part of the sensor that is seen, {x: [10, 100], y: [0, 50]}", kind="part", part=crop
    )
    scale: int = quantity(
        1,
        "px",
        "side of the squares of pixels that share a neuron: 2 halves width and height",
        kind="integer",
        at_least=1,
    )
    origin: float | None = quantity(
        None, "us", "the time of the recording that is its beginning; that of its first event if not given", whole=True
    )
    offset: float = quantity(0.0, "ms", "what is left out at the beginning", at_least=0)
    start: float = quantity(0.0, "ms", "the recording begins at this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and nothing is emitted after this one", at_least=0, infinite=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [word for word in ("file", "events", "stream") if getattr(self, word) is not None]
        if len(given) > 1:
            both = f"both '{given[0]}' and '{given[1]}'"
            raise ModelError(f"event_camera: found {both}: expected one of them", where=here())
        if self.stream is None and self.sensor is not None:
            message = "event_camera: found 'sensor' without 'stream': a recording tells its own"
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
            message = f"event_camera.offset = {self.offset:.12g} ms: expected whole us, as the times of events are"
            raise ModelError(message, where=here(), path=("offset",))

    def seen(self, sensor: tuple[int, int]) -> tuple[int, ...]:
        """The shape of what is seen of a sensor of this width and height, px.

        Raises:
            ModelError: what is cropped reaches beyond it.
        """
        columns, rows = self.sides(*sensor)
        height, width = (-(-(last - first) // self.scale) for first, last in (rows, columns))
        return (2, height, width) if self.polarity == "split" else (height, width)

    def sides(self, width: int, height: int) -> tuple[tuple[int, int], tuple[int, int]]:
        """Columns and rows that are seen of a sensor, each as the first and the one after the last."""
        if self.crop is None:
            return (0, width), (0, height)
        return self.crop.sides(width, height)  # type: ignore[no-any-return]

    def sizes(self, said: tuple[int | str, ...]) -> tuple[int | str, ...]:
        """The shape; where it is `auto` and there is no recording yet that tells it, only the number of axes."""
        if "auto" not in said:
            return said
        try:
            played = self.played()
            if played is not None and played.sensor_size is not None:
                return self.seen(played.sensor_size)
        except ModelError:  # reported when the network is compiled
            pass
        unknown = (2, "auto", "auto") if self.polarity == "split" else ("auto", "auto")
        return said if len(said) == len(unknown) else unknown

    def played(self) -> Played | None:
        """The recording, None where there is none.

        Raises:
            EventFileError: there is no such file, or it is damaged where it begins.
            ModelError: the package that reads recordings is not installed.
        """
        if self.stream is not None:
            seconds = (self.until_silent / 1000.0, self.first_within / 1000.0)
            streams = app("neuro_events.streams", _READER)
            return streams.OfStream(self.stream, self.format, self.sensor, *seconds)  # type: ignore[no-any-return]
        if self.file is None:
            return self.events  # type: ignore[no-any-return]
        return app("neuro_events.playing", _READER).of_file(self.file, self.format)  # type: ignore[no-any-return]
