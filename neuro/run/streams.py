"""Streams that a network plays: events of recordings and of those that are replayed, while it runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError
from neuro.program.backend import Engine
from neuro.program.program import Program, Stream, Stretch

_NONE = np.zeros(0, dtype=np.int64)


class StreamFeeder:
    """Fills an engine from streams.

    All that is kept of a run is, for each stream, the step up to which the engine has its spikes: a stream is asked
    anew for what comes after it. So nothing depends on how a run is cut.

    Args:
        program: names the streams.
        engine: takes their spikes.
        streams: by population.
    """

    def __init__(self, program: Program, engine: Engine, streams: Mapping[int, Stream]) -> None:
        self._engine = engine
        self._names = [part.name for part in program.populations]
        self._streams = dict(streams)
        self._coming: dict[int, Iterator[Stretch]] = {}
        self._filled = dict.fromkeys(self._streams, 0)

    @property
    def plays(self) -> bool:
        """Whether there are streams."""
        return bool(self._streams)

    def play(self, index: int, stream: Stream) -> None:
        """Let a population play one more stream, in the place of what it played by this."""
        self._streams[index], self._filled[index] = stream, self._engine.step
        self._coming.pop(index, None)

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
                message = (
                    f"{what}: '{self._names[index]}' has played events of an iterator or a stream, which come once"
                )
                hint = "give it Events, a list of them, or a function that makes an iterator"
                raise ModelError(f"{message}: expected events that can", hint=hint)

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


class Inflow:
    """Fills an engine from the streams of a program, and from what other runs were fed.

    Args:
        program: names the streams.
        engine: takes their spikes.

    Attributes:
        own: plays the streams of the program.
        fed: plays what is replayed.
    """

    def __init__(self, program: Program, engine: Engine) -> None:
        streams = {index: part.stream for index, part in enumerate(program.populations) if part.stream is not None}
        self.own, self.fed = StreamFeeder(program, engine, streams), StreamFeeder(program, engine, {})

    def stretches(self, steps: int) -> Iterator[int]:
        """Cut a run into stretches; before one is given the engine has all that it emits in it."""
        for stretch in self.own.stretches(steps):
            yield from self.fed.stretches(stretch)

    def rewind(self) -> None:
        """Back to the beginning."""
        self.own.rewind()
        self.fed.rewind()
