"""Parameters and states of neurons, read and changed while a network runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from neuro.core.clock import Clock
from neuro.core.errors import unknown
from neuro.core.quantities import word_of
from neuro.program.backend import Engine, unreadable
from neuro.program.program import Program
from neuro.run import settable
from neuro.run.handles import Neurons


class Cells:
    """Reads and sets neurons.

    Args:
        program: the network.
        engine: it runs.
        clock: of the network.
    """

    def __init__(self, program: Program, engine: Engine, clock: Clock) -> None:
        self._program, self._engine, self._clock = program, engine, clock

    def set(self, neurons: Neurons, values: Mapping[str, Any]) -> None:
        """Change parameters or states by name, of all neurons or of each.

        Raises:
            ModelError: a name is unknown, a value is out of bounds, or several do not go together.
        """
        seed = self._program.seed
        new = {word: settable.new_values(neurons, word, value, self._engine, seed) for word, value in values.items()}
        settable.check_together(self._program, neurons.index, new, self._engine, self._clock)
        self._engine.set(neurons.index, new)

    def get(self, neurons: Neurons, what: str) -> Any:
        """A state or parameter, one value a neuron.

        Raises:
            ModelError: they have none of that name.
        """
        part, word = neurons.part, word_of(what) if isinstance(what, str) else ""
        if word not in part.parameters and word not in settable.states(part):
            known = [*settable.states(part), *part.parameters]
            raise unknown("parameter or state", what, known).at(None, f"population '{part.name}'")
        return self._engine.get(neurons.index, word, neurons.ids)

    def states(self, neurons: Neurons) -> list[str]:
        """The states that the backend shows, in the order of the model."""
        hidden = unreadable(self._engine)
        return [word for word in settable.states(neurons.part) if word not in hidden]
