"""Synapses of a projection in the form of a program: drawn, sorted, and restricted to a share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Block, Blocks, GetGeometry
from neuro.compiler.connections import Connections, listed_one_by_one
from neuro.compiler.memory import SynapseBuffers, weight_buffer
from neuro.compiler.shapes import End, size
from neuro.compiler.values import Buffer, Steps, delay_steps, per_synapse
from neuro.core.checks import check
from neuro.core.clock import Clock
from neuro.core.keyed_random import generator
from neuro.model.distributions import Distribution
from neuro.model.parts import Projection
from neuro.model.synapses import Synapse
from neuro.program.compact import SynapseBlock
from neuro.program.program import Floats, Ints


@dataclass(frozen=True, eq=False)
class Synapses:
    """Synapses of a projection, with values.

    Attributes:
        connections: the connections. Only the attributes that a program also has are valid.
        delay: delays in steps, shape (1,) if shared.
        weight: weights, shape (1,) if shared.
        rule: the synapse model, with arrays for parameters that have a value per synapse.
        by_delay: whether the synapses of each source are sorted by delay.
        whole_layout: the layout of the synapses of all shares together.
        blocks: the blocks, if synapses stay in blocks; arrays with a value per synapse are then empty.
    """

    connections: Connections
    delay: Steps
    weight: Floats
    rule: Synapse
    by_delay: bool
    whole_layout: str
    blocks: tuple[SynapseBlock, ...] = ()

    @property
    def span(self) -> tuple[int, int]:
        """The smallest and the largest delay in steps; (1, 1) without synapses."""
        delays = [block.delay for block in self.blocks] or [self.delay]
        spans = [(int(delay.min()), int(delay.max())) for delay in delays if delay.size]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else (1, 1)

    @property
    def weights(self) -> tuple[NDArray[np.floating[Any]], ...]:
        """The weights of all synapses, in one or several arrays."""
        return tuple(block.weight for block in self.blocks) or (self.weight,)


@dataclass(frozen=True, eq=False)
class Drawing:
    """Drawing of the synapses of a projection, all at once. `Divided` draws them in blocks.

    Args:
        part: the projection.
        blocks: the blocks of its rule.
        wired: function that returns the synapses of a file; None for other rules.
        ends: the neurons at both ends.
        clock: clock of the network.
        seed: seed of the draws.
        get_geometry: returns the positions and distances of the neurons of the populations.
        ordered: whether drawn synapses are sorted by delay.
        target_range: first target neuron with stored synapses, and the end; None: all targets.
        threads: number of threads that draw.
    """

    part: Projection
    blocks: Blocks
    wired: Callable[[], Connections] | None
    ends: tuple[End, End]
    clock: Clock
    seed: int
    get_geometry: GetGeometry
    ordered: bool
    target_range: tuple[int, int] | None
    threads: int

    def synapses(self, buffer: SynapseBuffers | None) -> Synapses:
        """Return the synapses in order. `buffer` is memory that may be used for all targets."""
        selected_only = Block(0, 0, 0)
        if self.wired is not None:
            connections = self.wired()
        else:
            connections = in_populations(self.blocks.whole(None if buffer is None else buffer.targets), *self.ends)
        # Delays and weights have separate keys: a distribution of delays does not change the weights.
        delay, by_delay = self._delay(connections, selected_only), False
        if self.ordered:
            connections, delay, by_delay = _by_delay(self.part, connections, delay)
        whole_layout = connections.layout
        columns = self._columns(connections, selected_only, self._weight_buffer(connections.size, buffer))
        weight = columns.pop("weight")
        if self.target_range is None:
            return Synapses(
                connections, delay, weight, with_numbers(self.part.synapse, columns), by_delay, whole_layout
            )
        connections = listed_one_by_one(connections, self.ends[0].size, self.ends[1].size)
        piece = Piece(selected_only, connections, self._mask(connections), delay)

        def select(values: NDArray[Any]) -> NDArray[Any]:
            return piece.select(values) if values.size == connections.size else values

        rule = with_numbers(self.part.synapse, {name: select(values) for name, values in columns.items()})
        targets = piece.select(connections.targets)
        selected = Connections("csr", targets.size, piece.row_ends, targets)
        return Synapses(selected, select(delay), select(weight), rule, by_delay, whole_layout)

    def _weight_buffer(self, synapses: int, buffer: SynapseBuffers | None) -> Buffer | None:
        """Return memory for the weights, if a buffer of the right type is available."""
        if buffer is None:
            return weight_buffer(self.part, synapses) if self.ordered else None
        return buffer.weight

    def _mask(self, connections: Connections) -> NDArray[np.bool_] | None:
        """Return a mask of the synapses onto the neurons of the share; None: all."""
        if self.target_range is None:
            return None
        first, end = self.target_range
        mask: NDArray[np.bool_] = (connections.targets >= first) & (connections.targets < end)
        return None if mask.all() else mask

    def _delay(self, connections: Connections, block: Block) -> Steps:
        rng = generator(*block.key((self.seed, "delay", self.part.name)))
        return delay_steps(self.part.delay, connections, self.clock, "delay", rng, self.get_geometry, self.ordered)

    def _columns(self, connections: Connections, block: Block, buffer: Buffer | None) -> dict[str, Floats]:
        """Return the weights, and the parameters of the synapse model with a value per synapse, by field."""
        part, rule = self.part, self.part.synapse
        rng = generator(*block.key((self.seed, "weight", part.name)))
        columns = {"weight": per_synapse(part.weight, connections, "weight", rng, self.get_geometry, buffer)}
        for name, word in self._parameters.items():
            rng = generator(*block.key((self.seed, "synapse_parameter", f"{part.name}.{word}")))
            label = f"{rule.name}.{word}"
            values = per_synapse(rule.parameters()[word], connections, label, rng, self.get_geometry)
            columns[name] = check(rule.quantities()[word], values, label)  # drawn values may be out of bounds
        return columns

    @cached_property
    def _parameters(self) -> dict[str, str]:
        """The parameters of the synapse model with a value per synapse."""
        return self.part.synapse.per_synapse_fields()


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Synapses of a block.

    Attributes:
        block: the block.
        connections: the connections.
        mask: a mask of the synapses of the share; None: all.
        delay: delays, as in `Synapses`.
    """

    block: Block
    connections: Connections
    mask: NDArray[np.bool_] | None
    delay: Steps

    def select(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of the synapses of the share, from the values of all synapses."""
        return values if self.mask is None else values[self.mask]

    @property
    def row_ends(self) -> Ints:
        """Row ends of the synapses of the share."""
        return (
            self.connections.row_ends
            if self.mask is None
            else np.concatenate(([0], np.cumsum(self.mask)))[self.connections.row_ends]
        )


def in_populations(connections: Connections, source: End, target: End) -> Connections:
    """Return the same synapses between the neurons of the populations, sorted by source, then target."""
    if source.ids is None and target.ids is None:
        return connections
    connections = listed_one_by_one(connections, size(source.shape), size(target.shape))
    sources, degrees, order, shared = (
        source.neurons,
        np.diff(connections.row_ends),
        connections.order,
        connections.shared,
    )
    targets = target.neurons.astype(np.int32)[connections.targets]
    if not (source.ascends and target.ascends):
        permutation = np.lexsort((targets, np.repeat(sources, degrees)))
        targets, order = targets[permutation], permutation if order is None else order[permutation]
        shared = None if shared is None else shared[permutation]
    out = np.zeros(source.size + 1, dtype=np.int64)
    out[sources + 1] = degrees
    return replace(connections, row_ends=np.cumsum(out), targets=targets, order=order, shared=shared)


def with_numbers(rule: Synapse, numbers: Mapping[str, Floats]) -> Synapse:
    """Return the synapse model with arrays of values per synapse, or with the defaults if there are no synapses."""
    defaults = {entry.name: entry.default for entry in fields(rule)}
    arrays = {name: values if values.size else defaults[name] for name, values in numbers.items()}
    return replace(rule, **arrays) if arrays else rule


def by_delay_in_place(row_ends: Ints, delay: Steps, targets: NDArray[Any], others: Sequence[NDArray[Any]]) -> None:
    """Sort the synapses of each source by delay, in place."""
    from neuro.compiler.rows import by_delay

    if delay.size:
        by_delay(row_ends, delay, int(delay.min()), int(delay.max()), targets, others)


def _by_delay(part: Projection, connections: Connections, delay: Steps) -> tuple[Connections, Steps, bool]:
    """Sort each source's synapses by delay, unless a list fixed their order.

    Return connections, delays and whether they are sorted. A backend that delivers spikes in the order of delays would
    otherwise need a second copy.
    """
    if connections.layout == "csr" and delay.size > 1:
        if isinstance(part.delay, Distribution) and not connections.weight_shapes:
            shared = [] if connections.shared is None else [connections.shared]
            by_delay_in_place(connections.row_ends, delay, connections.targets, shared)
            return connections, delay, True
        if connections.order is not None and connections.weight_shapes == ((connections.size,),):
            as_listed = np.argsort(connections.order)
            pre = np.repeat(np.arange(connections.row_ends.size - 1), np.diff(connections.row_ends))[as_listed]
            post, delays = connections.targets[as_listed], delay[as_listed]
            if np.array_equal(np.lexsort((post, delays, pre)), np.arange(connections.size)):
                factors = {word: values[as_listed] for word, values in connections.factors.items()}
                return replace(connections, targets=post, order=None, factors=factors), delays, True
    return connections, delay, False
