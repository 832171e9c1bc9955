"""Checks of states and weights for NaN and infinity, which are reported as an instability."""

from __future__ import annotations

import numpy as np

from neuro.core.errors import ModelError
from neuro.model.neurons import Neuron
from neuro.program.backend import are_finite, unreadable
from neuro.program.program import Floats
from neuro.run.handles import Run

_STATES = "use a finer resolution, weaker input or currents, and states nearer to rest"
_LONGEST = 10_000
"""Largest number of steps between checks of all states."""
_WEIGHTS = "bound the weight in the rule, e.g. min(w + ..., Wmax), and avoid divisions by 0"


class Watch:
    """Checks of states at the end of runs, on every backend.

    States that can become unstable by themselves are checked each time: states of nonlinear models, and of targets of
    third-party rules that learn. Other states become NaN only through unbounded input, and stay NaN. They are checked
    whenever the number of steps has doubled, and at least every 10,000 steps, so runs of one step cost nothing.

    Args:
        run: the network in execution.
    """

    def __init__(self, run: Run) -> None:
        self.program, self.engine, self.clock = run.program, run.engine, run.clock
        unreadable_states, parts = unreadable(run.engine), run.program.projections
        third_party = [p for p in parts if not type(p.synapse).__module__.startswith("neuro.model.synapses.")]
        learning_targets = {part.target for part in third_party if part.synapse.learns}
        self.rarely_checked: list[tuple[int, list[str]]] = []
        self.always_checked: list[tuple[int, list[str]]] = []
        for index, part in enumerate(self.program.populations):
            if isinstance(part.model, Neuron) and part.size:
                # An infinite initial state is intended.
                states = [
                    s.name for s in part.model.states if not s.hidden and not np.isinf(part.initial[s.name]).any()
                ]
                names = [name for name in states if name not in unreadable_states]
                (
                    self.always_checked if index in learning_targets or not part.model.linear else self.rarely_checked
                ).append((index, names))
        self.due = 0

    def look(self) -> None:
        """Raise an error if a state is NaN or infinite.

        Raises:
            ModelError: a state is NaN or infinite. The message names the neuron, or the projection if its
                weights are NaN or infinite.
        """
        for index, names in self.always_checked:
            self._check(index, names)
        step = self.engine.step
        if step >= self.due:
            self.due = step + min(step, _LONGEST)
            for index, names in self.rarely_checked:
                if not are_finite(self.engine, index, names):
                    self._check(index, names)

    def begin(self) -> None:
        """Start again after a reset."""
        self.due = 0

    def _check(self, index: int, names: list[str]) -> None:
        for name in names:
            values = self.engine.get(index, name)
            if np.isfinite(values).all():
                continue
            for projection, afferent in enumerate(self.program.projections):
                if afferent.target == index and afferent.synapse.learns:
                    check_weights(afferent.name, afferent.synapse.name, self.engine.get_synapses(projection, "weight"))
            part = self.program.populations[index]
            neuron = int(np.argmin(np.isfinite(values)))
            message = (
                f"population '{part.name}': {name} of neuron {neuron} is {values[neuron]:g} "
                f"at {self.clock.ms(self.engine.step):g} ms: a numerical instability of {part.model.name}"
            )
            raise ModelError(message, hint=_STATES, kind="instability")


def check_weights(projection: str, rule: str, weights: Floats) -> Floats:
    """Return the weights of a projection after a check that all are finite.

    Raises:
        ModelError: a weight is NaN or infinite.
    """
    is_finite = np.isfinite(weights)
    if not is_finite.all():
        synapse = int(np.argmin(is_finite))
        message = (
            f"projection '{projection}': weight of synapse {synapse} is {weights[synapse]:g}: "
            f"a numerical instability of {rule}"
        )
        raise ModelError(message, hint=_WEIGHTS, kind="instability")
    return weights
