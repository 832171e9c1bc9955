"""The synapses of a projection as a program has them: drawn, in order, those of one part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Apart, Block, Blocks
from neuro.compiler.connections import Connections, listed_one_by_one
from neuro.compiler.memory import SynapseRoom, weight_room
from neuro.compiler.shapes import End, size
from neuro.compiler.values import Room, Steps, delay_steps, per_synapse
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
    """The synapses of a projection, and what each has.

    Attributes:
        found: the connections; of their attributes those of a program are valid.
        delay: in steps, shape (1,) where shared.
        weight: shape (1,) where shared.
        rule: the synapse model, with a number for each where it has no single one.
        by_delay: whether those of each source are sorted by delay.
        whole_layout: the layout of those of all parts together.
        blocks: where synapses stay in blocks, these; arrays with a value for each are empty then.
    """

    found: Connections
    delay: Steps
    weight: Floats
    rule: Synapse
    by_delay: bool
    whole_layout: str
    blocks: tuple[SynapseBlock, ...] = ()

    @property
    def span(self) -> tuple[int, int]:
        """The fewest and the most steps in a delay; of no synapses 1."""
        delays = [block.delay for block in self.blocks] or [self.delay]
        spans = [(int(delay.min()), int(delay.max())) for delay in delays if delay.size]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else (1, 1)

    @property
    def weights(self) -> tuple[NDArray[np.floating[Any]], ...]:
        """The weights of all, in one or several arrays."""
        return tuple(block.weight for block in self.blocks) or (self.weight,)


@dataclass(frozen=True, eq=False)
class Drawing:
    """Draws the synapses of a projection at once; `Divided` those of several blocks.

    Args:
        part: the projection.
        blocks: its rule's.
        wired: gives the synapses of a file; None for other rules.
        ends: the neurons at both ends.
        clock: of the network.
        seed: of the draws.
        apart: gives what lies between the neurons of the populations.
        ordered: whether drawn synapses are sorted by delay.
        among: the first neuron of the target whose synapses are kept, and the end; None: those of all.
        threads: how many draw.
    """

    part: Projection
    blocks: Blocks
    wired: Callable[[], Connections] | None
    ends: tuple[End, End]
    clock: Clock
    seed: int
    apart: Apart
    ordered: bool
    among: tuple[int, int] | None
    threads: int

    def synapses(self, room: SynapseRoom | None) -> Synapses:
        """The synapses in order; `room` is memory that may be used for those of all targets."""
        only = Block(0, 0, 0)
        if self.wired is not None:
            found = self.wired()
        else:
            found = placed(self.blocks.whole(None if room is None else room.targets), *self.ends)
        # Delays before weights, each with a key of its own: adding a distribution to one changes nothing of the other.
        delay, by_delay = self._delay(found, only), False
        if self.ordered:
            found, delay, by_delay = _by_delay(self.part, found, delay)
        whole_layout = found.layout
        columns = self._columns(found, only, self._room_of_weights(found.size, room))
        weight = columns.pop("weight")
        if self.among is None:
            return Synapses(found, delay, weight, with_numbers(self.part.synapse, columns), by_delay, whole_layout)
        found = listed_one_by_one(found, self.ends[0].size, self.ends[1].size)
        piece = Piece(only, found, self._kept(found), delay)

        def some(values: NDArray[Any]) -> NDArray[Any]:
            return piece.some(values) if values.size == found.size else values

        rule = with_numbers(self.part.synapse, {name: some(values) for name, values in columns.items()})
        targets = piece.some(found.targets)
        kept = Connections("csr", targets.size, piece.row_ends, targets)
        return Synapses(kept, some(delay), some(weight), rule, by_delay, whole_layout)

    def _room_of_weights(self, synapses: int, room: SynapseRoom | None) -> Room | None:
        """Memory for so many weights, if there is some that suits them."""
        if room is None:
            return weight_room(self.part, synapses) if self.ordered else None
        return room.weight

    def _kept(self, found: Connections) -> NDArray[np.bool_] | None:
        """Which synapses are onto the neurons of the part; None: all."""
        if self.among is None:
            return None
        first, end = self.among
        kept: NDArray[np.bool_] = (found.targets >= first) & (found.targets < end)
        return None if kept.all() else kept

    def _delay(self, found: Connections, block: Block) -> Steps:
        drawn = generator(*block.key((self.seed, "delay", self.part.name)))
        return delay_steps(self.part.delay, found, self.clock, "delay", drawn, self.apart, self.ordered)

    def _columns(self, found: Connections, block: Block, room: Room | None) -> dict[str, Floats]:
        """The weights, and those parameters of the synapse model that are no single number, by field."""
        part, rule = self.part, self.part.synapse
        drawn = generator(*block.key((self.seed, "weight", part.name)))
        columns = {"weight": per_synapse(part.weight, found, "weight", drawn, self.apart, room)}
        for name, word in self._parameters.items():
            drawn = generator(*block.key((self.seed, "synapse_parameter", f"{part.name}.{word}")))
            what = f"{rule.name}.{word}"
            each = per_synapse(rule.parameters()[word], found, what, drawn, self.apart)
            columns[name] = check(rule.quantities()[word], each, what)  # what was drawn may be out of bounds
        return columns

    @cached_property
    def _parameters(self) -> dict[str, str]:
        """The parameters of the synapse model that have a number for each synapse."""
        return self.part.synapse.fields_of_each()


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Synapses of a block.

    Attributes:
        block: the block.
        found: the connections.
        kept: which of them are of the part; None: all.
        delay: as of `Synapses`.
    """

    block: Block
    found: Connections
    kept: NDArray[np.bool_] | None
    delay: Steps

    def some(self, values: NDArray[Any]) -> NDArray[Any]:
        """Of the values of all synapses those of the part."""
        return values if self.kept is None else values[self.kept]

    @property
    def row_ends(self) -> Ints:
        """Where those of the part end, source by source."""
        return (
            self.found.row_ends
            if self.kept is None
            else np.concatenate(([0], np.cumsum(self.kept)))[self.found.row_ends]
        )


def placed(found: Connections, source: End, target: End) -> Connections:
    """The same synapses between the neurons of the populations, sorted by source, then target."""
    if source.ids is None and target.ids is None:
        return found
    found = listed_one_by_one(found, size(source.shape), size(target.shape))
    sources, degrees, order, shared = source.neurons, np.diff(found.row_ends), found.order, found.shared
    targets = target.neurons.astype(np.int32)[found.targets]
    if not (source.ascends and target.ascends):
        moved = np.lexsort((targets, np.repeat(sources, degrees)))
        targets, order = targets[moved], moved if order is None else order[moved]
        shared = None if shared is None else shared[moved]
    out = np.zeros(source.size + 1, dtype=np.int64)
    out[sources + 1] = degrees
    return replace(found, row_ends=np.cumsum(out), targets=targets, order=order, shared=shared)


def with_numbers(rule: Synapse, numbers: Mapping[str, Floats]) -> Synapse:
    """The synapse model with numbers of each synapse; of no synapses it has any."""
    defaults = {entry.name: entry.default for entry in fields(rule)}
    each = {name: values if values.size else defaults[name] for name, values in numbers.items()}
    return replace(rule, **each) if each else rule


def by_delay_in_place(row_ends: Ints, delay: Steps, targets: NDArray[Any], others: Sequence[NDArray[Any]]) -> None:
    """Put the synapses of each source in the order of their delays, in place."""
    from neuro.compiler.rows import by_delay

    if delay.size:
        by_delay(row_ends, delay, int(delay.min()), int(delay.max()), targets, others)


def _by_delay(part: Projection, found: Connections, delay: Steps) -> tuple[Connections, Steps, bool]:
    """The synapses of each source by delay, where all is drawn or they are listed so; whether they are.

    A backend that delivers them in this order would else need a second copy.
    """
    if found.layout == "csr" and delay.size > 1:
        if isinstance(part.delay, Distribution) and not found.listed:
            shared = [] if found.shared is None else [found.shared]
            by_delay_in_place(found.row_ends, delay, found.targets, shared)
            return found, delay, True
        if found.order is not None and found.listed == ((found.size,),):
            as_listed = np.argsort(found.order)
            pre = np.repeat(np.arange(found.row_ends.size - 1), np.diff(found.row_ends))[as_listed]
            post, late = found.targets[as_listed], delay[as_listed]
            if np.array_equal(np.lexsort((post, late, pre)), np.arange(found.size)):
                factors = {word: values[as_listed] for word, values in found.factors.items()}
                return replace(found, targets=post, order=None, factors=factors), late, True
    return found, delay, False
