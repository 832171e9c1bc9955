"""One projection as connections of NEST, and the order in which NEST lists them; or as a rule by which NEST draws.

NEST tells synapses by their ends and a label. So the synapses between the same two neurons lie in layers, and
each layer of a projection has a label of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.rules import (
    NamedRule,
    all_to_all,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    pairwise_bernoulli,
)
from neuro.program.program import Floats, Ints, Program
from neuro_nest.sources import first_node
from neuro_nest.tables import RECEPTORS_OF_CURRENTS, SHARED, STATES, SYNAPSES, NestClock


@dataclass(frozen=True, slots=True)
class Nodes:
    """Nodes that stand for neurons.

    Attributes:
        first: the number of the first node; the others follow.
        at: which of them stands for each neuron; None: they are in order.
    """

    first: int
    at: Ints | None

    def places(self, neurons: Ints) -> Ints:
        """Which of the nodes stand for some neurons, counted from 0."""
        return neurons if self.at is None else self.at[neurons]

    def of(self, neurons: Ints) -> Ints:
        """The numbers of the nodes of some neurons."""
        return self.first + self.places(neurons)

    def in_turn(self, neurons: int) -> Ints:
        """The neurons in the order of their nodes."""
        return np.arange(neurons) if self.at is None else np.argsort(self.at)

    def neurons(self, nodes: Ints) -> Ints:
        """The neurons for which some nodes stand."""
        places = nodes - self.first
        return places if self.at is None else np.argsort(self.at)[places]


def dealt_out(neurons: int, processes: int) -> Ints:
    """Which node stands for each neuron, so that each process has neighbouring ones though nodes are dealt in turn."""
    return np.concatenate([np.arange(rank, neurons, processes) for rank in range(processes)])


DEEPEST = 1 << 14
"""Labels that each projection has. NEST's have 31 bits, so there may be 131,072 projections."""


def layers(source: Ints, target: Ints) -> Ints:
    """How many synapses of the same ends stand before each; they are sorted by source."""
    order = np.lexsort((target, source))
    pre, post = source[order], target[order]
    fresh = np.ones(len(pre), dtype=bool)
    fresh[1:] = (pre[1:] != pre[:-1]) | (post[1:] != post[:-1])
    starts = np.flatnonzero(fresh)
    found = np.empty(len(pre), dtype=np.int64)
    found[order] = np.arange(len(pre)) - np.repeat(starts, np.diff(np.append(starts, len(pre))))
    return found


class NestProjection:
    """The synapses of a projection that this process has.

    Args:
        program: the network.
        index: which projection.
        weights: all weights, as the program has them: where it has a share, those of the share.

    Attributes:
        source, target, delay: of every synapse, by source.
        slot: the place of its weight.
        row_ends: synapses of source i are row_ends[i] : row_ends[i + 1].
        weights: of a static projection those in force, else those it began with.
    """

    def __init__(self, program: Program, index: int, weights: Floats) -> None:
        self.part, self.index, self.weights = program.projections[index], index, weights
        n_source, self.n_target = (program.populations[i].size for i in (self.part.source, self.part.target))
        cut = self.part.share.number > 1
        source, target, slot = program.own_synapses(index)
        self.delay = np.broadcast_to(self.part.delay, len(source))
        # Of a projection of which the program has all synapses: those onto the neurons of this process.
        self._own: Ints | None = None
        if program.share.number > 1 and not cut:
            begin, end = program.share.of(self.n_target)
            self._own = np.flatnonzero((target >= begin) & (target < end))
        own = first_node(program, index)
        nodes = source if own is None else own + np.arange(source.size)
        if self._own is not None:
            source, target, slot, nodes = (ids[self._own] for ids in (source, target, slot, nodes))
            self.delay = self.delay[self._own]
        self.source, self.target = nodes.astype(np.int32), target.astype(np.int32)
        self.slot = slice(None) if self.part.grid is None and self._own is None else slot
        self._program = program
        # A process has a few synapses of each source, and an end for each source of every projection.
        self.row_ends = np.searchsorted(source, np.arange(n_source + 1)).astype(np.min_scalar_type(-1 - len(source)))
        self._receptor: dict[str, int] = {}
        if self.part.carries == "current" and self.part.receptor is not None:
            model = program.populations[self.part.target].model.name
            self._receptor["receptor_type"] = RECEPTORS_OF_CURRENTS[model, self.part.receptor.name]
        self.longest_row = max(1, int(np.diff(self.row_ends).max(initial=0)))
        self._layer = layers(source, target).astype(np.int32)
        if self._depth > DEEPEST:
            message = f"projection '{self.part.name}': {self._depth:,} synapses between two neurons"
            raise ModelError(f"{message}: backend 'nest' expects at most {DEEPEST:,}")
        self._states: dict[str, Floats] = {}
        self._listed: dict[int, Ints] = {}
        self._has_run = False

    def rows(self, sources: Ints) -> tuple[Ints, Ints]:
        """The synapses of some sources, one after the other, and how many each has."""
        first, number = self.row_ends[sources], self.row_ends[sources + 1] - self.row_ends[sources]
        before = np.cumsum(number) - number
        return np.repeat(first - before, number) + np.arange(int(number.sum())), number

    def models(self) -> list[str]:
        """The copies of its model, one for each transmitter of dopamine; the synapses of a copy share numbers."""
        return [f"neuro_{self.index}_{i}" for i in range(self.n_target if self.part.dopamine_one_to_one else 1)]

    def connect(
        self, nest: Any, ends: tuple[Nodes, Nodes], clock: NestClock, words: Mapping[str, Any], transmitters: Any
    ) -> None:
        """Make the connections.

        Args:
            nest: the module.
            ends: the nodes of source and target.
            clock: of the network.
            words: parameters of the synapse model in NEST's words, of all synapses or one for each.
            transmitters: of dopamine, one or one for each post neuron; None for other models.
        """
        model = SYNAPSES[self.part.synapse.name]
        if self.part.synapse.name in SHARED:
            nest.CopyModel(model, *self.models(), words)
            self._connect(nest, ends, clock, {"synapse_model": self.models()[0]}, np.arange(len(self.source)))
            return
        if transmitters is None:
            self._connect(nest, ends, clock, {"synapse_model": model, **words}, np.arange(len(self.source)))
            return
        places = ends[1].places(np.arange(self.n_target)).tolist()
        for post, name in enumerate(self.models()):
            nest.CopyModel(model, name, {**words, "volume_transmitter": transmitters[places[post]]})
            mine = self.target == post if self.part.dopamine_one_to_one else np.ones(len(self.target), dtype=bool)
            self._connect(nest, ends, clock, {"synapse_model": name}, np.flatnonzero(mine))

    def _connect(
        self, nest: Any, ends: tuple[Nodes, Nodes], clock: NestClock, words: dict[str, Any], among: Ints
    ) -> None:
        weights = self.each(self.part.arriving(self.weights))
        for layer in np.unique(self._layer[among]).tolist():
            synapses = among[self._layer[among] == layer]
            own = {
                "weight": weights[synapses],
                "delay": clock.array_ms(self.delay[synapses]),
                "synapse_label": self._label(layer),
            }
            source, target = (
                nodes.of(ids[synapses].astype(np.int64))
                for nodes, ids in zip(ends, (self.source, self.target), strict=True)
            )
            own |= {word: value[synapses] for word, value in words.items() if np.ndim(value)}
            nest.Connect(source, target, "one_to_one", words | self._receptor | own)

    def _label(self, layer: int) -> int:
        return self.index * DEEPEST + layer

    def each(self, values: NDArray[Any]) -> NDArray[Any]:
        """The value of every synapse of this process, from one for all, or for each weight that the program has."""
        if len(values) == 1:
            return np.broadcast_to(values, (len(self.source), *values.shape[1:]))
        return values[self.slot]

    def given(self, values: NDArray[Any]) -> NDArray[Any]:
        """Of values of all synapses of the projection those that the program has."""
        return self._program.own(self.index, values)

    def joined(self, values: Floats) -> Floats:
        """The values of all synapses of the projection, from those of this process."""
        if self._own is None:
            return self._program.joined(self.index, values)
        share = self._program.share
        places, found = share.gather(self._own), share.gather(values)
        every: Floats = np.empty(places.size)
        every[places] = found
        return every

    def read(self, nest: Any, ends: tuple[Nodes, Nodes], word: str) -> Floats:
        """A state of every synapse of this process, in NEST's word for it."""
        if not self._states:
            words = (*STATES[self.part.synapse.name], "source", "target")
            self._states = {name: np.zeros(len(self.source)) for name in words}
            for layer in range(self._depth):
                connections = self._connections(nest, layer)
                found = connections.get(list(words)) if len(connections) else dict.fromkeys(words, ())
                values = {name: np.atleast_1d(np.array(found[name], dtype=np.float64)) for name in words}
                synapses = self._places(layer, ends, values["source"], values["target"])
                for name in words:
                    self._states[name][synapses] = values[name]
        return self._states[word].copy()

    def write(self, nest: Any, ends: tuple[Nodes, Nodes], word: str, values: Floats) -> None:
        """Set a state of every synapse of this process."""
        self.changed()
        shared = bool((values == values[:1]).all())
        for layer in range(self._depth):
            connections = self._connections(nest, layer)
            if len(connections) and shared:
                connections.set({word: float(values[0])})
            elif len(connections):
                if nest.local_num_threads > 1:
                    # NEST's threads list what is theirs as they come, so the order is another at each call.
                    self._listed = {}
                connections.set([{word: value} for value in values[self._order(connections, layer, ends)].tolist()])

    def changed(self) -> None:
        """What was read is no longer so."""
        self._states = {}

    def ran(self) -> None:
        """States have changed, and at the first time NEST's order of connections."""
        self.changed()
        if not self._has_run:
            self._has_run, self._listed = True, {}

    def _order(self, connections: Any, layer: int, ends: tuple[Nodes, Nodes]) -> Ints:
        """Which synapses these connections of a layer are; kept, since NEST takes long to tell their ends."""
        if layer not in self._listed:
            nodes = connections.get(["source", "target"])
            source, target = (np.atleast_1d(np.array(nodes[name])) for name in ("source", "target"))
            self._listed[layer] = self._places(layer, ends, source, target)
        return self._listed[layer]

    @property
    def _depth(self) -> int:
        return int(self._layer.max(initial=-1)) + 1

    def _connections(self, nest: Any, layer: int) -> Any:
        """The connections of a layer that this process has; NEST puts them in another order when it first runs."""
        return nest.GetConnections(synapse_label=self._label(layer))

    def _places(self, layer: int, ends: tuple[Nodes, Nodes], source: NDArray[Any], target: NDArray[Any]) -> Ints:
        """Which synapses have these nodes at their ends."""
        synapses = np.flatnonzero(self._layer == layer)
        codes = self.source[synapses].astype(np.int64) * self.n_target + self.target[synapses]
        pre, post = (each.neurons(ids.astype(np.int64)) for each, ids in zip(ends, (source, target), strict=True))
        return synapses[np.searchsorted(codes, pre * self.n_target + post)]


_HUGE = float(np.finfo(np.float64).max)

MODEL = "static_synapse"
OF_A_MODEL = 1 << 26
"""Synapses of a copy of NEST's model: a thread has room for 2^27 - 1 of each."""


class RuleProjection:
    """A projection that NEST draws; it is neither read nor set.

    Args:
        program: the network.
        index: which projection.
        weights: the least and the largest that may be drawn.
        before: how many synapses NEST draws for earlier projections.
    """

    def __init__(self, program: Program, index: int, weights: Floats, before: int) -> None:
        self.part, self.index, self.weights = program.projections[index], index, weights
        self._model = f"neuro_static_{before // OF_A_MODEL}"

    def connect(self, nest: Any, source: Any, target: Any, clock: NestClock) -> None:
        """Let NEST draw the synapses.

        Args:
            nest: the module.
            source: the nodes that send.
            target: the nodes that are reached.
            clock: of the network.
        """
        asked = self.part.undrawn
        assert asked is not None
        if self._model not in nest.synapse_models:
            nest.CopyModel(MODEL, self._model)
        weight, delay = (drawn_by_nest(nest, value) for value in (asked.weight, asked.delay))
        negated = self.part.receptor is not None and self.part.receptor.negated
        # What rounds to no step is one step, as in this language.
        late = max(delay, clock.ms(1)) if isinstance(delay, float) else nest.math.max(delay, clock.ms(1))
        words = {"synapse_model": self._model, "weight": weight * -1.0 if negated else weight, "delay": late}
        nest.Connect(source, target, in_words_of_nest(asked.rule), words)

    def ran(self) -> None:
        """Nothing is kept that steps could change."""


def in_words_of_nest(rule: NamedRule) -> dict[str, Any]:
    """A rule as NEST takes it."""
    words: dict[str, Any] = {"rule": rule.name}
    match rule:
        case fixed_indegree(n=n):
            words["indegree"] = n
        case fixed_outdegree(n=n):
            words["outdegree"] = n
        case fixed_total_number(n=n):
            words["N"] = n
        case pairwise_bernoulli(p=p):
            words["p"] = p
    if isinstance(rule, all_to_all | fixed_indegree | fixed_outdegree | fixed_total_number | pairwise_bernoulli):
        words["allow_autapses"] = rule.autapses
    if isinstance(rule, fixed_indegree | fixed_outdegree | fixed_total_number):
        words["allow_multapses"] = rule.multapses
    return words


def drawn_by_nest(nest: Any, value: float | Distribution) -> Any:
    """A number, or the parameter of NEST that draws a distribution."""
    match value:
        case uniform():
            return value.low if value.low == value.high else nest.random.uniform(value.low, value.high)
        case normal(std=0.0):
            return value.mean
        case normal():
            drawn = nest.random.normal(mean=value.mean, std=value.std)
        case lognormal(std=0.0):
            return float(np.exp(value.mean))
        case lognormal():
            drawn = nest.random.lognormal(mean=value.mean, std=value.std)
        case _:
            return value
    if np.isinf(value.low) and np.isinf(value.high):
        return drawn
    return nest.math.redraw(drawn, min=max(value.low, -_HUGE), max=min(value.high, _HUGE))
