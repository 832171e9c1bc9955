"""The synapses of a projection as a program has them: drawn block by block, in order, those of one part."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Apart, Block, Blocks
from neuro.compiler.connections import Connections, listed_one_by_one
from neuro.compiler.memory import SynapseRoom, has_each, weight_room
from neuro.compiler.shapes import End, size
from neuro.compiler.values import Room, Steps, delay_steps, per_synapse
from neuro.core.checks import check
from neuro.core.clock import Clock
from neuro.core.keyed_random import generator
from neuro.core.memory import give_back
from neuro.core.system import mapped
from neuro.model.distributions import Distribution
from neuro.model.parts import Projection
from neuro.model.rules import all_to_all, one_to_one
from neuro.model.synapses import Synapse
from neuro.program.compact import SynapseBlock
from neuro.program.program import Floats, Ints, StoredSynapses

_OF_THREAD, _NOTHING = threading.local(), np.zeros(0)

LARGE = 1 << 24
"""Synapses from which on the memory in which blocks were drawn is given back: to be given it anew takes time, too."""


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
    """Draws the synapses of a projection.

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
        if self.wired is None and len(self.blocks.all) > 1 and not self._are_alike:
            return self._of_blocks(room)
        return self._undivided(room)

    def _undivided(self, room: SynapseRoom | None) -> Synapses:
        """All synapses, of one block."""
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
            return Synapses(found, delay, weight, _with(self.part.synapse, columns), by_delay, whole_layout)
        found = listed_one_by_one(found, self.ends[0].size, self.ends[1].size)
        piece = Piece(only, found, self._kept(found), delay)

        def some(values: NDArray[Any]) -> NDArray[Any]:
            return piece.some(values) if values.size == found.size else values

        rule = _with(self.part.synapse, {name: some(values) for name, values in columns.items()})
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

    def _of_blocks(self, room: SynapseRoom | None) -> Synapses:
        """The synapses of several blocks."""
        needed = [block for block in self.blocks.all if self._reached(block)] or [self.blocks.all[0]]
        if self._stay:
            return self._in_blocks(tuple(mapped(self._block, needed, self.threads)))
        pieces = dict(enumerate(mapped(self._begun, needed, self.threads)))
        whole_layout, shape = self._layout, (self.ends[0].size, self.ends[1].size)
        layout = whole_layout if self.among is None else "csr"
        joint = Joint(layout, shape, needed, [piece.row_ends for piece in pieces.values()])
        targets = joint.room(np.int32, None if room is None else room.targets)
        delay = pieces[0].delay
        if has_each(self.part.delay):
            delay = joint.room(np.result_type(*(piece.delay for piece in pieces.values())))
        columns = {name: joint.room(np.float64) for name in self._parameters}
        if has_each(self.part.weight):
            columns["weight"] = joint.room(np.float64, self._room_of_weights(joint.size, room))

        def finish(k: int) -> Floats:
            piece = pieces.pop(k)  # freed when it is in its place: two copies of all would not fit
            joint.put(k, piece.some(piece.found.targets), targets)
            if has_each(self.part.delay):
                joint.put(k, piece.some(piece.delay), delay)
            values = self._columns(piece.found, piece.block, _scratch(piece.found.size))
            for name, column in columns.items():
                joint.put(k, piece.some(values[name]), column)
            return values["weight"]

        weights = list(mapped(finish, range(len(needed)), self.threads))
        if joint.size >= LARGE:
            give_back()
        found = joint.connections(targets)
        rows = [*columns.values(), *([delay] if has_each(self.part.delay) else [])]
        if found.layout == "csr" and not self.ends[1].ascends:
            pre = np.repeat(np.arange(found.row_ends.size - 1), np.diff(found.row_ends))
            order = np.lexsort((found.targets, pre))
            for column in (found.targets, *rows):
                column[:] = column[order]
        by_delay = layout == "csr" and self._sorts
        if by_delay:
            _by_delay_in_place(found.row_ends, delay, targets, [*columns.values()])
        weight = columns.pop("weight", weights[0])
        return Synapses(found, delay, weight, _with(self.part.synapse, columns), by_delay, whole_layout)

    @property
    def _sorts(self) -> bool:
        """Whether synapses of several blocks are sorted by delay, if these are listed one by one."""
        return (
            self.ordered and isinstance(self.part.delay, Distribution) and not isinstance(self.blocks.rule, one_to_one)
        )

    @property
    def _stay(self) -> bool:
        """Whether synapses stay in blocks: a backend that makes rows of its own reads them as they are."""
        whole = self.among is None and self._layout == "csr" and self.ends[1].ascends
        return whole and self._sorts and not self._parameters

    def _block(self, block: Block) -> SynapseBlock:
        """The synapses of a block, in few bytes."""
        found = placed(self.blocks.connect(block), *self.ends)
        delay = self._delay(found, block)
        weight = self._columns(found, block, weight_room(self.part, found.size))["weight"]
        return SynapseBlock.of(found.row_ends, found.targets, weight, delay)

    def _in_blocks(self, blocks: tuple[SynapseBlock, ...]) -> Synapses:
        row_ends = np.sum([block.row_ends for block in blocks], axis=0)
        weight = np.zeros(0) if has_each(self.part.weight) else blocks[0].weight.astype(np.float64)
        found = Connections("csr", int(row_ends[-1]), row_ends)
        return Synapses(found, np.zeros(0, dtype=np.uint8), weight, self.part.synapse, True, "csr", blocks)

    def _reached(self, block: Block) -> bool:
        """Whether some targets of a block are of the part."""
        ids = self.ends[1].ids
        if self.among is None:
            return True
        first, end = self.among
        if ids is None:
            return block.first < end and first < block.end
        some = ids[block.first : block.end]
        return bool(((some >= first) & (some < end)).any())

    def _begun(self, block: Block) -> Piece:
        """A block with its delays."""
        found = placed(self.blocks.connect(block), *self.ends)
        return Piece(block, found, self._kept(found), self._delay(found, block))

    @property
    def _are_alike(self) -> bool:
        """Whether no synapse is stored by itself: every source reaches every target, with one weight and delay."""
        each = has_each(self.part.weight) or has_each(self.part.delay) or self._parameters
        return self.among is None and self._layout != "csr" and not each

    @property
    def _layout(self) -> str:
        """The layout of the synapses of all blocks onto all targets."""
        rule, (source, target) = self.blocks.rule, self.ends
        if source.ids is not None or target.ids is not None:
            return "csr"
        if isinstance(rule, all_to_all) and (rule.autapses or self.blocks.own is None):
            return "dense"
        return "one_to_one" if isinstance(rule, one_to_one) else "csr"

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


class Joint:
    """The place of each synapse of some blocks among all of them.

    Args:
        layout: of all.
        shape: neurons of source and target.
        blocks: in order.
        rows: where the synapses of each source end, block by block.
    """

    def __init__(self, layout: str, shape: tuple[int, int], blocks: Sequence[Block], rows: Sequence[Ints]) -> None:
        self._layout, self._shape, self._blocks, self._rows = layout, shape, blocks, rows
        self._row_ends: Ints = np.sum(self._rows, axis=0)
        self.size = int(self._row_ends[-1])

    @cached_property
    def _starts(self) -> list[Ints]:
        """Where the synapses of each source begin, block by block."""
        starts = [self._row_ends[:-1]]
        for ends in self._rows[:-1]:
            starts.append(starts[-1] + np.diff(ends))
        return starts

    def _columns(self, k: int) -> slice:
        return slice(self._blocks[k].first, self._blocks[k].end)

    def room(self, kind: Any, given: NDArray[Any] | None = None) -> NDArray[Any]:
        """Memory for a value of each; that which is given if it fits."""
        return given if given is not None and given.size == self.size else np.empty(self.size, dtype=kind)

    def put(self, k: int, values: NDArray[Any], to: NDArray[Any]) -> None:
        """Move the values of block k to their places."""
        match self._layout:
            case "one_to_one":
                to[self._columns(k)] = values
            case "dense":
                to.reshape(self._shape)[:, self._columns(k)] = values.reshape(self._shape[0], -1)
            case _:
                from neuro.compiler.rows import put_rows

                put_rows(self._rows[k], values, self._starts[k], to)

    def connections(self, targets: NDArray[np.int32]) -> Connections:
        """All of them."""
        if self._layout == "csr":
            return Connections("csr", self.size, self._row_ends, targets)
        return Connections(self._layout, self.size)


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


def together(own_weights: bool, blocks: Sequence[SynapseBlock]) -> StoredSynapses:
    """Targets, weights and delays of the synapses of blocks, by source, delay, target."""
    joint = Joint("csr", (0, 0), (), [block.row_ends for block in blocks])

    def of_all(name: str) -> NDArray[Any]:
        to = joint.room(getattr(blocks[0], name).dtype)
        for k, block in enumerate(blocks):
            joint.put(k, getattr(block, name), to)
        return to

    targets, delay = of_all("targets"), of_all("delay")
    weight = of_all("weight") if own_weights else blocks[0].weight
    _by_delay_in_place(joint.connections(targets).row_ends, delay, targets, [weight] if own_weights else [])
    return targets, weight, delay


def _scratch(size: int) -> Floats:
    """Memory for so many values, of this thread, which its next block uses again."""
    # Memory that is touched for the first time takes longer than to draw what lies there.
    if getattr(_OF_THREAD, "room", _NOTHING).size < size:
        _OF_THREAD.room = np.empty(size)
    room: Floats = _OF_THREAD.room[:size]
    return room


def _with(rule: Synapse, numbers: Mapping[str, Floats]) -> Synapse:
    """The synapse model with numbers of each synapse; of no synapses it has any."""
    defaults = {entry.name: entry.default for entry in fields(rule)}
    each = {name: values if values.size else defaults[name] for name, values in numbers.items()}
    return replace(rule, **each) if each else rule


def _by_delay_in_place(row_ends: Ints, delay: Steps, targets: NDArray[Any], others: Sequence[NDArray[Any]]) -> None:
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
            _by_delay_in_place(found.row_ends, delay, found.targets, shared)
            return found, delay, True
        if found.order is not None and found.listed == ((found.size,),):
            as_listed = np.argsort(found.order)
            pre = np.repeat(np.arange(found.row_ends.size - 1), np.diff(found.row_ends))[as_listed]
            post, late = found.targets[as_listed], delay[as_listed]
            if np.array_equal(np.lexsort((post, late, pre)), np.arange(found.size)):
                factors = {word: values[as_listed] for word, values in found.factors.items()}
                return replace(found, targets=post, order=None, factors=factors), late, True
    return found, delay, False
