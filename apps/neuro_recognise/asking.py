"""What was learnt, kept ready to be asked again: a network is compiled once, not for every recording."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeAlias

from neuro_recognise.method import Answer, Learnt, Method
from neuro_recognise.shown import Features

__all__ = ["Ask", "Ready"]

AT_MOST = 4
"""Kept ready; those that were not asked for longest go first."""

Ask: TypeAlias = Callable[[Features], Answer]


class Ready:
    """Functions that answer, of a few things learnt.

    Copies, also those for another process, begin with none.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, str], tuple[Learnt, Ask]] = OrderedDict()

    def asker(self, method: Method, learnt: Learnt, backend: str) -> Ask:
        """That of `Method.asker`, made where it is not there. One thing learnt is always asked by one method.

        Raises:
            ModelError: the method cannot run on the backend.
        """
        key = (id(learnt), backend)
        if key not in self._kept:
            method.check_backend(backend)
            # what was learnt is kept, too, so that no other gets its id
            self._kept[key] = learnt, method.asker(learnt, backend)
        self._kept.move_to_end(key)
        while len(self._kept) > AT_MOST:
            self._kept.popitem(last=False)
        return self._kept[key][1]

    def __reduce__(self) -> tuple[Any, ...]:
        return Ready, ()
