"""Addresses and codings of streams: formats of datagrams, and packets of AEDAT 4 over TCP."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import CLOSED, LazyModule, unknown
from neuro_events._events import Columns, Events, empty_columns, joined_columns
from neuro_events.formats._format import Damage
from neuro_events.formats._words import Field, Layout, Odd, encoded, first_state
from neuro_events.formats.aedat4 import (
    ENTRY,
    HEADER_LIMIT,
    PACKET,
    U32,
    Header,
    Malformed,
    Packets,
    packet,
    read_header,
)

aedat4_kernels = LazyModule("neuro_events.formats._aedat4_kernels")
evt_kernels = LazyModule("neuro_events.formats._evt_kernels")
kernels = LazyModule("neuro_events.streams._kernels")

SCHEMES = ("udp", "tcp")


@dataclass(frozen=True, slots=True)
class Address:
    """A URL of a stream, with the address of its host.

    Attributes:
        url: the URL as specified.
        scheme: udp or tcp.
        family: family of its sockets.
        place: host and port, as sockets expect them.
    """

    url: str
    scheme: str
    family: socket.AddressFamily
    place: Any

    def new_socket(self) -> socket.socket:
        """Return a new socket for this address."""
        return socket.socket(self.family, socket.SOCK_DGRAM if self.scheme == "udp" else socket.SOCK_STREAM)

    def bound_url(self, place: Any) -> str:
        """Return the URL with the port of a bound socket."""
        host = f"[{place[0]}]" if self.family == socket.AF_INET6 else place[0]
        return f"{self.scheme}://{host}:{place[1]}"

    def as_model_error(self, error: OSError) -> ModelError:
        """Convert an error of a socket to an error about this address."""
        advice = "ports below 1024 are for administrators; use a higher one, such as 3333"
        messages = {
            errno.EADDRINUSE: ("another program listens at this port", "port 0 selects a free one"),
            errno.EACCES: ("this user may not use this port", advice if self.place[1] < 1024 else ""),
            errno.EADDRNOTAVAIL: ("no interface of this machine has this address", "0.0.0.0 stands for all interfaces"),
            errno.ECONNREFUSED: ("no program listens at this port", "start the sender first"),
        }
        text, hint = messages.get(error.errno or 0, (error.strerror or str(error) or type(error).__name__, ""))
        return ModelError(f"{self.url}: {text}", hint=hint)


def parse_url(url: object) -> tuple[str, str, int]:
    """Return scheme, host and port of a URL such as udp://127.0.0.1:3333 or tcp://[::1]:7777.

    Raises:
        ModelError: the URL is invalid.
    """
    expected = "expected udp://HOST:PORT or tcp://HOST:PORT, such as udp://127.0.0.1:3333"
    if not isinstance(url, str):
        raise ModelError(f"url = {url!r:.60}: {expected}")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    else:
        if parts.scheme and parts.scheme not in SCHEMES and "://" in url:
            raise unknown("kind of stream", parts.scheme, SCHEMES)
    if host is None or port is None or parts.path.strip("/") or parts.query or parts.fragment or parts.username:
        raise ModelError(f"url = {url!r:.80}: {expected}")
    return parts.scheme, host, port


def address(url: str) -> Address:
    """Parse a URL, and look up its host.

    Raises:
        ModelError: the URL is invalid, or its host is unknown.
    """
    scheme, host, port = parse_url(url)
    if os.environ.get(CLOSED):
        raise ModelError(f"{url}: streams cannot be opened while a file is reproduced")
    kind = socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM
    try:
        family, _, _, _, place = socket.getaddrinfo(host, port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise ModelError(f"{url}: unknown host '{host}' ({getattr(error, 'strerror', '') or error})") from None
    return Address(url, scheme, family, place)


def format_for(scheme: str, format: object, udp_formats: Iterable[str]) -> str:
    """Return the format of a stream: "aedat4" for TCP, the specified format for UDP.

    Raises:
        ModelError: unknown format, or a format of the other scheme.
    """
    udp_names = tuple(udp_formats)
    names = ("aedat4",) if scheme == "tcp" else udp_names
    if format is None:
        if scheme == "tcp":
            return "aedat4"
        raise ModelError(f"format is missing: expected one of {', '.join(names)}")
    if not isinstance(format, str) or format not in names:
        if isinstance(format, str) and format in ("aedat4", *udp_names):
            required = "tcp" if scheme == "udp" else "udp"
            raise ModelError(f"format '{format}' requires {required}://: found {scheme}://")
        raise unknown("format of a stream", format, names)
    return str(format)


DATAGRAM = 1400
"""Default size limit of a datagram, bytes; a usual Ethernet frame carries 1,472."""


Decoder = Callable[[NDArray[np.uint8], NDArray[np.int64], int, int], tuple[int, Columns, int]]
"""Decoder of received datagrams: (ring, index, first, last) -> (number n of events, columns, number of damages).

A `Receiver` stores each datagram as an entry of its ring. The decoder reads the entries first to last - 1. The events
are the first n rows of the columns; the columns may be longer."""

Encoder = Callable[[Events, int], Iterator[Any]]
"""Encoder: (events, size limit in bytes) -> datagrams. Called with the parts of one recording in order."""


@dataclass(frozen=True, slots=True)
class Coding:
    """A format of events in datagrams.

    Attributes:
        name: value of the option `format`.
        title: description.
        decoder: function that creates a decoder for a stream opened at a time, ns.
        encoder: function that creates an encoder.
        period: time after which the clock of the format wraps, us; 0: never.
        sides: largest width and largest height of a sensor, px.
        datagram: default size limit of a datagram, bytes.
    """

    name: str
    title: str
    decoder: Callable[[int], Decoder]
    encoder: Callable[[], Encoder]
    period: int
    sides: int
    datagram: int = DATAGRAM

    def check(self, sensor: tuple[int, int]) -> None:
        """Check that the format can represent the positions of a sensor.

        Raises:
            ModelError: the sensor is too wide or too high.
        """
        if max(sensor) > self.sides:
            size = "{}x{}".format(*sensor)
            raise ModelError(f"format '{self.name}': found a sensor of {size} px: expected at most {self.sides} a side")


@dataclass(slots=True)
class _LayoutDecoder:
    """Decoder of datagrams with events of a layout. An event has at least `least` bytes."""

    layout: Layout
    least: int
    opened_ns: int
    state: NDArray[np.int64] = field(default_factory=first_state)

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        columns = empty_columns(int(_sizes(index, first, last).sum()) // self.least + 1)
        decode = (kernels.plain_decoder if self.least == self.layout.size else kernels.spif_decoder)(self.layout)
        n, damaged = decode(ring, index, first, last, self.opened_ns, self.state, *columns)
        return n, columns, damaged


def _sizes(index: NDArray[np.int64], first: int, last: int) -> NDArray[np.int64]:
    """Return the sizes of entries, bytes."""
    begin, count, m = first % len(index), last - first, len(index)
    sizes = index[:, kernels.SIZE]
    if begin + count <= m:
        return sizes[begin : begin + count]
    return np.concatenate((sizes[begin:], sizes[: begin + count - m]))


class _Evt3:
    """Decoder of EVT 3.0."""

    def __init__(self, opened_ns: int) -> None:
        from neuro_events.formats.evt import evt3_decoder

        initial = evt3_decoder().state
        self._state = np.zeros(kernels.STATES, np.int64)
        self._state[: initial.size] = initial

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        words = ring.view("<u2")
        columns = empty_columns(kernels.capacity_evt3(words, index, first, last))
        n, damaged = kernels.decode_evt3(words, index, first, last, self._state, *columns)
        return n, columns, damaged


def _cut(records: NDArray[Any], size: int) -> Iterator[Any]:
    """Split records into datagrams of complete records."""
    step = max(1, size // records.itemsize)
    for k in range(0, len(records), step):
        yield records[k : k + step].data.cast("B")


SPIF = Layout(8, t=Field(0, 32, byte=4), x=Field(16, 15), y=Field(0, 15), p=Field(15, 1))
"""Layout of an event of SPIF with its time."""
FAERY_13 = Layout(
    13, t=Field(0, 64, size=8), x=Field(0, 16, byte=8), y=Field(16, 16, byte=8), p=Field(0, 1, byte=12, size=1),
    odd=Odd(0xFE << 56 | 3 << 22, byte=5, size=8),
)  # fmt: skip
"""Layout of faery's events.

`odd` tests the bits that are 0 in each valid event: the upper two bits of the time, and all bits of the polarity but
the lowest. The word of 8 bytes at byte 5 contains them all."""
FAERY_8 = Layout(8, t=Field(0, 32), x=Field(0, 16, byte=4), y=Field(17, 15, byte=4), p=Field(16, 1, byte=4))


def _spif(events: Events, size: int, timed: bool) -> Iterator[Any]:
    if timed:
        return _cut(encoded(SPIF, events).view("V8")[:, 0], size)
    words = encoded(SPIF._replace(size=4, t=Field(0, 0)), events).view("<u4")
    return _cut(words[:, 0] | np.uint32(1 << 31), size)


def _faery13(events: Events, size: int) -> Iterator[Any]:
    if len(events) and events.t[0] < 0:
        raise ModelError(f"format 'faery13': found an event at {events.t[0]} us: expected times from 0 us on")
    return _cut(events.records().view("V13"), size)


def _faery8(events: Events, size: int) -> Iterator[Any]:
    return _cut(encoded(FAERY_8, events).view("V8")[:, 0], size)


_PERIOD_3 = 1 << 24
"""Time after which the clock of EVT 3.0 wraps, us."""
_BEAT = 1 << 22
"""Longest time between two TIME_HIGH words of the encoder, us. `_BEAT` is shorter than `_PERIOD_3`, so that a receiver
counts every wrap of the clock."""
_LONGEST = 1 << 32
"""Longest silence, us. A longer silence would need too many TIME_HIGH words."""
_EVENT_BYTES = 8
"""Largest size of an event of `encode3`, bytes: time (two words), row and column."""


def _evt3() -> Encoder:
    """Return an encoder whose datagrams begin with time and row, so that a lost datagram does not affect the others."""
    last: int | None = None

    def encode(events: Events, size: int) -> Iterator[Any]:
        nonlocal last
        after_silence = np.flatnonzero(np.diff(events.t, prepend=events.t[:1]) > _BEAT)
        for begin, end in pairwise([0, *after_silence, len(events)]):
            for k in range(begin, end, max(1, size // _EVENT_BYTES)):
                part = events[k : min(end, k + size // _EVENT_BYTES)]
                first = int(part.t[0])
                if last is not None and first - last > _LONGEST:
                    silence = f"{(first - last) / 1e6:.0f} s without events before {first} us"
                    raise ModelError(f"format 'raw-evt3': found {silence}: expected at most {_LONGEST / 1e6:.0f} s")
                beats = np.arange(first if last is None else last + _BEAT, first, _BEAT) >> 12
                yield from _cut((evt_kernels.TIME_HIGH << 12 | beats & 0xFFF).astype("<u2"), size)
                offsets = part.t - first // _PERIOD_3 * _PERIOD_3
                words = np.empty(4 * len(part) + 2 * (int(offsets[-1]) // _PERIOD_3) + 1, "<u2")
                n = evt_kernels.encode3(offsets, part.x, part.y, part.p, np.full(2, -1, np.int64), words)
                last = int(part.t[-1])
                yield words[:n].data.cast("B")

    return encode


AESTREAM = 512
"""Size limit of datagrams for aestream, bytes; aestream reads only the first 512 bytes of a datagram."""
_PERIOD_32 = 1 << 32

CODINGS = {
    coding.name: coding
    for coding in (
        Coding(
            "spif", "SPIF, words of 32 bits, with times or without; sent without",
            partial(_LayoutDecoder, SPIF, 4), lambda: partial(_spif, timed=False), _PERIOD_32, 1 << 15, AESTREAM,
        ),
        Coding(
            "spif-timed", "SPIF, sent with times: two words of 32 bits",
            partial(_LayoutDecoder, SPIF, 4), lambda: partial(_spif, timed=True), _PERIOD_32, 1 << 15, AESTREAM,
        ),
        Coding(
            "faery13", "faery's t64_x16_y16_on8, 13 bytes",
            partial(_LayoutDecoder, FAERY_13, 13), lambda: _faery13, 0, 1 << 16,
        ),
        Coding(
            "faery8", "faery's t32_x16_y15_on1, 8 bytes",
            partial(_LayoutDecoder, FAERY_8, 8), lambda: _faery8, _PERIOD_32, 1 << 15,
        ),
        Coding("raw-evt3", "Prophesee's EVT 3.0, words of 16 bits", _Evt3, _evt3, 0, 1 << 11),
    )
}  # fmt: skip
"""Formats of datagrams by name."""


_LARGEST = 1 << 24
"""Largest size of a packet, bytes, so that a damaged length cannot fill the memory."""


def receive_header(sock: socket.socket, url: str) -> tuple[Header, int, tuple[int, int]]:
    """Read the header of a connection.

    Returns:
        The header, the number of its stream of events, and the sensor.

    Raises:
        ModelError: the data are not a header, or the header lists no events.
        OSError: the header does not arrive in time.
    """
    size = U32.unpack(_receive_exactly(sock, 4, url))[0]
    if size > HEADER_LIMIT:
        raise ModelError(f"{url}: does not send AEDAT 4: its header would have {size} bytes")
    try:
        header = read_header(_receive_exactly(sock, size, url))
        for number, stream in header.streams.items():
            if stream["type"] == "events" and "width" in stream:
                return header, number, (stream["width"], stream["height"])
    except Malformed as error:
        raise ModelError(f"{url}: does not send AEDAT 4: {error}") from None
    raise ModelError(f"{url}: sends no events: expected a stream of type EVTS with a sensor")


def _receive_exactly(sock: socket.socket, count: int, url: str) -> bytes:
    data = b""
    while len(data) < count:
        chunk = sock.recv(count - len(data))
        if not chunk:
            raise ModelError(f"{url}: does not send AEDAT 4: the connection ended within its header")
        data += chunk
    return data


class PacketDecoder:
    """Decoder of the packets of TCP connections, called as `neuro.events.streams._codings.Decoder`.

    An entry is a received piece of a connection, and may begin or end within a packet. An entry of no bytes marks the
    end of a connection.

    Args:
        compression: compression of the packets, from the header.
        number: number of the stream of events.
        on_damage: called if the bytes are not valid packets. The rest of the connection is skipped.
    """

    def __init__(self, compression: str, number: int, on_damage: Callable[[], None]) -> None:
        self._packets, self._number, self._on_damage = Packets(compression), number, on_damage
        self._buffer = bytearray()
        self._skips_rest = False

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        parts: list[Columns] = []
        damaged = n = 0
        for entry in range(first, last):
            row, n_parts = index[entry % len(index)], len(parts)
            start, size = row[[kernels.START, kernels.SIZE]].tolist()
            if not size:  # the connection ended; bytes that remain are an incomplete packet
                damaged += bool(self._buffer)
                self._buffer.clear()
                self._skips_rest = False
            elif not self._skips_rest:
                self._buffer += ring[start : start + size].data
                try:
                    self._decode_packets(parts)
                except Damage:
                    damaged += 1
                    self._skips_rest = True
                    self._buffer.clear()
                    self._on_damage()
            n += sum(len(part[0]) for part in parts[n_parts:])
            row[kernels.EVENTS] = n
        columns = parts[0] if len(parts) == 1 else joined_columns(parts)
        return n, columns, damaged

    def _decode_packets(self, parts: list[Columns]) -> None:
        """Decode all complete packets in the buffer."""
        at = 0
        try:
            while len(self._buffer) - at >= ENTRY.size:
                stream, size = ENTRY.unpack_from(self._buffer, at)
                if not 0 <= size <= _LARGEST:
                    raise Damage(f"a packet of {size} bytes", None)
                end = at + ENTRY.size + size
                if len(self._buffer) < end:
                    return
                if stream == self._number:
                    parts.append(self._events(np.frombuffer(self._buffer[end - size : end], np.uint8)))
                at = end
        finally:
            del self._buffer[:at]

    def _events(self, data: NDArray[np.uint8]) -> Columns:
        plain, start, count = self._packets.events(data, 0)
        columns = empty_columns(count)
        aedat4_kernels.split(np.frombuffer(plain, np.uint8), start, count, 0, *columns)
        return columns


def encode_packets(events: Events) -> bytes:
    """Encode events as packets of AEDAT 4."""
    parts = [packet(events[k : k + PACKET]) for k in range(0, len(events), PACKET)]
    return b"".join(ENTRY.pack(0, len(data)) + data for data in parts)
