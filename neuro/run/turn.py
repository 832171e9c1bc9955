"""A lock that allows one call of a simulation at a time.

The calls of a simulation share all data, so a second call during a call is refused. Public methods acquire a lock (the
"turn") and then work on an inner object with the same parts, whose methods acquire none. The turn is a dictionary with
the present call, if any. Acquiring it is a single `dict.setdefault`, which neither another thread nor Ctrl-C can
interrupt.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from threading import get_ident
from typing import Any, TypeVar, cast

from neuro.core.errors import ModelError

Turn = dict[str, tuple[str, int]]
"""Dictionary whose key `NOW` has the name and the thread of the present call, as a new tuple."""

NOW = "now"
F = TypeVar("F", bound=Callable[..., Any])

_POLL_S = 1e-3


def refused(name: str, turn: Turn) -> ModelError:
    """Return the error for a call during another call."""
    call, thread = turn.get(NOW, ("another call", 0))
    from_ = f"found a call from within '{call}'" if thread == get_ident() else f"found another thread within '{call}'"
    message = f"{name}: {from_} of the same simulation: expected one call at a time"
    return ModelError(message, hint="compile a simulation for each thread, or share one with a threading.Lock")


def exclusive(method: F) -> F:
    """Make a method of a `Simulation` acquire the turn and run on the inner object."""
    name = method.__name__

    @wraps(method)
    def call(self: Any, *args: Any, **keywords: Any) -> Any:
        turn: Turn | None = self._turn
        if turn is None:
            return method(self, *args, **keywords)
        own_call = (name, get_ident())
        try:
            if turn.setdefault(NOW, own_call) is not own_call:
                raise refused(name, turn)
            return method(self._inner, *args, **keywords)
        finally:
            if turn.get(NOW) is own_call:
                del turn[NOW]

    return cast(F, call)


@contextmanager
def hold(turn: Turn | None, name: str, wait: bool = False) -> Iterator[None]:
    """Hold the turn during a block. The inner object has no turn, and needs none.

    Args:
        turn: the turn of the simulation; None on the inner object.
        name: name of the call, for messages.
        wait: whether to wait for the end of a call of another thread.

    Raises:
        ModelError: another call is running.
    """
    own_call = (name, get_ident())
    try:
        while turn is not None and (present_call := turn.setdefault(NOW, own_call)) is not own_call:
            if not wait or present_call[1] == own_call[1]:
                raise refused(name, turn)
            time.sleep(_POLL_S)
        yield
    finally:
        if turn is not None and turn.get(NOW) is own_call:
            del turn[NOW]
