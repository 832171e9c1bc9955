"""Streams played to a network during a run: events of recordings, and events of replayed runs."""

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
    """Feeder of an engine from streams.

    The only state is the step up to which the engine has the spikes of each stream. Later spikes are read from
    the stream again, so the result does not depend on how a run is divided.

    Args:
        program: the program with the names of the populations.
        engine: the engine that receives the spikes.
        streams: streams by population.
    """

    def __init__(self, program: Program, engine: Engine, streams: Mapping[int, Stream]) -> None:
        self._engine = engine
        self._names = [part.name for part in program.populations]
        self._streams = dict(streams)
        self._iterators: dict[int, Iterator[Stretch]] = {}
        self._complete_up_to = dict.fromkeys(self._streams, 0)

    @property
    def plays(self) -> bool:
        """True if there are streams."""
        return bool(self._streams)

    def play(self, index: int, stream: Stream) -> None:
        """Play a stream to a population from the present step on, instead of its previous stream."""
        self._streams[index], self._complete_up_to[index] = stream, self._engine.step
        self._iterators.pop(index, None)

    def stretches(self, steps: int) -> Iterator[int]:
        """Divide a run into parts. Before each part, the engine has all spikes of that part."""
        if not self._streams:
            yield steps
            return
        end = self._engine.step + steps
        while self._engine.step < end:
            complete_up_to = min(self._fill(index) for index in self._streams)
            yield min(complete_up_to, end) - self._engine.step

    def _fill(self, index: int) -> int:
        """Inject spikes until the next step is complete. Return the last complete step."""
        while self._complete_up_to[index] <= self._engine.step:
            if index not in self._iterators:
                self._iterators[index] = self._streams[index].after(self._complete_up_to[index])
            try:
                stretch = next(self._iterators[index], Stretch(NEVER, _NONE, _NONE))
            except BaseException:
                del self._iterators[index]
                raise
            if stretch.steps.size:
                self._engine.inject(index, stretch.steps, stretch.ids)
            self._complete_up_to[index] = max(stretch.until, self._complete_up_to[index])
        return self._complete_up_to[index]

    def check_again(self, call: str) -> None:
        """Raise an error for a call that sets back the time, if a stream cannot be read again.

        Args:
            call: name of the call, for the message.

        Raises:
            ModelError: a stream that can be read only once has been read.
        """
        for index in self._iterators:
            if not self._streams[index].repeatable:
                message = f"{call}: '{self._names[index]}' has played events that can be read only once"
                hint = "use Events, a list of Events, or a function that returns an iterator of them"
                raise ModelError(f"{message}: expected events that can be read again", hint=hint)

    def rewind(self) -> None:
        """Return to time 0."""
        self._iterators.clear()
        self._complete_up_to = dict.fromkeys(self._streams, 0)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the position in each stream, by the name of its population."""
        return {self._names[index]: np.array(step) for index, step in self._complete_up_to.items()}

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a `state`."""
        self._iterators.clear()
        self._complete_up_to = {index: int(arrays[self._names[index]]) for index in self._streams}


class Inflow:
    """Feeder of an engine from the streams of a program and from the replayed input of earlier runs.

    Args:
        program: the program with the streams.
        engine: the engine that receives the spikes.

    Attributes:
        own: feeder of the streams of the program.
        fed: feeder of replayed input.
    """

    def __init__(self, program: Program, engine: Engine) -> None:
        streams = {index: part.stream for index, part in enumerate(program.populations) if part.stream is not None}
        self.own, self.fed = StreamFeeder(program, engine, streams), StreamFeeder(program, engine, {})

    def stretches(self, steps: int) -> Iterator[int]:
        """Divide a run into parts. Before each part, the engine has all spikes of that part."""
        for stretch in self.own.stretches(steps):
            yield from self.fed.stretches(stretch)

    def rewind(self) -> None:
        """Return to time 0."""
        self.own.rewind()
        self.fed.rewind()
