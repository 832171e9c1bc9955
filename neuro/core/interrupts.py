"""Handling of Ctrl-C and other requests to end, during work that must be finished and during compiled code."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import get_ident
from time import monotonic
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

from neuro.core.errors import ModelError


@contextmanager
def ending_by(end: Callable[[], object]) -> Iterator[None]:
    """Call a function on the first request to end within the block; a second request raises KeyboardInterrupt.

    Requests are Ctrl-C, SIGTERM, and a terminal that closes. Signals reach the main thread only; in another thread
    the block does nothing.

    Raises:
        KeyboardInterrupt: a second request came.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    requested = False

    def on_request(number: int, frame: Any) -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True
        end()

    signals = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup ignores SIGHUP
        signals.append(signal.SIGHUP)
    previous = {number: signal.signal(number, on_request) for number in signals}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


# Python calls signal handlers between two of its instructions, so never while compiled code runs. But Python writes the
# number of a signal into a pipe at once. A thread reads the pipe and sets a number that compiled loops test.
BETWEEN_STEPS, AT_ONCE = 1, 2
"""Requests to a compiled loop: end between two steps, or end at once and leave a step unfinished."""

PATIENCE_S = 0.25
"""Seconds that a loop has to end between two steps, before it must end at once."""

_END_SIGNALS = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


class _Watch:
    """A pipe for signals, and the thread that reads the pipe.

    Attributes:
        stop: the number that the compiled code of the main thread tests.
        before: the wakeup descriptor that other code had set, or -1. The numbers of signals are passed on to it.
        set_at: time at which this pipe was last made the wakeup descriptor, in s.
    """

    def __init__(self) -> None:
        self.read, self.write = os.pipe()
        os.set_blocking(self.write, False)
        self.before, self.set_at = -1, 0.0
        self.stop: NDArray[np.int64] | None = None
        threading.Thread(target=self._watch, name="neuro interrupts", daemon=True).start()

    def _watch(self) -> None:
        while numbers := os.read(self.read, 64):
            if self.before >= 0:
                with suppress(OSError):  # the descriptor may be closed
                    os.write(self.before, numbers)
            stop = self.stop
            if stop is None or _END_SIGNALS.isdisjoint(numbers):
                continue
            stop[0] = BETWEEN_STEPS
            time.sleep(PATIENCE_S)
            if self.stop is stop and stop[0] == BETWEEN_STEPS:
                stop[0] = AT_ONCE


_watch: _Watch | None = None
_MAIN = threading.main_thread().ident
_RENEW_S = 0.01
"""Seconds after which the wakeup descriptor is set again, since other code may have replaced it.

The descriptor is not set in every block, because setting it takes as long as a step.
"""


def _forget() -> None:
    """Forget the watch in a forked process, which has no watching thread and starts its own."""
    global _watch
    _watch = None


os.register_at_fork(after_in_child=_forget)


class Interruptible:
    """A block in which a request to end also ends compiled code of the main thread.

    Signals reach the main thread only; in other threads the block does nothing.

    Args:
        stop: array of one number, cleared when the block begins. A signal sets it to `BETWEEN_STEPS`, and later to
            `AT_ONCE`.
    """

    def __init__(self, stop: NDArray[np.int64]) -> None:
        self._stop = stop

    def __enter__(self) -> None:
        global _watch
        if self._stop.item():  # a signal came after the last test of the previous block
            self._stop[0] = 0
        if get_ident() != _MAIN:
            return
        if _watch is None:
            _watch = _Watch()
        time_s = monotonic()
        if time_s - _watch.set_at > _RENEW_S:
            descriptor = signal.set_wakeup_fd(_watch.write, warn_on_full_buffer=False)
            if descriptor != _watch.write:
                _watch.before = descriptor
            _watch.set_at = time_s
        _watch.stop = self._stop

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if _watch is not None and _watch.stop is self._stop:
            _watch.stop = None
        if kind is not None:
            self._stop[0] = 0


def end_if_stopped(stop: NDArray[np.int64]) -> None:
    """Clear a stop between two steps. Call it after compiled code has returned and signal handlers have run.

    Raises:
        KeyboardInterrupt: a step is unfinished.
    """
    request = stop.item()
    if request == AT_ONCE:
        raise KeyboardInterrupt
    if request:
        stop[0] = 0


def torn() -> ModelError:
    """Return the error for a network that was interrupted within a step and should continue."""
    return ModelError(
        "the network was interrupted within a step: expected whole steps",
        hint="use sim.reset() to start again, or sim.restore to continue from a saved state",
    )
