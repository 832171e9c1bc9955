"""One call of a simulation at a time.

A lock allows one call at a time: all that a call reads and changes is shared, so a second one is refused. Public
methods of a simulation take the turn, and then work on an inner object of the same parts, whose methods take none. A
turn is a dictionary with the call that is under way, if one is: to take it is one operation of the interpreter, which
neither another thread nor Ctrl-C cuts in two.
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
"""By `NOW` the name of the call that is under way, and its thread: an object of its own for each call."""

NOW = "now"
F = TypeVar("F", bound=Callable[..., Any])

_POLL_S = 1e-3


def refused(name: str, turn: Turn) -> ModelError:
    """The error for a call that comes while another is under way."""
    other, thread = turn.get(NOW, ("another call", 0))
    found = f"found a call from within '{other}'" if thread == get_ident() else f"found another thread within '{other}'"
    message = f"{name}: {found} of the same simulation: expected one call at a time"
    return ModelError(message, hint="compile a simulation for each thread, or share one with a threading.Lock")


def alone(method: F) -> F:
    """Let a method of a `Simulation` take the turn, and run on the inner face."""
    name = method.__name__

    @wraps(method)
    def call(self: Any, *args: Any, **named: Any) -> Any:
        turn: Turn | None = self._turn
        if turn is None:
            return method(self, *args, **named)
        mine = (name, get_ident())
        try:
            if turn.setdefault(NOW, mine) is not mine:
                raise refused(name, turn)
            return method(self._inner, *args, **named)
        finally:
            if turn.get(NOW) is mine:
                del turn[NOW]

    return cast(F, call)


@contextmanager
def held(turn: Turn | None, name: str, wait: bool = False) -> Iterator[None]:
    """Take the turn for a block, or on the inner face nothing.

    Args:
        turn: that of the face.
        name: of the call, for messages.
        wait: whether to wait until the call of another thread is over.

    Raises:
        ModelError: a call is under way.
    """
    mine = (name, get_ident())
    try:
        while turn is not None and (now := turn.setdefault(NOW, mine)) is not mine:
            if not wait or now[1] == mine[1]:
                raise refused(name, turn)
            time.sleep(_POLL_S)
        yield
    finally:
        if turn is not None and turn.get(NOW) is mine:
            del turn[NOW]
