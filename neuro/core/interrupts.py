"""Being asked to end while there is something to finish, or while compiled code runs."""

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
    """Within the block, call a function on the first request to end; a second request ends at once.

    Requests are Ctrl-C, SIGTERM, and a terminal that closes. Signals reach the main thread only; in another thread
    the block does nothing.

    Raises:
        KeyboardInterrupt: a second request came.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    requested = False

    def ask(number: int, frame: Any) -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True
        end()

    signals = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup asks for
        signals.append(signal.SIGHUP)
    before = {each: signal.signal(each, ask) for each in signals}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


# Python calls the handler of a signal between two of its instructions, so never while compiled code runs. The signal
# also writes its number into a pipe at once. A thread reads the pipe and sets a number that compiled loops test.
BETWEEN_STEPS, AT_ONCE = 1, 2
"""Requests to a compiled loop: end between two steps, or at once, which leaves a step unfinished."""

PATIENCE_S = 0.25
"""Seconds after which a loop that has not ended between two steps shall end at once."""

_ASKING = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


class _Watch:
    """The pipe and the thread that reads it.

    Attributes:
        stop: what the compiled code looks at that the main thread runs now.
        before: the descriptor that others had set; what is read is passed on to it.
        set_at: when the descriptor was set last.
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
                with suppress(OSError):  # closed since
                    os.write(self.before, numbers)
            stop = self.stop
            if stop is None or _ASKING.isdisjoint(numbers):
                continue
            stop[0] = BETWEEN_STEPS
            time.sleep(PATIENCE_S)
            if self.stop is stop and stop[0] == BETWEEN_STEPS:
                stop[0] = AT_ONCE


_watch: _Watch | None = None
_MAIN = threading.main_thread().ident
_AGAIN_S = 0.01
"""Seconds after which the descriptor is set again, as others may have set theirs: to set it takes as long as a step."""


def _forget() -> None:
    """Let a forked process, which has no watching thread, start its own."""
    global _watch
    _watch = None


os.register_at_fork(after_in_child=_forget)


class Interruptible:
    """A block in which compiled code of the main thread is told to end when the program is asked to.

    Signals reach the main thread only; in another one this does nothing.

    Args:
        stop: one number, cleared when the block begins. A signal sets it to `BETWEEN_STEPS`, and later to `AT_ONCE`.
    """

    def __init__(self, stop: NDArray[np.int64]) -> None:
        self._stop = stop

    def __enter__(self) -> None:
        global _watch
        if self._stop.item():  # a signal came as the last block ended
            self._stop[0] = 0
        if get_ident() != _MAIN:
            return
        if _watch is None:
            _watch = _Watch()
        now = monotonic()
        if now - _watch.set_at > _AGAIN_S:
            before = signal.set_wakeup_fd(_watch.write, warn_on_full_buffer=False)
            if before != _watch.write:
                _watch.before = before
            _watch.set_at = now
        _watch.stop = self._stop

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if _watch is not None and _watch.stop is self._stop:
            _watch.stop = None
        if kind is not None:
            self._stop[0] = 0


def end_if_stopped(stop: NDArray[np.int64]) -> None:
    """Clear a stop between two steps; to be called when compiled code has returned, after handlers of the signal.

    Raises:
        KeyboardInterrupt: a step is unfinished.
    """
    request = stop.item()
    if request == AT_ONCE:
        raise KeyboardInterrupt
    if request:
        stop[0] = 0


def torn() -> ModelError:
    """Return the error of a network that goes on after it was interrupted within a step."""
    return ModelError(
        "the network was interrupted within a step: expected whole steps",
        hint="sim.reset() begins anew; sim.restore continues from a saved state",
    )
