"""A projection as connections of NEST, or as a rule by which NEST draws connections.

NEST identifies connections by their two nodes and a label. So the synapses between the same two neurons are in
different layers, and each layer of a projection has its own label. NEST lists connections in its own order.
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
    """The nodes of the neurons of a population.

    Attributes:
        first: number of the first node; the numbers of the other nodes follow.
        at: place of each neuron's node; None if nodes are in the order of neurons.
    """

    first: int
    at: Ints | None

    def places(self, neurons: Ints) -> Ints:
        """Return the places of the nodes of some neurons, counted from 0."""
        return neurons if self.at is None else self.at[neurons]

    def of(self, neurons: Ints) -> Ints:
        """Return the numbers of the nodes of some neurons."""
        return self.first + self.places(neurons)

    def in_turn(self, neurons: int) -> Ints:
        """Return the neurons in the order of their nodes."""
        return np.arange(neurons) if self.at is None else np.argsort(self.at)

    def neurons(self, nodes: Ints) -> Ints:
        """Return the neurons of some nodes."""
        places = nodes - self.first
        return places if self.at is None else np.argsort(self.at)[places]


def node_places(neurons: int, processes: int) -> Ints:
    """Return the place of each neuron's node, so that each process has neighbouring neurons.

    NEST assigns nodes to processes in turn. Example: of 5 neurons and 2 processes, the nodes 0 2 4 belong to process 0,
    so the neurons 0 1 2 get the nodes 0 2 4, and the neurons 3 4 get the nodes 1 3.
    """
    return np.concatenate([np.arange(rank, neurons, processes) for rank in range(processes)])


MAX_LABELS = 1 << 14
"""Number of labels of each projection. NEST's labels have 31 bits, so there may be 131,072 projections."""


def layers(source: Ints, target: Ints) -> Ints:
    """Return the layer of each synapse: the number of earlier synapses between the same two neurons.

    The synapses are sorted by source.

    Example: the synapses 0-5, 0-5, 0-7, 1-5 are in the layers 0, 1, 0, 0.
    """
    order = np.lexsort((target, source))
    pre, post = source[order], target[order]
    is_new_pair = np.ones(len(pre), dtype=bool)
    is_new_pair[1:] = (pre[1:] != pre[:-1]) | (post[1:] != post[:-1])
    starts = np.flatnonzero(is_new_pair)
    numbers = np.empty(len(pre), dtype=np.int64)
    numbers[order] = np.arange(len(pre)) - np.repeat(starts, np.diff(np.append(starts, len(pre))))
    return numbers


class NestProjection:
    """The synapses of a projection that this process has.

    Args:
        program: the network.
        index: index of the projection.
        weights: all weights in the order of the program. If the program has only a share of the synapses, the weights
            of this share.

    Attributes:
        source, target, delay: source, target and delay (in steps) of every synapse, sorted by source.
        slot: index of each synapse's weight.
        row_ends: synapses of source i are row_ends[i] : row_ends[i + 1].
        weights: the present weights of a static projection, or the initial weights of a plastic projection.
    """

    def __init__(self, program: Program, index: int, weights: Floats) -> None:
        self.part, self.index, self.weights = program.projections[index], index, weights
        n_source, self.n_target = (program.populations[i].size for i in (self.part.source, self.part.target))
        has_share = self.part.share.number > 1
        source, target, slot = program.own_synapses(index)
        self.delay = np.broadcast_to(self.part.delay, len(source))
        # If the program has all synapses, this process only has the synapses onto its own neurons.
        self._own: Ints | None = None
        if program.share.number > 1 and not has_share:
            begin, end = program.share.of(self.n_target)
            self._own = np.flatnonzero((target >= begin) & (target < end))
        noise_node = first_node(program, index)
        nodes = source if noise_node is None else noise_node + np.arange(source.size)
        if self._own is not None:
            source, target, slot, nodes = (ids[self._own] for ids in (source, target, slot, nodes))
            self.delay = self.delay[self._own]
        self.source, self.target = nodes.astype(np.int32), target.astype(np.int32)
        self.slot = slice(None) if self.part.grid is None and self._own is None else slot
        self._program = program
        # A process has few synapses of each source, but an end for each source, so ends get the smallest type.
        self.row_ends = np.searchsorted(source, np.arange(n_source + 1)).astype(np.min_scalar_type(-1 - len(source)))
        self._receptor: dict[str, int] = {}
        if self.part.carries == "current" and self.part.receptor is not None:
            model = program.populations[self.part.target].model.name
            self._receptor["receptor_type"] = RECEPTORS_OF_CURRENTS[model, self.part.receptor.name]
        self.longest_row = max(1, int(np.diff(self.row_ends).max(initial=0)))
        self._layer = layers(source, target).astype(np.int32)
        if self._n_layers > MAX_LABELS:
            message = f"projection '{self.part.name}': {self._n_layers:,} synapses between two neurons"
            raise ModelError(f"{message}: backend 'nest' expects at most {MAX_LABELS:,}")
        self._states: dict[str, Floats] = {}
        self._listed: dict[int, Ints] = {}  # by layer, the synapses in NEST's order of connections
        self._has_run = False

    def rows(self, sources: Ints) -> tuple[Ints, Ints]:
        """Return the synapses of some sources, source by source, and the number of synapses of each source."""
        first, number = self.row_ends[sources], self.row_ends[sources + 1] - self.row_ends[sources]
        n_before = np.cumsum(number) - number
        return np.repeat(first - n_before, number) + np.arange(int(number.sum())), number

    def models(self) -> list[str]:
        """Return the names of the copies of the synapse model, one per dopamine transmitter.

        Synapses of a copy share their numbers.
        """
        return [f"neuro_{self.index}_{i}" for i in range(self.n_target if self.part.dopamine_one_to_one else 1)]

    def connect(
        self,
        nest: Any,
        ends: tuple[Nodes, Nodes],
        clock: NestClock,
        nest_parameters: Mapping[str, Any],
        transmitters: Any,
    ) -> None:
        """Make the connections in NEST.

        Args:
            nest: the module.
            ends: nodes of source and target.
            clock: clock of the network.
            nest_parameters: parameters of the synapse model by NEST's names, for all synapses or one value for each.
            transmitters: volume transmitters of dopamine, one or one per post neuron; None for other models.
        """
        model = SYNAPSES[self.part.synapse.name]
        if self.part.synapse.name in SHARED:
            nest.CopyModel(model, *self.models(), nest_parameters)
            self._connect(nest, ends, clock, {"synapse_model": self.models()[0]}, np.arange(len(self.source)))
            return
        if transmitters is None:
            self._connect(nest, ends, clock, {"synapse_model": model, **nest_parameters}, np.arange(len(self.source)))
            return
        places = ends[1].places(np.arange(self.n_target)).tolist()
        for post, name in enumerate(self.models()):
            nest.CopyModel(model, name, {**nest_parameters, "volume_transmitter": transmitters[places[post]]})
            is_own = self.target == post if self.part.dopamine_one_to_one else np.ones(len(self.target), dtype=bool)
            self._connect(nest, ends, clock, {"synapse_model": name}, np.flatnonzero(is_own))

    def _connect(
        self, nest: Any, ends: tuple[Nodes, Nodes], clock: NestClock, nest_parameters: dict[str, Any], candidates: Ints
    ) -> None:
        weights = self.per_synapse(self.part.arriving(self.weights))
        for layer in np.unique(self._layer[candidates]).tolist():
            synapses = candidates[self._layer[candidates] == layer]
            own_values = {
                "weight": weights[synapses],
                "delay": clock.array_ms(self.delay[synapses]),
                "synapse_label": self._label(layer),
            }
            source, target = (
                nodes.of(ids[synapses].astype(np.int64))
                for nodes, ids in zip(ends, (self.source, self.target), strict=True)
            )
            own_values |= {name: value[synapses] for name, value in nest_parameters.items() if np.ndim(value)}
            nest.Connect(source, target, "one_to_one", nest_parameters | self._receptor | own_values)

    def _label(self, layer: int) -> int:
        return self.index * MAX_LABELS + layer

    def per_synapse(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the value of every synapse of this process, from a single value, or from a value per weight."""
        if len(values) == 1:
            return np.broadcast_to(values, (len(self.source), *values.shape[1:]))
        return values[self.slot]

    def own_values(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of the program's synapses, from the values of all synapses of the projection."""
        return self._program.own(self.index, values)

    def all_values(self, values: Floats) -> Floats:
        """Return the values of all synapses of the projection, from the values of this process."""
        if self._own is None:
            return self._program.joined(self.index, values)
        share = self._program.share
        places, all_values = share.gather(self._own), share.gather(values)
        values_of_all: Floats = np.empty(places.size)
        values_of_all[places] = all_values
        return values_of_all

    def read(self, nest: Any, ends: tuple[Nodes, Nodes], state: str) -> Floats:
        """Return a state of every synapse of this process, by NEST's name."""
        if not self._states:
            names = (*STATES[self.part.synapse.name], "source", "target")
            self._states = {name: np.zeros(len(self.source)) for name in names}
            for layer in range(self._n_layers):
                connections = self._connections(nest, layer)
                answers = connections.get(list(names)) if len(connections) else dict.fromkeys(names, ())
                values = {name: np.atleast_1d(np.array(answers[name], dtype=np.float64)) for name in names}
                synapses = self._places(layer, ends, values["source"], values["target"])
                for name in names:
                    self._states[name][synapses] = values[name]
        return self._states[state].copy()

    def write(self, nest: Any, ends: tuple[Nodes, Nodes], name: str, values: Floats) -> None:
        """Set a state of every synapse of this process."""
        self.invalidate()
        are_equal = bool((values == values[:1]).all())
        for layer in range(self._n_layers):
            connections = self._connections(nest, layer)
            if len(connections) and are_equal:
                connections.set({name: float(values[0])})
            elif len(connections):
                if nest.local_num_threads > 1:
                    # NEST's threads list their connections in any order, so the order may differ at each call.
                    self._listed = {}
                connections.set([{name: value} for value in values[self._order(connections, layer, ends)].tolist()])

    def invalidate(self) -> None:
        """Discard the cached states."""
        self._states = {}

    def after_run(self) -> None:
        """Discard the cached states after a run, and after the first run also NEST's order of connections."""
        self.invalidate()
        if not self._has_run:
            self._has_run, self._listed = True, {}

    def _order(self, connections: Any, layer: int, ends: tuple[Nodes, Nodes]) -> Ints:
        """Return the synapses of NEST's connections of a layer, cached because NEST takes long to list the ends."""
        if layer not in self._listed:
            nodes = connections.get(["source", "target"])
            source, target = (np.atleast_1d(np.array(nodes[name])) for name in ("source", "target"))
            self._listed[layer] = self._places(layer, ends, source, target)
        return self._listed[layer]

    @property
    def _n_layers(self) -> int:
        return int(self._layer.max(initial=-1)) + 1

    def _connections(self, nest: Any, layer: int) -> Any:
        """Return NEST's connections of a layer on this process. Their order changes when NEST first runs."""
        return nest.GetConnections(synapse_label=self._label(layer))

    def _places(self, layer: int, ends: tuple[Nodes, Nodes], source: NDArray[Any], target: NDArray[Any]) -> Ints:
        """Return the synapses between pairs of nodes."""
        synapses = np.flatnonzero(self._layer == layer)
        codes = self.source[synapses].astype(np.int64) * self.n_target + self.target[synapses]
        pre, post = (end.neurons(ids.astype(np.int64)) for end, ids in zip(ends, (source, target), strict=True))
        return synapses[np.searchsorted(codes, pre * self.n_target + post)]


_HUGE = float(np.finfo(np.float64).max)

MODEL = "static_synapse"
OF_A_MODEL = 1 << 26
"""Number of synapses per copy of NEST's model. A thread holds up to 2^27 - 1 synapses of each model."""


class RuleProjection:
    """A projection that NEST draws. The synapses can be neither read nor set.

    Args:
        program: the network.
        index: index of the projection.
        weights: the smallest and the largest weight that may be drawn.
        n_before: number of synapses that NEST draws for earlier projections.
    """

    def __init__(self, program: Program, index: int, weights: Floats, n_before: int) -> None:
        self.part, self.index, self.weights = program.projections[index], index, weights
        self._model = f"neuro_static_{n_before // OF_A_MODEL}"

    def connect(self, nest: Any, source: Any, target: Any, clock: NestClock) -> None:
        """Let NEST draw the synapses.

        Args:
            nest: the module.
            source: nodes that send.
            target: nodes that receive.
            clock: clock of the network.
        """
        undrawn = self.part.undrawn
        assert undrawn is not None
        if self._model not in nest.synapse_models:
            nest.CopyModel(MODEL, self._model)
        weight, delay = (drawn_by_nest(nest, value) for value in (undrawn.weight, undrawn.delay))
        negated = self.part.receptor is not None and self.part.receptor.negated
        # As in this language, a delay that rounds to 0 steps is one step.
        delays = max(delay, clock.ms(1)) if isinstance(delay, float) else nest.math.max(delay, clock.ms(1))
        nest_parameters = {
            "synapse_model": self._model,
            "weight": weight * -1.0 if negated else weight,
            "delay": delays,
        }
        nest.Connect(source, target, nest_rule(undrawn.rule), nest_parameters)

    def after_run(self) -> None:
        """Do nothing, because no state is cached."""


def nest_rule(rule: NamedRule) -> dict[str, Any]:
    """Return a connection rule by NEST's names."""
    parameters: dict[str, Any] = {"rule": rule.name}
    match rule:
        case fixed_indegree(n=n):
            parameters["indegree"] = n
        case fixed_outdegree(n=n):
            parameters["outdegree"] = n
        case fixed_total_number(n=n):
            parameters["N"] = n
        case pairwise_bernoulli(p=p):
            parameters["p"] = p
    if isinstance(rule, all_to_all | fixed_indegree | fixed_outdegree | fixed_total_number | pairwise_bernoulli):
        parameters["allow_autapses"] = rule.autapses
    if isinstance(rule, fixed_indegree | fixed_outdegree | fixed_total_number):
        parameters["allow_multapses"] = rule.multapses
    return parameters


def drawn_by_nest(nest: Any, value: float | Distribution) -> Any:
    """Return a number, or NEST's parameter that draws from a distribution."""
    match value:
        case uniform():
            return value.low if value.low == value.high else nest.random.uniform(value.low, value.high)
        case normal(std=0.0):
            return value.mean
        case normal():
            parameter = nest.random.normal(mean=value.mean, std=value.std)
        case lognormal(std=0.0):
            return float(np.exp(value.mean))
        case lognormal():
            parameter = nest.random.lognormal(mean=value.mean, std=value.std)
        case _:
            return value
    if np.isinf(value.low) and np.isinf(value.high):
        return parameter
    return nest.math.redraw(parameter, min=max(value.low, -_HUGE), max=min(value.high, _HUGE))
