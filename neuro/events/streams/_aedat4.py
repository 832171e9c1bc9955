"""AEDAT 4 as dv-processing sends it by TCP: the header of a file without the line before it, then packets.

Source: `NetworkWriter` and `NetworkReader` of dv-processing 2.0.
"""

from __future__ import annotations

import socket
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.events._events import Columns, Events, empty_columns, joined_columns
from neuro.events.formats._aedat4_packet import U32, Malformed, Packets
from neuro.events.formats._format import Damage
from neuro.events.formats.aedat4 import ENTRY, HEADER_LIMIT, PACKET, Header, new_header, packet, read_header

_LARGEST = 1 << 24
"""No packet is longer; a damaged length must not fill the memory."""


def received_header(sock: socket.socket, url: str) -> tuple[Header, int, tuple[int, int]]:
    """Read the header of a connection: it, the number of its stream of events, and the sensor.

    Raises:
        ModelError: this is no header, or lists no events.
        OSError: it does not come.
    """
    size = U32.unpack(_exactly(sock, 4, url))[0]
    if size > HEADER_LIMIT:
        raise ModelError(f"{url}: does not send AEDAT 4: its header would have {size} bytes")
    try:
        header = read_header(_exactly(sock, size, url))
        for number, stream in header.streams.items():
            if stream["type"] == "events" and "width" in stream:
                return header, number, (stream["width"], stream["height"])
    except Malformed as error:
        raise ModelError(f"{url}: does not send AEDAT 4: {error}") from None
    raise ModelError(f"{url}: sends no events: expected a stream of type EVTS with a sensor")


def _exactly(sock: socket.socket, count: int, url: str) -> bytes:
    found = b""
    while len(found) < count:
        more = sock.recv(count - len(found))
        if not more:
            raise ModelError(f"{url}: does not send AEDAT 4: the connection ended within its header")
        found += more
    return found


class PacketDecoder:
    """Decodes the bytes of connections as they come; see `neuro.events.streams._codings.Decoder`.

    Args:
        compression: of the packets, as the header says.
        wanted: number of the stream of events.
        broken: called where bytes are no packets; what follows is left out up to the next connection.
    """

    def __init__(self, compression: str, wanted: int, broken: Callable[[], None]) -> None:
        from neuro.events.formats._aedat4_kernels import split

        self._packets, self._wanted, self._broken, self._split = Packets(compression), wanted, broken, split
        self._held = bytearray()
        self._lost = False

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        from neuro.events.streams._ring_kernel import EVENTS, SIZE, START

        parts: list[Columns] = []
        damaged = n = 0
        for entry in range(first, last):
            row, had = index[entry % len(index)], len(parts)
            start, size = row[[START, SIZE]].tolist()
            if not size:
                damaged += bool(self._held)
                self._held.clear()
                self._lost = False
            elif not self._lost:
                self._held += ring[start : start + size].data
                try:
                    self._take(parts)
                except Damage:
                    damaged += 1
                    self._lost = True
                    self._held.clear()
                    self._broken()
            n += sum(len(each[0]) for each in parts[had:])
            row[EVENTS] = n
        columns = parts[0] if len(parts) == 1 else joined_columns(parts)
        return n, columns, damaged

    def _take(self, parts: list[Columns]) -> None:
        """Take all whole packets."""
        at = 0
        try:
            while len(self._held) - at >= ENTRY.size:
                stream, size = ENTRY.unpack_from(self._held, at)
                if not 0 <= size <= _LARGEST:
                    raise Damage(f"a packet of {size} bytes", None)
                end = at + ENTRY.size + size
                if len(self._held) < end:
                    return
                if stream == self._wanted:
                    parts.append(self._events(np.frombuffer(self._held[end - size : end], np.uint8)))
                at = end
        finally:
            del self._held[:at]

    def _events(self, data: NDArray[np.uint8]) -> Columns:
        plain, start, count = self._packets.events(data, 0)
        columns = empty_columns(count)
        self._split(np.frombuffer(plain, np.uint8), start, count, 0, *columns)
        return columns


def sent_header(sensor: tuple[int, int]) -> bytes:
    """What a connection begins with."""
    return new_header(0, *sensor)


def sent_packets(events: Events) -> bytes:
    """Events as packets."""
    parts = [packet(events[k : k + PACKET]) for k in range(0, len(events), PACKET)]
    return b"".join(ENTRY.pack(0, len(data)) + data for data in parts)
