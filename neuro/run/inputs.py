"""What comes from outside while a network runs: spikes, events, signals, and neurons that are silenced or driven."""

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
    """Brings to an engine what a user gives.

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
            ModelError: it is another model, a time has passed or is off the grid, or there is no such neuron.
        """
        part = neurons.part
        if part.kind != "listed" or part.stream is not None:
            hint = f"sim.feed('{part.name}', events) gives it events" if part.stream is not None else ""
            raise ModelError(f"inject: '{part.name}' is {a(part.said)}: expected a spike_generator", hint=hint)
        if part.model.graded != (payloads is not None):
            expected = "payloads, one for each time" if part.model.graded else "no payloads"
            raise ModelError(f"inject: '{part.name}' is {a(part.said)}: expected {expected}")
        steps, emit, carried = settable.new_spikes(self._clock, times, ids, neurons, payloads)
        if steps.size and steps.min() <= self._engine.step:
            early, now = (self._clock.ms(step) for step in (int(steps.min()), self._engine.step))
            raise ModelError(f"inject: a spike at {early:g} ms: expected times after {now:g} ms, the present")
        if carried is None:
            self._engine.inject(neurons.index, steps, emit)
        else:
            self._engine.inject(neurons.index, steps, emit, carried)

    def feed(self, neurons: Neurons, events: Any) -> tuple[Ints, Ints]:
        """Let an event camera emit more events; return the steps and neurons of its spikes.

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
        if steps.size and (first := int(steps.min())) <= self._engine.step:
            late, now = (self._clock.ms(step) for step in (first, self._engine.step))
            message = f"feed: an event of '{part.name}' in the step that ends at {late:g} ms"
            raise ModelError(f"{message}: expected later than {now:g} ms, the present")
        self._engine.inject(neurons.index, steps, ids)
        return steps, ids

    def signal(self, index: int, values: ArrayLike) -> None:
        """Set a signal: one value for all neurons, or one for each."""
        part = self._program.signals[index]
        size = self._program.populations[part.target].size
        self._engine.signal(index, settable.signal_values(part.name, values, size))


def outgoing(program: Program, neurons: Neurons) -> list[int]:
    """The projections that have synapses from some neurons.

    Raises:
        ModelError: only some neurons share a kernel with the others, or weights learn and would grow again.
    """
    found = [k for k, part in enumerate(program.projections) if part.source == neurons.index and part.size]
    among = neurons.among()
    for part in (program.projections[k] for k in found):
        if part.grid is not None and not among.all():
            message = f"silence: {neurons.text}: '{part.name}' has one kernel for all neurons: expected all of them"
            raise ModelError(message, hint=f"sim.silence('{neurons.part.name}')")
    # All neurons have synapses along projections that are not listed.
    csr = [program.projections[k].layout == "csr" for k in found]
    reached = [k for k, listed in zip(found, csr, strict=True) if not listed or fan_out(program, k)[among].any()]
    for part in (program.projections[k] for k in reached):
        if part.synapse.learns and not part.synapse.delays and not isinstance(part.synapse, tsodyks2):
            rule = part.synapse.name
            message = f"silence: {neurons.text}: '{part.name}' learns by {rule}, so its weights would grow again"
            hint = "sim.network() has what was learnt; silence it with static synapses"
            raise ModelError(f"{message}: expected weights that stay", hint=hint)
    return reached


def driver(program: Program, neurons: Neurons) -> Neurons:
    """The generators that drive some neurons one to one; of several the ones that are described without a rate.

    Raises:
        ModelError: there are none, or several between which nothing decides.
    """
    found = [
        part.source
        for part in program.projections
        if part.target == neurons.index
        and part.whole_layout == "one_to_one"
        and program.populations[part.source].kind == "poisson"
    ]
    if len(found) > 1:
        found = [index for index in found if not np.any(program.populations[index].parameters["rate"])] or found
    name = neurons.part.name
    if not found:
        message = f"activate: {neurons.text}: expected a poisson_generator that is connected to '{name}' one_to_one"
        raise ModelError(message, hint="net.wiring(..., drive=weight) adds one")
    if len(found) > 1:
        names = " and ".join(f"'{program.populations[index].name}'" for index in found)
        message = (
            f"activate: {neurons.text}: {names} are connected to '{name}' one_to_one: expected one with a rate of 0"
        )
        raise ModelError(message, hint=f"sim.set('{program.populations[found[0]].name}', rate=...) sets one of them")
    return Neurons(found[0], program.populations[found[0]], neurons.end)
