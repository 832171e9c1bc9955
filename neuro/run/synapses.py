"""Synapses of a running network, all or chosen ones by their ends, read and changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import word_of
from neuro.core.values import shown
from neuro.model.parts import Part, Side
from neuro.model.synapses import Synapse
from neuro.model.views import View
from neuro.program.backend import Engine
from neuro.program.program import Floats, Ints, Program, Projection, synapse_states
from neuro.run import settable
from neuro.run.finite import check_weights
from neuro.run.handles import Handles, Neurons
from neuro.run.settable import Chosen

_SMALL = 1_000_000


class Synapses:
    """Reads and sets synapses; projections are indices.

    Args:
        program: the network.
        engine: it runs.
        clock: of the network.
        rules: the present synapse models of projections, changed in place.
        handles: finds the neurons at their ends.
    """

    def __init__(
        self, program: Program, engine: Engine, clock: Clock, rules: dict[int, Synapse], handles: Handles
    ) -> None:
        self._program, self._engine, self._clock, self._rules = program, engine, clock, rules
        self._handles = handles
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

    def chosen(self, index: int, of: Any, pre: Side, post: Side, *, some: bool = False) -> Chosen | None:
        """Which synapses are of some pairs of neurons, or go from some neurons to some neurons; None for all.

        Args:
            index: the projection.
            of: pairs (source, target), rows of ids; the synapses are in their order.
            pre: a population, a view of it or ids.
            post: likewise.
            some: whether there must be one.

        Returns:
            whether each synapse is one of them; of pairs their places.

        Raises:
            ModelError: no synapse is chosen where there must be one, a pair has none, they are neurons of other
                populations, or the synapses of a grid share weights.
        """
        part = self._program.projections[index]
        said = {word: given for word, given in (("of", of), ("pre", pre), ("post", post)) if given is not None}
        if not said:
            return None
        if part.grid is not None:
            told = f"{next(iter(said))} of '{part.name}', a grid, whose synapses share weights: expected all of them"
            raise ModelError(told, hint="its kernels are set as a whole, by map")
        if of is None:
            sides = [("pre", pre, part.source), ("post", post, part.target)]
            return self._between(part, index, [self._side(part, *side) for side in sides], some)
        if len(said) > 1:
            raise ModelError(f"found both 'of' and '{[*said][1]}': expected pairs, or the neurons at either end")
        return self._of_pairs(part, index, of)

    def _side(self, part: Projection, word: str, given: Side, population: int) -> Neurons | None:
        if given is None:
            return None
        neurons = self._handles.neurons_or_ids(given, population, word)
        if neurons.index != population:
            of = self._program.populations[population].name
            raise ModelError(f"{word} = {neurons.text}: expected neurons of '{of}', as '{part.name}' has there")
        return neurons

    def _between(
        self, part: Projection, index: int, sides: Sequence[Neurons | None], some: bool
    ) -> NDArray[np.bool_] | None:
        kept: NDArray[np.bool_] | None = None
        for neurons, ids in zip(sides, self.ends(index), strict=True):
            if neurons is not None and neurons.ids is not None:
                these = neurons.among()[ids]
                kept = these if kept is None else kept & these
        if some and kept is not None and not kept.any():
            ends = zip(("from", "to"), sides, strict=True)
            asked = " ".join(f"{word} {neurons.text}" for word, neurons in ends if neurons is not None)
            raise ModelError(f"none of the {part.size:,} synapses of '{part.name}' goes {asked}: expected at least one")
        return kept

    def _of_pairs(self, part: Projection, index: int, of: Any) -> Ints:
        pairs = _pairs(of)
        for k, (word, population) in enumerate((("source", part.source), ("target", part.target))):
            of, n = self._program.populations[population], self._program.populations[population].size
            for row in np.flatnonzero((pairs[:, k] < 0) | (pairs[:, k] >= n))[:1]:
                told = f"of: pair {row}: found {word} {pairs[row, k]}"
                raise ModelError(
                    f"{told}: expected a neuron of '{self._program.populations[population].name}', 0 to {n - 1}"
                )
        n, (pre, post) = self._program.populations[part.target].size, self.ends(index)
        keys, asked = pre * n + post, pairs[:, 0] * n + pairs[:, 1]
        first, end = np.searchsorted(keys, asked), np.searchsorted(keys, asked, side="right")
        number = end - first
        for row in np.flatnonzero(number == 0)[:1]:
            pair = f"{pairs[row, 0]} to {pairs[row, 1]}"
            raise ModelError(f"of: pair {row}: none of the {part.size:,} synapses of '{part.name}' goes from {pair}")
        if np.unique(asked).size < asked.size:
            raise ModelError("of: found a pair more than once: expected each once")
        places: Ints = np.arange(number.sum()) + np.repeat(first - np.cumsum(number) + number, number)
        return places

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

    def set(self, index: int, values: Mapping[str, Any], chosen: Chosen | None) -> None:
        """Change weights, or numbers of the synapse model, by name.

        Args:
            index: the projection.
            values: `weight` stands alone.
            chosen: which synapses, None for all.

        Raises:
            ModelError: there is no such number, or a value is not what the rule or the receptor takes.
        """
        if [*values] == ["weight"]:
            self.set_weights(index, values["weight"], chosen)
            return
        part, rule = self._program.projections[index], self._rules[index]
        quantities = part.synapse.quantities()
        shared = [word for word in values if word != "weight" and not (word in quantities and quantities[word].arrays)]
        if "weight" in values or (shared and chosen is not None):
            word = next((word for word in [*shared, *values] if word != "weight"), "")
            alone = "is one for all synapses" if word in shared else "is set without weights"
            told = f"{part.synapse.name}.{word} of '{part.name}' {alone}"
            raise ModelError(f"{told}: expected 'weight' alone" + " with of, pre or post" * (chosen is not None))
        rule = settable.new_rule(part, rule, values, chosen)
        settable.check_rule(part, rule, self._engine.get_synapses(index, "weight"))
        self._engine.set_rule(index, rule.vector())
        self._rules[index] = rule

    def set_weights(self, index: int, weights: Any, chosen: Chosen | None) -> None:
        """Replace the weights of all synapses, or of the chosen ones: a number, or one for each.

        Raises:
            ModelError: they are not what the rule or the receptor takes.
        """
        part = self._program.projections[index]
        among = None if chosen is None else (self.weights(index), chosen)
        target = self._program.populations[part.target].model
        unit = "" if part.carries == "current" else getattr(target, "weight_unit", "")
        new = settable.new_weights(part, self._rules[index], weights, among, unit)
        self._engine.set_weights(index, new, None if chosen is None else _mask(part, chosen))

    def rows(self, index: int, chosen: Chosen | None, delays: bool) -> Any:
        """(pre, post, weight), with `delays` a fourth row; of a grid its kernels, with `delays` (kernels, delay)."""
        grid, weight = self._program.projections[index].grid, self.weights(index)
        late = (self.read(index, "delay"),) if delays else ()
        if grid is not None:
            return (weight.reshape(grid.kernels), float(late[0][0])) if late else weight.reshape(grid.kernels)
        rows = (*self.ends(index), weight, *late)
        return rows if chosen is None else tuple(row[chosen] for row in rows)

    def check(self) -> None:
        """Refuse weights that are no numbers, where a rule changes them."""
        for index, part in enumerate(self._program.projections):
            if part.synapse.learns:
                self.weights(index)


def _mask(part: Projection, chosen: Chosen) -> NDArray[np.bool_]:
    """Whether each synapse is chosen."""
    mask = np.zeros(part.size, dtype=np.bool_)
    mask[chosen] = True
    return mask


def _pairs(of: Any) -> Ints:
    """Pairs of neurons as rows, shape (n, 2)."""
    told = "expected pairs (source, target) of neurons as whole numbers, such as [(0, 5), (3, 1)]"
    if isinstance(of, (Part, View, str)):
        text = f"'{of.name}'" if isinstance(of, Part) else repr(of)
        raise ModelError(f"of = {text}: {told}", hint="pre= and post= take the neurons at either end")
    try:
        pairs = np.atleast_2d(np.asarray(of))
    except ValueError:  # rows of different lengths
        raise ModelError(f"of = {shown(of)}: {told}") from None
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ModelError(f"of = {shown(of)}: {told}", hint="pre= and post= take the neurons at either end")
    return pairs.astype(np.int64)
