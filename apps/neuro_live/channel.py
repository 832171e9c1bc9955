"""Messages between the process that runs a network and the process that serves its page: a JSON head and bytes.

The process of the network never blocks. Bytes that the socket does not accept stay in a queue, and a message is read
only when it has arrived completely.
"""

from __future__ import annotations

import json
import socket
from collections import deque
from collections.abc import Iterator
from struct import Struct
from typing import Any

SIZES = Struct("<II")
"""Header of a message: the size of the head and of the body in bytes."""
_READ = 1 << 16

Head = dict[str, Any]


def packed(head: Head, body: bytes = b"") -> bytes:
    """Serialise a message."""
    text = json.dumps(head, separators=(",", ":")).encode()
    return SIZES.pack(len(text), len(body)) + text + body


class Channel:
    """The endpoint in the network's process.

    Args:
        end: one end of a pair of sockets.

    Attributes:
        open: whether the other process is running.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self._out: deque[memoryview] = deque()
        self._in = bytearray()
        self.open = True

    @property
    def idle(self) -> bool:
        """Whether the queue of unsent messages is empty."""
        return not self._out

    def send(self, head: Head, body: bytes = b"") -> None:
        """Send as much as the socket accepts; `flush` sends the rest."""
        self._out.append(memoryview(packed(head, body)))
        self.flush()

    def flush(self) -> None:
        """Send as much of the queue as the socket accepts."""
        while self._out:
            message = self._out[0]
            try:
                n_bytes = self._end.send(message)
            except BlockingIOError:
                return
            except OSError:
                self.open = False
                self._out.clear()
                return
            if n_bytes < len(message):
                self._out[0] = message[n_bytes:]
            else:
                self._out.popleft()

    def receive(self) -> Iterator[Head]:
        """Yield the heads of the messages that have arrived, without waiting."""
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
        """Close the socket; the other process then exits."""
        self.open = False
        self._end.close()
