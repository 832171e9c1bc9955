"""A thread that receives from a socket into a ring of bytes."""

from __future__ import annotations

import ctypes
import os
import select
import socket
import struct
import sys
import threading
import time
from bisect import bisect_left
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import LazyModule

kernels = LazyModule("neuro_events.streams._kernels")

ENTRIES = 1 << 16
"""Datagrams that wait at most."""
LEAST = 1 << 18
"""Bytes of the smallest ring: it has room for four of the largest datagrams."""
PATIENCE = 0.02
"""Time after which a call that receives nothing comes back, s; so long closing may take."""
QUEUE = 1 << 25
"""Bytes that the kernel is asked to queue; it grants up to its own limit (Linux: sysctl net.core.rmem_max)."""
_OVERFLOW, _MEMINFO = 40, 55
"""Options of sockets in Linux: SO_RXQ_OVFL, SO_MEMINFO."""
_NUMBERS = struct.Struct("=9I")
"""Of SO_MEMINFO; the last counts the datagrams for which the queue had no room (SK_MEMINFO_DROPS)."""


class Receiver:
    """Receives until it is closed. One thread, always the same, may take.

    Args:
        sock: a socket that is bound or connected; it is closed with this.
        buffer: bytes of the ring.
        again: makes a new connection, None if there is none yet; called when one has ended. Without it the socket
            is one of datagrams.

    Attributes:
        ring: the bytes.
        index: (`ENTRIES`, FIELDS) int64, entries in a ring; see `_kernels`.
        connections: how often a connection was made anew.
        opened_ns: when it began to receive, by `time.monotonic_ns`.
    """

    def __init__(self, sock: socket.socket, buffer: int, again: Callable[[], socket.socket | None] | None) -> None:
        self._sock, self._again = sock, again
        self.ring: NDArray[np.uint8] = np.empty(buffer + kernels.LARGEST, np.uint8)
        self.index = np.zeros((ENTRIES, kernels.FIELDS), np.int64)
        self._state = np.zeros((kernels.ROWS, 8), np.int64)
        self._message = np.zeros(kernels.WORDS, np.int64)
        self._calls = _calls()
        self._read, self._wake = os.pipe()
        for end in (self._read, self._wake):
            os.set_blocking(end, False)
        self.connections = 0
        self._prepare(sock)
        self._state[kernels.STOP] = 1
        self._receive()  # compiles it
        self._state[kernels.STOP] = 0
        self.opened_ns = int(time.monotonic_ns())
        self._state[kernels.LAST] = self.opened_ns
        self._overflown = 0
        self._poll = select.poll()
        self._poll.register(self._read, select.POLLIN)
        self._thread = threading.Thread(target=self._run, name="neuro.events.listen", daemon=True)
        self._thread.start()

    def _prepare(self, sock: socket.socket) -> None:
        sock.settimeout(None)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUE)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, round(PATIENCE * 1e6)))
        if self._again is None and sys.platform == "linux":
            sock.setsockopt(socket.SOL_SOCKET, _OVERFLOW, 1)

    def _receive(self) -> int:
        words = self._calls, self._sock.fileno(), self._wake, self._again is None
        return int(kernels.receive(*words, self.ring, self.index, self._state, self._message))

    def _run(self) -> None:
        while not self.closed:
            got = self._receive()
            if got == 0 and self._again is not None:
                self._connect()
            else:  # no room by TCP, or an error
                time.sleep(0.001)

    def _connect(self) -> None:
        """Connect anew, with an entry of no bytes between the two connections."""
        assert self._again is not None
        self._sock.close()
        while not self._state[kernels.STOP, 0] and not kernels.end_entry(self.index, self._state):
            time.sleep(0.001)
        while not self._state[kernels.STOP, 0]:
            sock = self._again()
            if sock is not None:
                self._sock = sock
                self._prepare(sock)
                self.connections += 1
                return
            time.sleep(0.05)

    @property
    def entries(self) -> tuple[int, int]:
        """Numbers of the first entry that waits, and of the one after the last."""
        return int(self._state[kernels.TAKEN, 0]), int(kernels.arrived(self._state))

    def received(self, entry: int) -> int:
        """When an entry that waits came, by `time.monotonic_ns`."""
        return int(self.index[entry % ENTRIES, kernels.RECEIVED])

    def before(self, ns: int) -> int:
        """The number after the last entry that waits and came before a time of `time.monotonic_ns`."""
        first, last = self.entries
        return first + bisect_left(range(first, last), ns, key=self.received)

    def release(self, taken: int) -> None:
        """Give back the room of all entries before a number."""
        kernels.release(self._state, taken)

    def wait(self, timeout_s: float) -> bool:
        """Wait for an entry; whether there is one."""
        deadline = time.monotonic() + timeout_s
        while True:
            first, last = self.entries
            left = deadline - time.monotonic()
            if last > first or left <= 0 or self.closed:
                return last > first
            if self._poll.poll(min(left, 3600.0) * 1000.0):
                os.read(self._read, 1 << 16)

    @property
    def last_ns(self) -> int:
        """When something was received last, or when it began to receive, by `time.monotonic_ns`."""
        return int(self._state[kernels.LAST, 0])

    @property
    def refused(self) -> int:
        """Datagrams for which the ring had no room."""
        return int(self._state[kernels.REFUSED, 0])

    @property
    def overflown(self) -> int | None:
        """Datagrams for which the kernel's queue had no room, None where the system does not count them."""
        if self._again is not None:
            return 0
        if sys.platform != "linux":
            return None
        if not self.closed:
            packed = self._sock.getsockopt(socket.SOL_SOCKET, _MEMINFO, _NUMBERS.size)
            whole = len(packed) == _NUMBERS.size
            self._overflown = int(_NUMBERS.unpack(packed)[8] if whole else self._state[kernels.OVERFLOWN, 0])
        return self._overflown

    def hang_up(self) -> None:
        """End the connection, so that another one is made."""
        with suppress(OSError):  # if it ended by itself
            self._sock.shutdown(socket.SHUT_RDWR)

    @property
    def closed(self) -> bool:
        """Whether it receives no more."""
        return bool(self._state[kernels.STOP, 0])

    def close(self) -> None:
        """Stop receiving; what waits can still be taken."""
        if threading.current_thread() is self._thread:  # where it may be collected as garbage
            threading.Thread(target=self.close).start()
            return
        if self.closed:
            return
        _ = self.overflown
        self._state[kernels.STOP] = 1
        self._thread.join()
        self._sock.close()
        os.close(self._read)
        os.close(self._wake)


def _calls() -> NDArray[np.int64]:
    """Addresses of what the loop calls in the C library, and the number of the clock of `time.monotonic_ns`.

    Raises:
        ModelError: this system has another interface.
    """
    if sys.platform not in ("linux", "darwin") or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise ModelError(f"listening to events: found the system {sys.platform}: expected 64-bit Linux or macOS")
    library = ctypes.CDLL(None)
    names = (library.recvmsg, library.clock_gettime, library.write)
    places = [ctypes.cast(name, ctypes.c_void_p).value or 0 for name in names]
    return np.array([*places, time.CLOCK_MONOTONIC], np.int64)
