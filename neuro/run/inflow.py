"""What streams give, brought to the engine just before it is emitted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError
from neuro.program.backend import Engine
from neuro.program.program import Program
from neuro.program.streams import Stream, Stretch

_NONE = np.zeros(0, dtype=np.int64)


class Inflow:
    """Fills an engine from the streams of a program.

    All that is kept of a run is, for each stream, the step up to which the engine has its spikes: a stream is asked
    anew for what comes after it. So nothing depends on how a run is cut.

    Args:
        program: names the streams.
        engine: takes their spikes.
    """

    def __init__(self, program: Program, engine: Engine) -> None:
        self._engine = engine
        self._names = [part.name for part in program.populations]
        streams = {index: part.stream for index, part in enumerate(program.populations)}
        self._streams: dict[int, Stream] = {k: stream for k, stream in streams.items() if stream is not None}
        self._coming: dict[int, Iterator[Stretch]] = {}
        self._filled = dict.fromkeys(self._streams, 0)

    def stretches(self, steps: int) -> Iterator[int]:
        """Cut a run into stretches; before one is given the engine has all that it emits in it."""
        if not self._streams:
            yield steps
            return
        end = self._engine.step + steps
        while self._engine.step < end:
            ready = min(self._fill(index) for index in self._streams)
            yield min(ready, end) - self._engine.step

    def _fill(self, index: int) -> int:
        """Bring spikes until there are all of the next step; up to which step there are."""
        while self._filled[index] <= self._engine.step:
            if index not in self._coming:
                self._coming[index] = self._streams[index].after(self._filled[index])
            try:
                stretch = next(self._coming[index], Stretch(NEVER, _NONE, _NONE))
            except BaseException:
                del self._coming[index]
                raise
            if stretch.steps.size:
                self._engine.inject(index, stretch.steps, stretch.ids)
            self._filled[index] = max(stretch.until, self._filled[index])
        return self._filled[index]

    def check_again(self, what: str) -> None:
        """Refuse to go back where a stream cannot.

        Args:
            what: what is asked for, for the message.

        Raises:
            ModelError: a stream has been begun and can be begun once.
        """
        for index in self._coming:
            if not self._streams[index].again:
                told = f"{what}: '{self._names[index]}' has played events of an iterator, which cannot be played again"
                hint = "give it Events, a list of them, or a function that makes an iterator"
                raise ModelError(f"{told}: expected events that can", hint=hint)

    def rewind(self) -> None:
        """Back to the beginning."""
        self._coming.clear()
        self._filled = dict.fromkeys(self._streams, 0)

    def state(self) -> dict[str, NDArray[Any]]:
        """How far each stream was read, by the name of its population."""
        return {self._names[index]: np.array(step) for index, step in self._filled.items()}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on where `state` was asked for."""
        self._coming.clear()
        self._filled = {index: int(arrays[self._names[index]]) for index in self._streams}
