"""Events that are sent by the network, at their own pace."""

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
from neuro_events.streams._codings import CODINGS, Address, Coding, address, format_for, sent_packets

TICK = 0.001
"""Events whose time has come are sent so often, s."""
MOST = 1 << 16
"""Events that are encoded at once, at most."""
_LARGEST = 65_507
"""Bytes that a datagram can have."""
_STUCK_S = 5.0
"""A receiver that takes nothing for so long is left, s."""
_WHOLE = (Events, Event, np.ndarray, list, tuple)
"""Events in memory."""


@dataclass(frozen=True, slots=True)
class Sent:
    """What was sent.

    Attributes:
        events: that were sent.
        datagrams: in which they were sent; by TCP, packets to each receiver.
        seconds: from the first to the last.
        latest_ms: by how much the latest event was late.
    """

    events: int
    datagrams: int
    seconds: float
    latest_ms: float


class Datagrams:
    """UDP."""

    def __init__(self, where: Address, coding: Coding, size: int) -> None:
        self.url, self._where, self._coding, self._size = where.url, where, coding, size
        self._sock, self._encode = where.new_socket(), coding.encoder()
        self._checked: tuple[int, int] | None = None

    def put(self, events: Events) -> int:
        """Send events."""
        if events.sensor_size != self._checked:
            self._coding.check(events.sensor_size)
            self._checked = events.sensor_size
        count = 0
        for data in self._encode(events, self._size):
            try:
                self._sock.sendto(data, self._where.place)
            except OSError as error:
                raise self._where.refused(error) from None
            count += 1
        return count

    def close(self) -> None:
        """Close the socket."""
        self._sock.close()


class Server:
    """TCP: AEDAT 4 for whoever connects; what is sent before is not kept."""

    def __init__(self, where: Address) -> None:
        self._server, self._readers = where.new_socket(), dict[socket.socket, bool]()
        try:
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(where.place)
            self._server.listen()
        except OSError as error:
            self._server.close()
            raise where.refused(error) from None
        self.url = where.bound(self._server.getsockname())

    def wait(self) -> None:
        """Wait until somebody has connected."""
        self._server.settimeout(None)
        self._readers[self._server.accept()[0]] = False

    def put(self, events: Events) -> int:
        """Send events to all that have connected; one that is gone, or takes nothing, is left."""
        self._server.settimeout(0.0)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._readers[self._server.accept()[0]] = False
        data = sent_packets(events)
        for reader, begun in list(self._readers.items()):
            try:
                reader.settimeout(_STUCK_S)
                reader.sendall(data if begun else new_header(0, *events.sensor_size) + data)
                self._readers[reader] = True
            except OSError:
                reader.close()
                del self._readers[reader]
        return len(self._readers)

    def close(self) -> None:
        """Close all connections."""
        for each in (self._server, *self._readers):
            each.close()


Channel = Datagrams | Server


def channel(url: str, format: str | None, datagram: int | None) -> Channel:
    """Open an address for sending; see `send`."""
    where = address(url)
    name = format_for(where.scheme, format, CODINGS)
    if where.scheme == "tcp":
        if datagram is not None:
            raise ModelError(f"datagram = {datagram!r:.40}: expected None, as {where.url} has none")
        return Server(where)
    if where.place[1] == 0:
        raise ModelError(f"{url}: found port 0: expected the port at which somebody listens")
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
    """Send events by the network, each at its time.

    Args:
        url: ``udp://HOST:PORT``, where somebody listens. Or ``tcp://HOST:PORT``, an address of this machine at which
            AEDAT 4 is served, as dv-processing serves it; sending begins when the first receiver has connected.
        events: the path of a recording, `Events`, or an iterable of parts in the order of time, which may be a stream.
        format: as for `listen`. By TCP "aedat4". "spif" has no times, which the receiver then takes; "spif-timed" has.
        speed: how many times as fast as they were recorded; infinite: as fast as it goes.
        datagram: bytes of a datagram at most; None: 512 for SPIF, as aestream, else 1,400.
        report: called with the number of events sent so far.

    Raises:
        ModelError: the address or the format is none, or the format cannot hold the sensor or a time.
        EventFileError: the recording cannot be read.
    """
    speed = argument("speed", speed, above=0, infinite=True)
    if report is not None and not callable(report):
        raise ModelError(f"report = {report!r:.60}: expected a function of the number of events")
    parts = stream(events) if isinstance(events, str | os.PathLike) else _parts(events)
    to = channel(url, format, datagram)
    try:
        if isinstance(to, Server):
            to.wait()
        return paced(parts, to, speed, report)
    finally:
        to.close()


def _parts(events: Any) -> Iterable[Events]:
    given = iter(events) if isinstance(events, Iterable) and not isinstance(events, _WHOLE) else events
    return played(given).parts()


def paced(parts: Iterable[Events], to: Channel, speed: float, report: Callable[[int], None] | None = None) -> Sent:
    """Put each event when its time has come; see `send`."""
    events = datagrams = 0
    latest, begin, zero = 0.0, time.monotonic(), None
    for part in parts:
        if zero is None and len(part):
            zero, begin = int(part.t[0]), time.monotonic()
        for due, piece in _due(part, zero or 0, begin, speed):
            if len(piece):
                datagrams += to.put(piece)
                latest = max(latest, time.monotonic() - due)
        events += len(part)
        if report is not None:
            report(events)
    late = 0.0 if math.isinf(speed) else 1000.0 * latest
    return Sent(events, datagrams, time.monotonic() - begin, late)


def _due(part: Events, zero: int, begin: float, speed: float) -> Iterator[tuple[float, Events]]:
    """Pieces of a part as their time comes, each with the time at which its first event was due."""
    done = 0
    while done < len(part):
        now = time.monotonic()
        end = len(part)
        due = begin + (int(part.t[done]) - zero) / 1e6 / speed
        if not math.isinf(speed):
            if due > now:
                time.sleep(max(due - now, TICK))
                continue
            end = int(np.searchsorted(part.t, zero + int((now - begin) * speed * 1e6), "right"))
        end = min(max(end, done + 1), done + MOST)
        yield due, part[done:end]
        done = end
