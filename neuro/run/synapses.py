"""Synapses of a running network, all or chosen ones by their ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import word_of
from neuro.model.synapses import Synapse
from neuro.program.backend import Engine
from neuro.program.program import Floats, Ints, Program, synapse_states
from neuro.run import settable
from neuro.run.finite import check_weights
from neuro.run.handles import Neurons

_SMALL = 1_000_000
Chosen = NDArray[np.bool_]


class Synapses:
    """Reads and sets synapses; projections are indices.

    Args:
        program: the network.
        engine: it runs.
        clock: of the network.
        rules: the present synapse models of projections.
    """

    def __init__(self, program: Program, engine: Engine, clock: Clock, rules: Mapping[int, Synapse]) -> None:
        self._program, self._engine, self._clock, self._rules = program, engine, clock, rules
        self._ends: dict[int, tuple[Ints, Ints]] = {}

    def ends(self, index: int) -> tuple[Ints, Ints]:
        """Source and target of every synapse, in the order of the weights."""
        if index in self._ends:
            return self._ends[index]
        ends: tuple[Ints, Ints] = self._program.connections(index)
        for ids in ends:
            ids.flags.writeable = False
        if len(ends[0]) <= _SMALL:
            self._ends[index] = ends
        return ends

    def chosen(self, index: int, pre: Neurons | None, post: Neurons | None) -> Chosen | None:
        """Which synapses go from some neurons to some neurons; None for all.

        Raises:
            ModelError: they are neurons of other populations, or the synapses of a grid share weights.
        """
        part = self._program.projections[index]
        asked = {"pre": (pre, part.source), "post": (post, part.target)}
        for word, (neurons, population) in asked.items():
            if neurons is None:
                continue
            if part.grid is not None:
                told = f"{word} of '{part.name}', a grid, whose synapses share weights: expected all of them"
                raise ModelError(told, hint="its kernels are set as a whole, by map")
            if neurons.index != population:
                of = self._program.populations[population].name
                raise ModelError(f"{word} = {neurons.text}: expected neurons of '{of}', as '{part.name}' has there")
        kept = None
        ends = self.ends(index) if pre or post else (None, None)
        for neurons, ids in zip((pre, post), ends, strict=True):
            if neurons is not None and neurons.ids is not None:
                these = neurons.among()[ids]
                kept = these if kept is None else kept & these
        return kept

    def weights(self, index: int) -> Floats:
        """The weights of all synapses.

        Raises:
            ModelError: one is no number.
        """
        part, weight = self._program.projections[index], self._engine.get_synapses(index, "weight")
        return check_weights(part.name, part.synapse.name, weight) if part.synapse.learns else weight

    def read(self, index: int, what: str) -> Floats:
        """A state, the weight, the delay in ms or a parameter of the model of all synapses.

        Raises:
            ModelError: they have no such state.
        """
        part = self._program.projections[index]
        known = synapse_states(part)
        if what == "weight":
            return self.weights(index)
        if what == "delay" and not part.synapse.delays:
            return np.broadcast_to(self._clock.array_ms(part.delay.astype(np.int64)), part.size).copy()
        rule, word = self._rules[index], word_of(what) if isinstance(what, str) else ""
        if word in rule.numbers() and word not in known:
            return np.full(part.size, rule.parameters()[word], dtype=np.float64)
        if not isinstance(what, str) or what not in known:
            raise unknown("state of synapses", what, [*known, "delay"]).at(None, f"projection '{part.name}'")
        return self._engine.get_synapses(index, what)

    def new_weights(self, index: int, rule: Synapse, weights: Any, chosen: Chosen | None) -> Floats:
        """Weights of all synapses, of which some are new.

        Args:
            index: the projection.
            rule: the synapse model that they go with.
            weights: of the chosen ones, a number or one for each.
            chosen: which they are, None for all.

        Raises:
            ModelError: they are not what the rule or the receptor takes.
        """
        part = self._program.projections[index]
        return settable.new_weights(part, rule, weights, None if chosen is None else (self.weights(index), chosen))
