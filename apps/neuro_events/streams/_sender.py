"""Send events over the network in real time."""

from __future__ import annotations

import contextlib
import math
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import argument
from neuro_events._events import Event, Events
from neuro_events.files import stream
from neuro_events.formats.aedat4 import new_header
from neuro_events.playing import played
from neuro_events.streams._codings import CODINGS, Address, Coding, address, encode_packets, format_for

TICK = 0.001
"""Time between two sends, s."""
MOST = 1 << 16
"""Largest number of events that are encoded at a time."""
_LARGEST = 65_507
"""Largest size of a UDP datagram, bytes."""
_STUCK_S = 5.0
"""Longest time that a receiver may block, s, before its connection is closed."""
_IN_MEMORY = (Events, Event, np.ndarray, list, tuple)
"""Types of events in memory."""


@dataclass(frozen=True, slots=True)
class Sent:
    """Result of `send`.

    Attributes:
        events: number of events sent.
        datagrams: number of datagrams sent; for TCP, the number of sends, each counted once for each receiver.
        seconds: duration from the first to the last event sent, s.
        latest_ms: largest delay of an event, ms.
    """

    events: int
    datagrams: int
    seconds: float
    latest_ms: float


class Datagrams:
    """Channel that sends datagrams over UDP."""

    def __init__(self, where: Address, coding: Coding, size: int) -> None:
        self.url, self._where, self._coding, self._size = where.url, where, coding, size
        self._sock, self._encode = where.new_socket(), coding.encoder()
        self._checked: tuple[int, int] | None = None

    def put(self, events: Events) -> int:
        """Send events, and return the number of datagrams."""
        if events.sensor_size != self._checked:
            self._coding.check(events.sensor_size)
            self._checked = events.sensor_size
        count = 0
        for data in self._encode(events, self._size):
            try:
                self._sock.sendto(data, self._where.place)
            except OSError as error:
                raise self._where.as_model_error(error) from None
            count += 1
        return count

    def close(self) -> None:
        """Close the socket."""
        self._sock.close()


class Server:
    """Channel that serves AEDAT 4 over TCP. A receiver gets the events sent after it has connected."""

    def __init__(self, where: Address) -> None:
        self._server, self._readers = where.new_socket(), dict[socket.socket, bool]()
        try:
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(where.place)
            self._server.listen()
        except OSError as error:
            self._server.close()
            raise where.as_model_error(error) from None
        self.url = where.bound_url(self._server.getsockname())

    def wait(self) -> None:
        """Wait for the first receiver."""
        self._server.settimeout(None)
        self._readers[self._server.accept()[0]] = False

    def put(self, events: Events) -> int:
        """Send events to all receivers, and return the number of receivers. A receiver that blocks is disconnected."""
        self._server.settimeout(0.0)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._readers[self._server.accept()[0]] = False
        data = encode_packets(events)
        for reader, has_header in list(self._readers.items()):
            try:
                reader.settimeout(_STUCK_S)
                reader.sendall(data if has_header else new_header(0, *events.sensor_size) + data)
                self._readers[reader] = True
            except OSError:
                reader.close()
                del self._readers[reader]
        return len(self._readers)

    def close(self) -> None:
        """Close the server and all connections."""
        for sock in (self._server, *self._readers):
            sock.close()


Channel = Datagrams | Server


def channel(url: str, format: str | None, datagram: int | None) -> Channel:
    """Open a channel to an address; see `send`."""
    where = address(url)
    name = format_for(where.scheme, format, CODINGS)
    if where.scheme == "tcp":
        if datagram is not None:
            raise ModelError(f"datagram = {datagram!r:.40}: expected None, as {where.url} uses no datagrams")
        return Server(where)
    if where.place[1] == 0:
        raise ModelError(f"{url}: found port 0: expected the port at which the receiver listens")
    coding = CODINGS[name]
    size = coding.datagram if datagram is None else argument("datagram", datagram, kind="integer", at_least=16)
    if size > _LARGEST:
        raise ModelError(f"datagram = {size}: expected at most {_LARGEST} bytes")
    return Datagrams(where, coding, size)


def send(
    url: str,
    events: Any,
    *,
    format: str | None = None,
    speed: float = 1.0,
    datagram: int | None = None,
    report: Callable[[int], None] | None = None,
) -> Sent:
    """Send events over the network in real time.

    Args:
        url: ``udp://HOST:PORT``, the address of a receiver. Or ``tcp://HOST:PORT``, an address of this machine that
            serves AEDAT 4 as dv-processing does; sending begins when the first receiver connects.
        events: path of a recording, ``Events``, or an iterable of parts in the order of time, which may be a stream.
        format: see `listen`. For TCP the format is "aedat4". "spif" contains no times, so the receiver uses the time of
            receipt; "spif-timed" contains times.
        speed: speed relative to real time; infinite: as fast as possible.
        datagram: size limit of a datagram, bytes. None: 512 for SPIF, as in aestream, else 1,400.
        report: called with the number of events sent so far.

    Raises:
        ModelError: the address or the format is invalid, or the format cannot represent the sensor or a time.
        EventFileError: the recording cannot be read.
    """
    speed = argument("speed", speed, above=0, infinite=True)
    if report is not None and not callable(report):
        raise ModelError(f"report = {report!r:.60}: expected a function of the number of events")
    parts = stream(events) if isinstance(events, str | os.PathLike) else _parts(events)
    sink = channel(url, format, datagram)
    try:
        if isinstance(sink, Server):
            sink.wait()
        return paced(parts, sink, speed, report)
    finally:
        sink.close()


def _parts(events: Any) -> Iterable[Events]:
    is_iterable = isinstance(events, Iterable) and not isinstance(events, _IN_MEMORY)
    return played(iter(events) if is_iterable else events).parts()


def paced(parts: Iterable[Events], sink: Channel, speed: float, report: Callable[[int], None] | None = None) -> Sent:
    """Send each event at its time; see `send`."""
    events = datagrams = 0
    latest, begin, zero = 0.0, time.monotonic(), None
    for part in parts:
        if zero is None and len(part):
            zero, begin = int(part.t[0]), time.monotonic()
        for send_at, piece in _timed_pieces(part, zero or 0, begin, speed):
            if len(piece):
                datagrams += sink.put(piece)
                latest = max(latest, time.monotonic() - send_at)
        events += len(part)
        if report is not None:
            report(events)
    latest_ms = 0.0 if math.isinf(speed) else 1000.0 * latest
    return Sent(events, datagrams, time.monotonic() - begin, latest_ms)


def _timed_pieces(part: Events, zero: int, begin: float, speed: float) -> Iterator[tuple[float, Events]]:
    """Cut a part into pieces. At the time of a piece's first event, yield this time, s, and the piece.

    Args:
        part: events.
        zero: time of the recording's first event, us.
        begin: time at which the recording's first event is sent, by `time.monotonic`, s.
        speed: speed relative to real time.
    """
    first = 0
    while first < len(part):
        now = time.monotonic()
        end = len(part)
        send_at = begin + (int(part.t[first]) - zero) / 1e6 / speed
        if not math.isinf(speed):
            if send_at > now:
                time.sleep(max(send_at - now, TICK))
                continue
            end = int(np.searchsorted(part.t, zero + int((now - begin) * speed * 1e6), "right"))
        end = min(max(end, first + 1), first + MOST)
        yield send_at, part[first:end]
        first = end
