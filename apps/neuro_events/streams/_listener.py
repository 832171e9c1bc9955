"""Events received from the network while a program runs."""

from __future__ import annotations

import math
import socket
import time
import warnings
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import LazyModule, argument
from neuro_events._events import Events, checked_size
from neuro_events.formats._format import Damage
from neuro_events.source import EventFileWarning
from neuro_events.streams._codings import (
    CODINGS,
    Address,
    Decoder,
    PacketDecoder,
    address,
    format_for,
    parse_url,
    receive_header,
)
from neuro_events.streams._receiver import LEAST, Receiver

kernels = LazyModule("neuro_events.streams._kernels")

BUFFER = 1 << 25
"""Default size of the buffer, bytes: 0.8 s of 5 million events/s of 8 bytes."""
_CONNECT_S = 5.0
"""Longest time until a sender accepts a connection and sends its header, s."""


@dataclass(frozen=True, slots=True)
class StreamCounts:
    """Counts of received and lost events since the stream was opened.

    Attributes:
        events: events returned by `take`.
        datagrams: datagrams processed by `take`; for TCP, pieces.
        dropped_kernel: datagrams dropped because the system's queue was full, None if the system does not count them.
        dropped_buffer: datagrams dropped because the stream's own buffer was full.
        damaged: datagrams or connections with invalid bytes, and events dropped because their time is far from the
            times of the events around them.
        out_of_order: events dropped because they are earlier than an event before.
        outside: events dropped because they are off the sensor.
        restarts: number of times that the sender's clock fell back. The times that `take` returns never fall back.
        connections: number of reconnections.
    """

    events: int = 0
    datagrams: int = 0
    dropped_kernel: int | None = 0
    dropped_buffer: int = 0
    damaged: int = 0
    out_of_order: int = 0
    outside: int = 0
    restarts: int = 0
    connections: int = 0

    @property
    def lost(self) -> dict[str, int]:
        """All counts above 0 except events and datagrams: losses and irregularities."""
        counts = {f.name: getattr(self, f.name) for f in fields(self)[2:]}
        return {name: count for name, count in counts.items() if count}


class Listener:
    """A stream of events from the network. `listen` opens the stream, and `close` or a `with` block closes the stream.

    A thread receives, outside the interpreter, into a buffer of fixed size. The program takes the events from the
    buffer, always in the same thread. Iteration yields the arriving events in parts, at most one part per `tick_ms`, so
    that filters and representations process a stream like the parts of a recording.

    Attributes:
        url: the address, with the actual port if port 0 was specified.
        format: format of the stream.
        sensor_size: width and height, px.
        received_ns: time of receipt of the oldest datagram of the last `take`, by `time.monotonic_ns`; None if there
            was no datagram.
    """

    def __init__(
        self, url: str, format: str, sensor: tuple[int, int], receiver: Receiver, decoder: Decoder, period: int,
        until_silent: float, first_within: float, tick_ms: float,
    ) -> None:  # fmt: skip
        self.url, self.format, self.sensor_size = url, format, sensor
        self.received_ns: int | None = None
        self._receiver, self._decoder, self._period = receiver, decoder, period
        self._until_silent, self._first_within, self._tick_s = until_silent, first_within, tick_ms / 1000.0
        self._facts, self._kernels = np.zeros(kernels.FACTS, np.int64), kernels
        self._facts[kernels.DOUBT] = kernels.NOWHERE
        self._events = self._datagrams = self._damaged = 0
        self._close = weakref.finalize(self, receiver.close)
        self._last_ns = receiver.opened_ns
        self._take(0, 0)  # compile the decoder
        self._ready_ns = time.monotonic_ns()

    def take(self) -> Events:
        """Return all events that have arrived since the last call, in the order of arrival.

        Events off the sensor, and events earlier than an event before, are dropped and counted. After a wrap of a
        32-bit clock, times continue to rise.
        """
        return self._take_up_to(self._receiver.entries[1])

    def take_before(self, ns: int) -> Events:
        """Return only the events that arrived before a time of `time.monotonic_ns`; see `take`."""
        return self._take_up_to(self._receiver.before(ns))

    def _take_up_to(self, last: int) -> Events:
        first = self._receiver.entries[0]
        self.received_ns = self._receiver.received(first) if last > first else None
        events = self._take(first, last)
        self._receiver.release(last)
        self._events += len(events)
        self._datagrams += last - first
        return events

    def _take(self, first: int, last: int) -> Events:
        receiver, kernels = self._receiver, self._kernels
        _, columns, damaged = self._decoder(receiver.ring, receiver.index, first, last)
        now = receiver.received(last - 1) if last > first else self._last_ns
        forward = kernels.FORWARD + (now - self._last_ns) // 1000
        arguments = *self.sensor_size, self._period, self.format == "aedat4", forward
        n = kernels.settle(receiver.index, first, last, *arguments, self._facts, columns)
        self._damaged += damaged
        if n:
            self._last_ns = now
        t, x, y, p = columns
        return Events._trusted(t[:n], x[:n], y[:n], p[:n], self.sensor_size, {"stream": self.url})

    def wait(self, timeout_s: float) -> bool:
        """Wait for new events, and return whether there are any.

        Args:
            timeout_s: longest wait, s.

        Raises:
            ModelError: `timeout_s` is not a number.
        """
        return self._receiver.wait(argument("timeout_s", timeout_s, infinite=True))

    def __iter__(self) -> Iterator[Events]:
        next_part_at = time.monotonic()
        while not self.ended:
            if not self.wait(min(self._silence_left(), 0.1)):
                continue
            if (delay := next_part_at - time.monotonic()) > 0:
                time.sleep(delay)
            next_part_at = time.monotonic() + self._tick_s
            part = self.take()
            if len(part):
                yield part

    @property
    def ended(self) -> bool:
        """True if all events are taken, and the stream is closed or was silent for too long (see `listen`)."""
        first, last = self._receiver.entries
        return first == last and (self._receiver.closed or self._silence_left() <= 0)

    def _silence_left(self) -> float:
        last = self._receiver.last_ns
        limit = self._first_within if last == self._receiver.opened_ns else self._until_silent
        return limit - (time.monotonic_ns() - max(last, self._ready_ns)) / 1e9

    @property
    def counts(self) -> StreamCounts:
        """Counts of received and lost events so far."""
        kernels, facts, receiver = self._kernels, self._facts, self._receiver
        return StreamCounts(
            events=self._events,
            datagrams=self._datagrams,
            dropped_kernel=receiver.overflown,
            dropped_buffer=receiver.refused,
            damaged=self._damaged + int(facts[kernels.DAMAGED]),
            out_of_order=int(facts[kernels.BACK]),
            outside=int(facts[kernels.OUTSIDE]),
            restarts=int(facts[kernels.RESTARTS]),
            connections=receiver.connections,
        )

    def close(self) -> None:
        """Stop listening; deleting the object has the same effect. Events in the buffer can still be taken."""
        self._close()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Listener {self.url} {self.format} {'x'.join(map(str, self.sensor_size))}>"


def listen(
    url: str,
    *,
    format: str | None = None,
    sensor: tuple[int, int] | None = None,
    until_silent: float | None = None,
    first_within: float | None = None,
    tick_ms: float = 10.0,
    buffer: int = BUFFER,
) -> Listener:
    """Receive events from the network.

    ::

        with neuro.events.listen("udp://127.0.0.1:3333", format="spif", sensor=(346, 260)) as stream:
            while stream.wait(1.0):
                events = stream.take()

    Args:
        url: ``udp://HOST:PORT``, an address of this machine that receives events; 0.0.0.0 stands for all addresses,
            and port 0 selects a free port. Or ``tcp://HOST:PORT``, the address of an AEDAT 4 sender such as
            dv-processing.
        format: "spif" (or "spif-timed", which is decoded in the same way), "faery13", "faery8", "raw-evt3"; for TCP
            "aedat4".
        sensor: width and height, px. With TCP the sender states it.
        until_silent: longest silence after the first data, s; then iteration ends. None: no limit.
        first_within: longest wait for the first data, s; then iteration ends. None: no limit.
        tick_ms: shortest time between two parts of an iteration, ms.
        buffer: size of the buffer, bytes, at least 262,144.

    Raises:
        ModelError: the address cannot be used, the format is unknown, or the sensor is missing or too large. With TCP
            also: there is no sender, or the sender does not send AEDAT 4.
    """
    where = address(url)
    name = format_for(where.scheme, format, CODINGS)
    size = None if sensor is None else checked_size(sensor)
    buffer = int(argument("buffer", buffer, kind="integer", at_least=LEAST))
    tick_ms = argument("tick_ms", tick_ms, at_least=0)
    limits = {"until_silent": until_silent, "first_within": first_within}
    silent, first = (math.inf if s is None else argument(w, s, above=0, infinite=True) for w, s in limits.items())
    times = silent, first, tick_ms
    if where.scheme == "tcp":
        return _connected(where, name, size, buffer, times)
    coding = CODINGS[name]
    if size is None:
        raise ModelError("sensor is missing: expected width and height in px, as format "
                         f"'{name}' does not contain them")  # fmt: skip
    coding.check(size)
    sock = where.new_socket()
    try:
        sock.bind(where.place)
        bound_url = where.bound_url(sock.getsockname())
    except OSError as error:
        sock.close()
        raise where.as_model_error(error) from None
    receiver = Receiver(sock, buffer, None)
    return Listener(bound_url, name, size, receiver, coding.decoder(receiver.opened_ns), coding.period, *times)


def _connected(
    where: Address, name: str, size: tuple[int, int] | None, buffer: int, times: tuple[float, float, float]
) -> Listener:
    """Connect to a sender of AEDAT 4."""

    def connect() -> tuple[socket.socket, Any]:
        sock = where.new_socket()
        try:
            sock.settimeout(_CONNECT_S)
            sock.connect(where.place)
            return sock, receive_header(sock, where.url)
        except BaseException:
            sock.close()
            raise

    def reconnect() -> socket.socket | None:
        try:
            sock, (peer, *rest) = connect()
        except (OSError, ModelError):
            return None
        if (peer.compression, *rest) == (header.compression, number, sensor):
            return sock
        sock.close()
        return None

    try:
        sock, (header, number, sensor) = connect()
    except OSError as error:
        raise where.as_model_error(error) from None
    try:
        if size is not None and size != sensor:
            actual, expected = ("{}x{}".format(*sensor_size) for sensor_size in (sensor, size))
            raise ModelError(f"{where.url}: sends events of a {actual} sensor: expected {expected}")
        decoder = PacketDecoder(header.compression, number, lambda: receiver.hang_up())
    except Damage as damage:
        sock.close()
        raise ModelError(f"{where.url}: {damage.what}") from None
    except ModelError:
        sock.close()
        raise
    receiver = Receiver(sock, buffer, reconnect)
    return Listener(where.url, name, sensor, receiver, decoder, 0, *times)


TICK_MS = 1.0
"""Time span of the events that a played stream yields as one part, ms."""


def check_stream(url: str | None, format: str | None, sensor: tuple[int, ...] | None) -> None:
    """Check the arguments of `listen` without listening.

    Raises:
        ModelError: the address or the format is invalid, or the sensor is missing or too large. The error's `path` is
            the word of the network description: stream, format or sensor.
    """
    word = "stream"
    try:
        scheme = parse_url(url)[0]
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
    """A stream as input of an event camera; see `neuro.events.playing.Played`.

    Attributes:
        url: see `listen`.
        format: see `listen`.
        sensor_size: width and height, px.
        until_silent: see `listen`, s.
        first_within: see `listen`, s.
        repeatable: False, since a stream cannot be played again.
        no_sensor: "", since its sensor is known.
    """

    url: str
    format: str | None
    sensor_size: tuple[int, int]
    until_silent: float
    first_within: float
    repeatable: bool = False
    no_sensor: str = ""

    @property
    def identity(self) -> str:
        """Address of the stream."""
        return f"stream {self.url}"

    def first(self) -> None:
        """Return None, since the first event is unknown before it arrives."""

    def opened(self) -> Listener:
        """Start listening.

        Raises:
            ModelError: see `listen`.
        """
        return listen(
            self.url, format=self.format, sensor=self.sensor_size, until_silent=self.until_silent,
            first_within=self.first_within, tick_ms=TICK_MS,
        )  # fmt: skip

    def parts(self, start_us: int | None = None, least: tuple[int, int] = (1, 1)) -> Iterator[Events]:
        """Yield the events as they arrive. Warn at the end if events were lost."""
        with self.opened() as stream:
            yield from stream
            losses = ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in stream.counts.lost.items())
        if losses:
            warnings.warn(f"{self.url}: {losses}", EventFileWarning, stacklevel=2)
