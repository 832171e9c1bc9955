"""Being asked to end while there is something to finish."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def ending_by(end: Callable[[], object]) -> Iterator[None]:
    """Within the block, call a function when the program is asked to end; when asked again it ends at once.

    It is asked by Ctrl-C, by SIGTERM, or by a terminal that closes. Signals reach the main thread only; in another
    one this does nothing.

    Raises:
        KeyboardInterrupt: it is asked again.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = False

    def ask(number: int, frame: Any) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
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
