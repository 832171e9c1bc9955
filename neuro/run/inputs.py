"""Input from outside during a run: spikes, events, signals, and the silencing or driving of neurons."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from neuro.core.errors import ModelError, a
from neuro.model.synapses import tsodyks2
from neuro.program.counts import fan_out
from neuro.program.program import Ints, Program
from neuro.run import settable
from neuro.run.handles import Neurons, Run


class InputFeeder:
    """Feeder that passes input of the user to an engine.

    Args:
        run: the network in execution.
    """

    def __init__(self, run: Run) -> None:
        self._program, self._engine, self._clock = run.program, run.engine, run.clock

    def inject(
        self, neurons: Neurons, times: ArrayLike, ids: ArrayLike | None, payloads: ArrayLike | None = None
    ) -> None:
        """Add spikes to a spike_generator, with payloads to a graded_spike_train.

        Raises:
            ModelError: the population has another model, a time has passed or is off the grid, or there is no such
                neuron.
        """
        part = neurons.part
        if part.kind != "listed" or part.stream is not None:
            hint = f"sim.feed('{part.name}', events) passes events to it" if part.stream is not None else ""
            raise ModelError(f"inject: '{part.name}' is {a(part.model_name)}: expected a spike_generator", hint=hint)
        if part.model.graded != (payloads is not None):
            expected = "payloads, one for each time" if part.model.graded else "no payloads"
            raise ModelError(f"inject: '{part.name}' is {a(part.model_name)}: expected {expected}")
        steps, emit, carried = settable.new_spikes(self._clock, times, ids, neurons, payloads)
        if steps.size and steps.min() <= self._engine.step:
            time, present = (self._clock.ms(step) for step in (int(steps.min()), self._engine.step))
            raise ModelError(f"inject: a spike at {time:g} ms: expected times after {present:g} ms, the present")
        if carried is None:
            self._engine.inject(neurons.index, steps, emit)
        else:
            self._engine.inject(neurons.index, steps, emit, carried)

    def feed(self, neurons: Neurons, events: Any) -> tuple[Ints, Ints]:
        """Add events to an event camera; return the steps and neurons of its spikes.

        Raises:
            ModelError: the population has another model, the events have another sensor size, or an event comes too
                late.
        """
        part = neurons.part
        if neurons.view is not None:
            raise ModelError(f"feed: found the view {neurons.view}: expected the whole event_camera")
        if part.stream is None:
            raise ModelError(f"feed: '{part.name}' is {a(part.model_name)}: expected an event_camera")
        try:
            steps, ids = part.stream.spikes_of(events)
        except ModelError as error:
            raise error.at(None, f"feed: '{part.name}'") from None
        if steps.size and (first := int(steps.min())) <= self._engine.step:
            time, present = (self._clock.ms(step) for step in (first, self._engine.step))
            message = f"feed: an event of '{part.name}' in the step that ends at {time:g} ms"
            raise ModelError(f"{message}: expected later than {present:g} ms, the present")
        self._engine.inject(neurons.index, steps, ids)
        return steps, ids

    def signal(self, index: int, values: ArrayLike) -> None:
        """Set a signal: one value for all neurons, or a value for each neuron."""
        part = self._program.signals[index]
        size = self._program.populations[part.target].size
        self._engine.signal(index, settable.signal_values(part.name, values, size))


def outgoing(program: Program, neurons: Neurons) -> list[int]:
    """Return the indices of the projections with at least one synapse from the given neurons.

    Raises:
        ModelError: silencing the neurons would not silence all synapses. Either some of the neurons share a kernel with
            neurons that stay active, or the synapses learn, so that weights would grow again.
    """
    candidates = [index for index, part in enumerate(program.projections) if part.source == neurons.index and part.size]
    is_silenced = neurons.mask()
    for part in (program.projections[index] for index in candidates):
        if part.grid is not None and not is_silenced.all():
            message = f"silence: {neurons.text}: '{part.name}' has one kernel for all neurons: expected all neurons"
            raise ModelError(message, hint=f"sim.silence('{neurons.part.name}')")
    # Dense, one-to-one and grid projections connect every source neuron; for sparse projections see the fan-out.
    is_sparse = [program.projections[index].layout == "csr" for index in candidates]
    indices = [
        index
        for index, sparse in zip(candidates, is_sparse, strict=True)
        if not sparse or fan_out(program, index)[is_silenced].any()
    ]
    for part in (program.projections[index] for index in indices):
        if part.synapse.learns and not part.synapse.delays and not isinstance(part.synapse, tsodyks2):
            rule = part.synapse.name
            message = f"silence: {neurons.text}: '{part.name}' learns by {rule}, so its weights would grow again"
            hint = "sim.network(frozen=True) has the learnt weights as static synapses"
            raise ModelError(f"{message}: expected static synapses", hint=hint)
    return indices


def driver(program: Program, neurons: Neurons) -> Neurons:
    """Return the generators that drive some neurons one to one.

    Among several generators, only the generators with a described rate of 0 are considered.

    Raises:
        ModelError: no such generator exists, or there are several, and the number with a rate of 0 is not 1.
    """
    sources = [
        part.source
        for part in program.projections
        if part.target == neurons.index
        and part.whole_layout == "one_to_one"
        and program.populations[part.source].kind == "poisson"
    ]
    if len(sources) > 1:
        sources = [index for index in sources if not np.any(program.populations[index].parameters["rate"])] or sources
    name = neurons.part.name
    if not sources:
        message = f"activate: {neurons.text}: expected a poisson_generator that is connected to '{name}' one_to_one"
        raise ModelError(message, hint="net.wiring(..., drive=weight) adds one")
    if len(sources) > 1:
        names = " and ".join(f"'{program.populations[index].name}'" for index in sources)
        message = (
            f"activate: {neurons.text}: {names} are connected to '{name}' one_to_one: expected one with a rate of 0"
        )
        raise ModelError(
            message, hint=f"sim.set('{program.populations[sources[0]].name}', rate=...) sets the rate of one of them"
        )
    return Neurons(sources[0], program.populations[sources[0]], neurons.end)
