"""States and weights, watched for NaN and infinity: an instability is reported where it would go on silently."""

from __future__ import annotations

import numpy as np

from neuro.core.errors import ModelError
from neuro.model.neurons import Neuron
from neuro.program.backend import are_finite, unreadable
from neuro.program.program import Floats
from neuro.run.handles import Run

_STATES = "take smaller steps, weaker input or currents, and states nearer to where they rest"
_LONGEST = 10_000
"""Steps after which every state is checked again."""
_WEIGHTS = "bound what the rule adds to the weight, e.g. min(w + ..., Wmax), and divide by nothing that can be 0"


class Watch:
    """Looks at states at the end of runs, whatever backend runs them.

    States that can run away by themselves are checked each time: those of models that are not linear, and where a
    third-party rule sends its weights. Of all others only input without bounds makes NaN, which then stays: they are
    checked when the time has doubled since, and after 10,000 steps at the latest. So runs of one step cost nothing.

    Args:
        run: the network in execution.
    """

    def __init__(self, run: Run) -> None:
        self.program, self.engine, self.clock = run.program, run.engine, run.clock
        hidden, parts = unreadable(run.engine), run.program.projections
        foreign = [p for p in parts if not type(p.synapse).__module__.startswith("neuro.model.synapses.")]
        taught = {part.target for part in foreign if part.synapse.learns}
        self.steady: list[tuple[int, list[str]]] = []
        self.watched: list[tuple[int, list[str]]] = []
        for index, part in enumerate(self.program.populations):
            if isinstance(part.model, Neuron) and part.size:
                # A state that is infinite at step 0 means something by it.
                states = [
                    s.name for s in part.model.states if not s.hidden and not np.isinf(part.initial[s.name]).any()
                ]
                names = [name for name in states if name not in hidden]
                (self.watched if index in taught or not part.model.linear else self.steady).append((index, names))
        self.due = 0

    def look(self) -> None:
        """Refuse to go on with a state that is NaN or infinite.

        Raises:
            ModelError: one is; it names the projection whose weights brought it, or the neuron.
        """
        for index, names in self.watched:
            self._look_at(index, names)
        step = self.engine.step
        if step >= self.due:
            self.due = step + min(step, _LONGEST)
            for index, names in self.steady:
                if not are_finite(self.engine, index, names):
                    self._look_at(index, names)

    def begin(self) -> None:
        """Begin anew, as after a reset."""
        self.due = 0

    def _look_at(self, index: int, names: list[str]) -> None:
        for name in names:
            values = self.engine.get(index, name)
            if np.isfinite(values).all():
                continue
            for projection, into in enumerate(self.program.projections):
                if into.target == index and into.synapse.learns:
                    check_weights(into.name, into.synapse.name, self.engine.get_synapses(projection, "weight"))
            part = self.program.populations[index]
            neuron = int(np.argmin(np.isfinite(values)))
            message = (
                f"population '{part.name}': {name} of neuron {neuron} is {values[neuron]:g} "
                f"at {self.clock.ms(self.engine.step):g} ms: a numerical instability of {part.model.name}"
            )
            raise ModelError(message, hint=_STATES, kind="instability")


def check_weights(projection: str, rule: str, weights: Floats) -> Floats:
    """The weights of a projection, all of which are numbers.

    Raises:
        ModelError: one is none.
    """
    good = np.isfinite(weights)
    if not good.all():
        synapse = int(np.argmin(good))
        message = (
            f"projection '{projection}': weight of synapse {synapse} is {weights[synapse]:g}: "
            f"a numerical instability of {rule}"
        )
        raise ModelError(message, hint=_WEIGHTS, kind="instability")
    return weights
