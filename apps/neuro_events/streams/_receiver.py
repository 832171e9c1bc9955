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
"""Largest number of datagrams in the ring."""
LEAST = 1 << 18
"""Size of the smallest ring, bytes; four of the largest datagrams fit."""
PATIENCE = 0.02
"""Timeout of a receiving call, s. The thread notices `Receiver.close` within this time."""
DRAIN_S = 1.0
"""Longest wait of `Receiver.close` for the datagrams in the system's queue, s, because a sender may never stop."""
QUEUE = 1 << 25
"""Requested size of the system's queue, bytes. The system limits the size (Linux: sysctl net.core.rmem_max)."""
_OVERFLOW, _MEMINFO = 40, 55
"""Options of sockets in Linux: SO_RXQ_OVFL, SO_MEMINFO."""
_NUMBERS = struct.Struct("=9I")
"""Values of SO_MEMINFO; the last counts the datagrams dropped because the queue was full (SK_MEMINFO_DROPS)."""


class Receiver:
    """A thread that receives until `close`. Only one thread may read the entries.

    Args:
        sock: a bound or connected socket, which `close` closes.
        buffer: size of the ring, bytes.
        reconnect: function that makes a new connection after a connection has ended. It returns None if this is not
            possible yet. None: the socket receives datagrams.

    Attributes:
        ring: the received bytes.
        index: (`ENTRIES`, FIELDS) int64, entries in a ring; see `_kernels`.
        connections: number of reconnections.
        opened_ns: time at which receiving began, by `time.monotonic_ns`.
    """

    def __init__(self, sock: socket.socket, buffer: int, reconnect: Callable[[], socket.socket | None] | None) -> None:
        self._sock, self._reconnect = sock, reconnect
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
        self._receive()  # compiles the receiving loop
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
        if self._reconnect is None and sys.platform == "linux":
            sock.setsockopt(socket.SOL_SOCKET, _OVERFLOW, 1)

    def _receive(self) -> int:
        arguments = self._calls, self._sock.fileno(), self._wake, self._reconnect is None
        return int(kernels.receive(*arguments, self.ring, self.index, self._state, self._message))

    def _run(self) -> None:
        while not self.closed:
            n_bytes = self._receive()
            if n_bytes == 0 and self._reconnect is not None:
                self._connect()
            else:  # the ring is full (TCP only), or the call failed
                time.sleep(0.001)

    def _connect(self) -> None:
        """Connect again, and write an empty entry between the two connections."""
        assert self._reconnect is not None
        self._sock.close()
        while not self._state[kernels.STOP, 0] and not kernels.end_entry(self.index, self._state):
            time.sleep(0.001)
        while not self._state[kernels.STOP, 0]:
            sock = self._reconnect()
            if sock is not None:
                self._sock = sock
                self._prepare(sock)
                self.connections += 1
                return
            time.sleep(0.05)

    @property
    def entries(self) -> tuple[int, int]:
        """Number of the first entry in the ring, and number of the next entry to be received."""
        return int(self._state[kernels.TAKEN, 0]), int(kernels.arrived(self._state))

    def received(self, entry: int) -> int:
        """Return the time of receipt of an entry in the ring, by `time.monotonic_ns`."""
        return int(self.index[entry % ENTRIES, kernels.RECEIVED])

    def before(self, ns: int) -> int:
        """Return the number of the first entry in the ring that was received at `ns` or later."""
        first, last = self.entries
        return first + bisect_left(range(first, last), ns, key=self.received)

    def release(self, end: int) -> None:
        """Release the space of all entries before a number."""
        kernels.release(self._state, end)

    def wait(self, timeout_s: float) -> bool:
        """Wait for an entry, and return whether there is one."""
        deadline = time.monotonic() + timeout_s
        while True:
            first, last = self.entries
            remaining_s = deadline - time.monotonic()
            if last > first or remaining_s <= 0 or self.closed:
                return last > first
            if self._poll.poll(min(remaining_s, 3600.0) * 1000.0):
                os.read(self._read, 1 << 16)

    @property
    def last_ns(self) -> int:
        """Time of the last receipt, or of the start, by `time.monotonic_ns`."""
        return int(self._state[kernels.LAST, 0])

    @property
    def refused(self) -> int:
        """Number of datagrams dropped because the ring was full."""
        return int(self._state[kernels.REFUSED, 0])

    @property
    def overflown(self) -> int | None:
        """Number of datagrams dropped because the system's queue was full, None if the system does not count them."""
        if self._reconnect is not None:
            return 0
        if sys.platform != "linux":
            return None
        if not self.closed:
            packed = self._sock.getsockopt(socket.SOL_SOCKET, _MEMINFO, _NUMBERS.size)
            is_complete = len(packed) == _NUMBERS.size
            self._overflown = int(_NUMBERS.unpack(packed)[8] if is_complete else self._state[kernels.OVERFLOWN, 0])
        return self._overflown

    def hang_up(self) -> None:
        """End the connection, so that the thread reconnects."""
        with suppress(OSError):  # the connection may have ended already
            self._sock.shutdown(socket.SHUT_RDWR)

    @property
    def closed(self) -> bool:
        """True after `close`."""
        return bool(self._state[kernels.STOP, 0])

    def close(self) -> None:
        """Receive the datagrams in the system's queue, then stop. The entries in the ring can still be read."""
        if threading.current_thread() is self._thread:  # garbage collection may call `close` in this thread
            threading.Thread(target=self.close).start()
            return
        if self.closed:
            return
        if self._reconnect is None:
            deadline, queue = time.monotonic() + DRAIN_S, select.poll()
            queue.register(self._sock, select.POLLIN)
            while time.monotonic() < deadline and queue.poll(0):
                time.sleep(0.001)
        _ = self.overflown
        self._state[kernels.STOP] = 1
        self._thread.join()
        self._sock.close()
        os.close(self._read)
        os.close(self._wake)


def _calls() -> NDArray[np.int64]:
    """Return the addresses of the C functions that the loop calls, and the number of the clock of `time.monotonic_ns`.

    Raises:
        ModelError: the system has another interface.
    """
    if sys.platform not in ("linux", "darwin") or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise ModelError(f"listening to events: found the system {sys.platform}: expected 64-bit Linux or macOS")
    library = ctypes.CDLL(None)
    functions = (library.recvmsg, library.clock_gettime, library.write)
    addresses = [ctypes.cast(function, ctypes.c_void_p).value or 0 for function in functions]
    return np.array([*addresses, time.CLOCK_MONOTONIC], np.int64)
