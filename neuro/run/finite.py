"""NaN and infinite states: a numerical instability is reported, where it would go on silently."""

from __future__ import annotations

import numpy as np

from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.model.neurons import Neuron
from neuro.program.backend import Engine, are_finite, unreadable
from neuro.program.program import Floats, Population, Program

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
        program: the network.
        engine: that runs it.
        clock: of the network.
    """

    def __init__(self, program: Program, engine: Engine, clock: Clock) -> None:
        self.program, self.engine, self.clock = program, engine, clock
        hidden = unreadable(engine)
        taught = {
            part.target
            for part in program.projections
            if part.synapse.learns and not type(part.synapse).__module__.startswith("neuro.model.synapses.")
        }
        self.steady: list[tuple[int, list[str]]] = []
        self.watched: list[tuple[int, list[str]]] = []
        for index, part in enumerate(program.populations):
            if isinstance(part.model, Neuron) and part.size:
                names = [name for name in _finite_at_first(part) if name not in hidden]
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
            if not np.isfinite(values).all():
                raise self._instability(index, name, values)

    def _instability(self, index: int, name: str, values: Floats) -> ModelError:
        for projection, into in enumerate(self.program.projections):
            if into.target == index and into.synapse.learns:
                check_weights(into.name, into.synapse.name, self.engine.get_synapses(projection, "weight"))
        part = self.program.populations[index]
        neuron = int(np.argmin(np.isfinite(values)))
        message = (
            f"population '{part.name}': {name} of neuron {neuron} is {values[neuron]:g} "
            f"at {self.clock.ms(self.engine.step):g} ms: a numerical instability of {part.model.name}"
        )
        return ModelError(message, hint=_STATES, kind="instability")


def _finite_at_first(part: Population) -> list[str]:
    """The states that show; one that is infinite at step 0 means something by it."""
    return [s.name for s in part.model.states if not s.hidden and not np.isinf(part.initial[s.name]).any()]


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
