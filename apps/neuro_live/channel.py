"""Messages between the process that runs a network and the one that serves its page: a head of JSON, and bytes.

The process of the network never waits for the other: what the socket does not take stays in a queue, and what it has
not sent is not read.
"""

from __future__ import annotations

import json
import socket
from collections import deque
from collections.abc import Iterator
from struct import Struct
from typing import Any

SIZES = Struct("<II")
"""Before each message: the bytes of its head, and those that follow it."""
_READ = 1 << 16

Head = dict[str, Any]


def packed(head: Head, body: bytes = b"") -> bytes:
    """A message as bytes."""
    text = json.dumps(head, separators=(",", ":")).encode()
    return SIZES.pack(len(text), len(body)) + text + body


class Channel:
    """The end of the network's process.

    Args:
        end: of a pair of sockets.

    Attributes:
        open: whether the other process is there.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self._out: deque[memoryview] = deque()
        self._in = bytearray()
        self.open = True

    @property
    def idle(self) -> bool:
        """Whether all was sent."""
        return not self._out

    def send(self, head: Head, body: bytes = b"") -> None:
        """Send as much as the socket takes; the rest follows with `flush`."""
        self._out.append(memoryview(packed(head, body)))
        self.flush()

    def flush(self) -> None:
        """Send more of what waits."""
        while self._out:
            message = self._out[0]
            try:
                sent = self._end.send(message)
            except BlockingIOError:
                return
            except OSError:
                self.open = False
                self._out.clear()
                return
            if sent < len(message):
                self._out[0] = message[sent:]
            else:
                self._out.popleft()

    def receive(self) -> Iterator[Head]:
        """The heads of the messages that have come, without waiting."""
        try:
            data = self._end.recv(_READ)
            self.open = bool(data)
        except BlockingIOError:
            return
        except OSError:
            self.open = False
            return
        self._in += data
        while len(self._in) >= SIZES.size:
            head, body = SIZES.unpack_from(self._in)
            end = SIZES.size + head + body
            if len(self._in) < end:
                return
            text = bytes(self._in[SIZES.size : SIZES.size + head])
            del self._in[:end]
            yield json.loads(text)

    def close(self) -> None:
        """Close the socket, by which the other process ends."""
        self.open = False
        self._end.close()
