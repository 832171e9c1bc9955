"""A stream in the place of a recording."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

from neuro.core.errors import ModelError
from neuro.events._events import Events, checked_size
from neuro.events.errors import EventFileWarning
from neuro.events.streams._address import format_for, parsed
from neuro.events.streams._codings import CODINGS
from neuro.events.streams._listener import Listener, listen

TICK_MS = 1.0
"""Events that come within it are given together."""


def check_stream(url: str | None, format: str | None, sensor: tuple[int, ...] | None) -> None:
    """Refuse what `listen` would refuse, without listening.

    Raises:
        ModelError: the address or the format is none, or the sensor is missing or too large; `path` is the word.
    """
    word = "stream"
    try:
        scheme = parsed(url)[0]
        word = "format"
        name = format_for(scheme, format, CODINGS)
        word = "sensor"
        if sensor is None:
            raise ModelError("sensor is missing: expected [width, height] in px")
        size = checked_size(sensor)
        if name in CODINGS:
            CODINGS[name].check(size)
    except ModelError as error:
        raise error.but(path=(word,)) from None


@dataclass(frozen=True, slots=True)
class OfStream:
    """A stream that is played as a recording is; see `neuro.events.playing.Played`.

    Attributes:
        url: as of `listen`, as are the others.
        format: of the stream.
        sensor_size: width and height, px.
        until_silent: s, as is the next.
        first_within: of the first datagram.
        again: it cannot be played several times.
        no_sensor: "", since its sensor is known.
    """

    url: str
    format: str | None
    sensor_size: tuple[int, int]
    until_silent: float
    first_within: float
    again: bool = False
    no_sensor: str = ""

    @property
    def identity(self) -> str:
        """Its address."""
        return f"stream {self.url}"

    def first(self) -> None:
        """Not known before it comes."""

    def opened(self) -> Listener:
        """Begin to listen.

        Raises:
            ModelError: as of `listen`.
        """
        return listen(
            self.url, format=self.format, sensor=self.sensor_size, until_silent=self.until_silent,
            first_within=self.first_within, tick_ms=TICK_MS,
        )  # fmt: skip

    def parts(self, start_us: int | None = None, least: tuple[int, int] = (1, 1)) -> Iterator[Events]:
        """Its events as they come; at the end a warning if some were lost."""
        with self.opened() as stream:
            yield from stream
            lost = ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in stream.counts.lost.items())
        if lost:
            warnings.warn(f"{self.url}: {lost}", EventFileWarning, stacklevel=2)
