"""Events that come by the network while a program runs."""

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
    parsed,
    received_header,
)
from neuro_events.streams._receiver import LEAST, Receiver

kernels = LazyModule("neuro_events.streams._kernels")

BUFFER = 1 << 25
"""Bytes that wait to be taken, at most; 0.8 s of 5 million events a second of 8 bytes."""
_CONNECT_S = 5.0
"""Time that a sender has to accept a connection and to say what it sends, s."""


@dataclass(frozen=True, slots=True)
class StreamCounts:
    """What came and what was lost, since the stream was opened.

    Attributes:
        events: that were taken.
        datagrams: that were taken; by TCP, pieces.
        dropped_kernel: datagrams that came while the system's queue was full; None where it does not count them.
        dropped_buffer: datagrams that came while the stream's own buffer was full.
        damaged: datagrams, or connections, with bytes that are no event; and events left out, since their time is
            far from that of those beside it.
        out_of_order: events left out, since they are earlier than one before them.
        outside: events left out, since they are off the sensor.
        restarts: how often the sender's clock fell back; the time of the events goes on from there.
        connections: how often a connection was made anew.
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
        """What is not as it should be: all counts above 0 but those of events and datagrams."""
        named = {f.name: getattr(self, f.name) for f in fields(self)[2:]}
        return {name: count for name, count in named.items() if count}


class Listener:
    """A stream of events that is received from now on; made by `listen`, closed by `close` or a `with` block.

    A thread receives, without the interpreter, into a buffer of fixed size. One thread of the program takes what is
    there. A loop goes through the parts as they come, at most one each `tick_ms`, so that filters and representations
    take a stream as they take the parts of a recording.

    Attributes:
        url: the address, with the port that was free where 0 was asked for.
        format: of the stream.
        sensor_size: width and height, px.
        received_ns: when the oldest datagram of the last `take` came, by `time.monotonic_ns`; None if there was none.
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
        self._seen_ns = receiver.opened_ns
        self._take(0, 0)  # compiles what decodes
        self._ready_ns = time.monotonic_ns()

    def take(self) -> Events:
        """All events that have come and were not taken, in the order in which they came.

        Events off the sensor, and those earlier than one before them, are left out and counted. A clock of 32 bits is
        continued where it begins again.
        """
        return self._take_up_to(self._receiver.entries[1])

    def take_before(self, ns: int) -> Events:
        """As `take`, of what came before a time of `time.monotonic_ns`; the rest waits."""
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
        now = receiver.received(last - 1) if last > first else self._seen_ns
        forward = kernels.FORWARD + (now - self._seen_ns) // 1000
        words = *self.sensor_size, self._period, self.format == "aedat4", forward
        n = kernels.settle(receiver.index, first, last, *words, self._facts, columns)
        self._damaged += damaged
        if n:
            self._seen_ns = now
        t, x, y, p = columns
        return Events._trusted(t[:n], x[:n], y[:n], p[:n], self.sensor_size, {"stream": self.url})

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has come that was not taken; whether it has.

        Args:
            timeout_s: the longest wait, s.

        Raises:
            ModelError: it is not a number.
        """
        return self._receiver.wait(argument("timeout_s", timeout_s, infinite=True))

    def __iter__(self) -> Iterator[Events]:
        due = time.monotonic()
        while not self.ended:
            if not self.wait(min(self._silence_left(), 0.1)):
                continue
            if (early := due - time.monotonic()) > 0:
                time.sleep(early)
            due = time.monotonic() + self._tick_s
            part = self.take()
            if len(part):
                yield part

    @property
    def ended(self) -> bool:
        """Whether it was closed or silent for too long, see `listen`, and everything is taken."""
        first, last = self._receiver.entries
        return first == last and (self._receiver.closed or self._silence_left() <= 0)

    def _silence_left(self) -> float:
        last = self._receiver.last_ns
        limit = self._first_within if last == self._receiver.opened_ns else self._until_silent
        return limit - (time.monotonic_ns() - max(last, self._ready_ns)) / 1e9

    @property
    def counts(self) -> StreamCounts:
        """What came and what was lost so far."""
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
        """Stop listening, as when it is dropped; what has come can still be taken."""
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
        url: ``udp://HOST:PORT``, the address of this machine at which events come, 0.0.0.0 for all of its addresses;
            port 0 takes a free one. Or ``tcp://HOST:PORT``, the address of a sender of AEDAT 4 as dv-processing is.
        format: "spif" (or "spif-timed", which is received alike), "faery13", "faery8", "raw-evt3"; by TCP "aedat4".
        sensor: width and height, px. By TCP the sender gives it.
        until_silent: a loop over the stream ends when nothing has come for so long after something had, s; None: never.
        first_within: a loop over the stream ends when nothing at all has come for so long, s; None: never.
        tick_ms: a loop over the stream gives at most one part in so long, ms.
        buffer: bytes that may wait to be taken; at least 262,144.

    Raises:
        ModelError: the address cannot be used, the format is unknown, the sensor is missing or too large, or by TCP
            nobody sends there, or something else than AEDAT 4.
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
        bound = where.bound(sock.getsockname())
    except OSError as error:
        sock.close()
        raise where.refused(error) from None
    receiver = Receiver(sock, buffer, None)
    return Listener(bound, name, size, receiver, coding.decoder(receiver.opened_ns), coding.period, *times)


def _connected(
    where: Address, name: str, size: tuple[int, int] | None, buffer: int, times: tuple[float, float, float]
) -> Listener:
    """A listener to a server of AEDAT 4."""

    def connect() -> tuple[socket.socket, Any]:
        sock = where.new_socket()
        try:
            sock.settimeout(_CONNECT_S)
            sock.connect(where.place)
            return sock, received_header(sock, where.url)
        except BaseException:
            sock.close()
            raise

    def again() -> socket.socket | None:
        try:
            sock, (other, *rest) = connect()
        except (OSError, ModelError):
            return None
        if (other.compression, *rest) == (header.compression, number, found):
            return sock
        sock.close()
        return None

    try:
        sock, (header, number, found) = connect()
    except OSError as error:
        raise where.refused(error) from None
    try:
        if size is not None and size != found:
            said, given = ("{}x{}".format(*each) for each in (found, size))
            raise ModelError(f"{where.url}: sends events of a {said} sensor: expected {given}")
        decoder = PacketDecoder(header.compression, number, lambda: receiver.hang_up())
    except Damage as damage:
        sock.close()
        raise ModelError(f"{where.url}: {damage.what}") from None
    except ModelError:
        sock.close()
        raise
    receiver = Receiver(sock, buffer, again)
    return Listener(where.url, name, found, receiver, decoder, 0, *times)


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
