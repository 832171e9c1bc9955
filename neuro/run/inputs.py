"""What comes from outside while a network runs: spikes, events and signals."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from neuro.core.clock import Clock
from neuro.core.english import a
from neuro.core.errors import ModelError
from neuro.program.backend import Engine
from neuro.program.program import Program
from neuro.run import settable
from neuro.run.handles import Neurons


class Inputs:
    """Brings to an engine what a user gives.

    Args:
        program: the network.
        engine: it runs.
        clock: of the network.
    """

    def __init__(self, program: Program, engine: Engine, clock: Clock) -> None:
        self._program, self._engine, self._clock = program, engine, clock

    def inject(self, neurons: Neurons, times: ArrayLike, ids: ArrayLike | None) -> None:
        """Add spikes to a spike_generator.

        Raises:
            ModelError: it is another model, a time has passed or is off the grid, or there is no such neuron.
        """
        part = neurons.part
        if part.kind != "listed" or part.stream is not None:
            hint = f"sim.feed('{part.name}', events) gives it events" if part.stream is not None else ""
            raise ModelError(f"inject: '{part.name}' is {a(part.said)}: expected a spike_generator", hint=hint)
        steps, emit = settable.new_spikes(self._clock, times, ids, neurons)
        if steps.size and steps.min() <= self._engine.step:
            early, now = (self._clock.ms(step) for step in (int(steps.min()), self._engine.step))
            raise ModelError(f"inject: a spike at {early:g} ms: expected times after {now:g} ms, the present")
        self._engine.inject(neurons.index, steps, emit)

    def feed(self, neurons: Neurons, events: Any) -> None:
        """Let an event camera emit more events.

        Raises:
            ModelError: it is another model, the events are of another sensor, or one comes too late.
        """
        part = neurons.part
        if neurons.view is not None:
            raise ModelError(f"feed: found the view {neurons.view}: expected the whole event_camera")
        if part.stream is None:
            raise ModelError(f"feed: '{part.name}' is {a(part.said)}: expected an event_camera")
        try:
            steps, ids = part.stream.given(events)
        except ModelError as error:
            raise error.at(None, f"feed: '{part.name}'") from None
        if steps.size and steps.min() <= self._engine.step:
            late, now = (self._clock.ms(step) for step in (int(steps.min()), self._engine.step))
            told = f"feed: an event of '{part.name}' in the step that ends at {late:g} ms"
            raise ModelError(f"{told}: expected later than {now:g} ms, the present")
        self._engine.inject(neurons.index, steps, ids)

    def signal(self, index: int, values: ArrayLike) -> None:
        """Set a signal: one value for all neurons, or one for each."""
        part = self._program.signals[index]
        size = self._program.populations[part.target].size
        self._engine.signal(index, settable.signal_values(part.name, values, size))
