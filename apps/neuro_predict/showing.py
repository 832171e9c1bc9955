"""Recordings shown to a network, one after the other, each from time 0 on."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from neuro import OverflowWarning
from neuro.apps import PIXEL_SPIKE
from neuro.chips import HostWork, mean_work
from neuro.coding import Works
from neuro_predict.decisions import decision_work

if TYPE_CHECKING:
    from neuro import Simulation, TrialCounts
    from neuro_predict.decisions import Floats, Ints


Overflows = Mapping[str, tuple[int, str]]
"""Overflows by name, e.g. "input wraps of hidden": number of recordings with the overflow, and how to prevent it."""


@contextmanager
def overflows_counted(overflows: dict[str, tuple[int, str]]) -> Iterator[None]:
    """Within the block, count overflows of a recording in `overflows` instead of warning."""
    with warnings.catch_warnings(record=True) as caught_warnings:
        warnings.simplefilter("always", OverflowWarning)
        yield
    for warning in caught_warnings:
        message = warning.message
        if not isinstance(message, OverflowWarning):
            warnings.warn_explicit(message, warning.category, warning.filename, warning.lineno)
        elif message.what:
            overflows[message.what] = overflows.get(message.what, (0, ""))[0] + 1, message.hint


def warn_of_overflows(backend: str, overflows: Overflows, recordings: int) -> None:
    """Warn once of each register that overflowed, with the number of recordings."""
    for event, (count, hint) in overflows.items():
        text = f"backend '{backend}': {event} in {count} of {recordings} recordings\n  hint: {hint}"
        warnings.warn(text, OverflowWarning, stacklevel=2)


class Showing:
    """Shows recordings to a network, and sums the operations.

    Args:
        sim: the compiled network.
        input: the spike_generator of the pixels.
        output: the population whose spikes are returned.

    Attributes:
        taken: operations of all recordings; None before the first recording.
        overflows: overflows of a chip's registers, see `Overflows`.
    """

    def __init__(self, sim: Simulation, input: str, output: str) -> None:
        self.sim, self._input, self._output = sim, input, output
        self._learns = any(part.synapse.learns for part in sim.program.projections)
        self._graded = any(part.model.graded for part in sim.program.populations if part.name == output)
        self.taken: TrialCounts | None = None
        self.overflows: dict[str, tuple[int, str]] = {}
        self._uses: dict[str, float] = {}

    def show(
        self, step: npt.NDArray[Any], neuron: npt.NDArray[Any], steps: int, events: int = 0
    ) -> tuple[Floats, Ints, Ints | None]:
        """Show a recording.

        Args:
            step: step of each spike of the input, from 0 on.
            neuron: neuron of each spike.
            steps: number of steps of the run.
            events: number of events that became these spikes; 0 for a recording of spikes.

        Returns:
            The output's spikes: times in ms, neurons, and payloads; None for payloads if the output is not graded.
        """
        sim, h = self.sim, self.sim.program.resolution
        sim.reset(weights=self._learns)  # weights learnt in a recording do not affect the next
        sim.inject(self._input, (step + 1.0) * h, neuron)
        with overflows_counted(self.overflows):
            sim.run(steps * h)
        self.taken = sim.taken() if self.taken is None else self.taken + sim.taken()
        times, ids, payloads = sim.payloads(self._output) if self._graded else (*sim.spikes(self._output), None)
        for unit, n in {"event": events, "spike": len(ids), "step": steps, "recording": 1}.items():
            self._uses[unit] = self._uses.get(unit, 0.0) + n
        return times, ids, payloads

    def host(self, decide: str) -> tuple[HostWork, ...]:
        """Return the operations of the host for all recordings: the conversion of events to spikes, and the decision.

        Args:
            decide: rule of the decision, see `neuro_predict.decisions.decision_work`.
        """
        neurons = next(part.size for part in self.sim.program.populations if part.name == self._output)
        parts: dict[str, Works] = {f"pixels of {self._input}": {"event": PIXEL_SPIKE}}
        parts |= {f"{decide} of {self._output}": decision_work(decide, neurons)}
        return mean_work(parts, self._uses, int(self._uses.get("recording", 0)))
