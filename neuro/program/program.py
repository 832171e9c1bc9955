"""A network resolved and checked: flat arrays, steps and indices; names and origins for messages only.

A process may have a share of it: the synapses onto some neurons of each population.

This is all that a backend sees.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError, Where
from neuro.model.distributions import Distribution
from neuro.model.neurons import Model
from neuro.model.parts import Competition
from neuro.model.rules import NamedRule
from neuro.model.synapses import K_PLUS, DelayRule, Synapse

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
T = TypeVar("T")
W = TypeVar("W", bound=np.floating[Any])
StoredSynapses = tuple[NDArray[np.integer[Any]], NDArray[np.floating[Any]], NDArray[np.integer[Any]]]


@dataclass(frozen=True)
class Share:
    """One of several shares of equal size; `WHOLE` is the only one.

    All shares of a network call the methods that join them in the same order.

    Attributes:
        index: which one.
        number: how many there are.
    """

    index: int = 0
    number: int = 1

    def of(self, neurons: int) -> tuple[int, int]:
        """The first of the neurons of a population that are of this share, and the end."""
        each, more = divmod(neurons, self.number)
        first = self.index * each + min(self.index, more)
        return first, first + each + (self.index < more)

    def gather(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values of all shares, in their order."""
        return values

    def total(self, values: Ints) -> Ints:
        """The sum of the values of all shares."""
        found: Ints = self.gather(values[None]).sum(axis=0)
        return found

    def every(self, holds: bool) -> bool:
        """Whether something holds for all shares."""
        return bool(self.gather(np.array([holds])).all())

    def agree(self, make: Callable[[], T]) -> T:
        """What a function gives, if it gives something for every share.

        Raises:
            ModelError: that of the first share for which it raises one.
        """
        return make()


WHOLE = Share()

AT_ONCE = 1 << 20
"""Synapses that are joined at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class SynapseStretch:
    """The synapses of neighbouring sources, of all shares.

    Attributes:
        sources: the first source, and the end.
        begin: the place of the first of the synapses among all.
        order: which of the gathered ones each is.
        own: those of this share.
        at: where these begin among the gathered ones.
    """

    sources: tuple[int, int]
    begin: int
    order: Ints
    own: slice
    at: int


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The synapses of a projection in the order of their sources, of each share some; all shares ask alike.

    Attributes:
        share: which ones these are.
        row_ends: those of source i are row_ends[i] : row_ends[i + 1].
        delays: of each; None where those of a source are not sorted by delay.
    """

    share: Share
    row_ends: Ints
    delays: NDArray[np.integer[Any]] | None

    def fan_out(self) -> Ints:
        """Synapses of each source, of all shares."""
        return self.share.total(np.diff(self.row_ends))

    def stretches(self) -> Iterator[SynapseStretch]:
        """All synapses in order, some sources at a time."""
        ends = np.concatenate(([0], np.cumsum(self.fan_out())))
        first = 0
        while first < ends.size - 1:
            last = max(first + 1, int(np.searchsorted(ends, ends[first] + AT_ONCE, side="right")) - 1)
            own = slice(int(self.row_ends[first]), int(self.row_ends[last]))
            pre = np.repeat(np.arange(first, last), np.diff(self.row_ends[first : last + 1]))
            numbers = self.share.gather(np.array([pre.size]))
            keys: tuple[NDArray[Any], ...] = (self.share.gather(pre),)
            if self.delays is not None:
                keys = (self.share.gather(self.delays[own]), *keys)
            # The targets of a share lie before those of the next, so equal ones are in order.
            yield SynapseStretch(
                (first, last), int(ends[first]), np.lexsort(keys), own, int(numbers[: self.share.index].sum())
            )
            first = last

    def joined(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values of the synapses of all shares, in order, from those of this one."""
        return np.concatenate([self.share.gather(values[each.own])[each.order] for each in self.stretches()])

    def places(self) -> Ints:
        """Which of all synapses those of this share are."""
        found = np.empty(int(self.row_ends[-1]), dtype=np.int64)
        for each in self.stretches():
            among = np.empty(each.order.size, dtype=np.int64)
            among[each.order] = np.arange(each.order.size)
            found[each.own] = each.begin + among[each.at : each.at + each.own.stop - each.own.start]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """A rate or an amplitude that changes at listed steps, and is 0 before the first.

    Attributes:
        steps: ascending, from 1.
        values: those that hold from each of the steps on, shape (steps, 1) or (steps, size).
    """

    steps: Ints
    values: Floats

    def at(self, step: int) -> Floats:
        """What holds in a step, shape (1,) or (size,)."""
        k = int(np.searchsorted(self.steps, step, side="right"))
        return self.values[k - 1] if k else np.zeros(1)

    def next_change(self, step: int) -> int:
        """The last step before the next change after step + 1, or a step that never comes."""
        k = int(np.searchsorted(self.steps, step + 1, side="right"))
        return int(self.steps[k]) - 1 if k < self.steps.size else NEVER


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Neurons of one model.

    Attributes:
        model: the model; its numbers are in `parameters`.
        kind: what it does, `model.role`: "neuron", "poisson", "listed", "current" or "generator" (third-party).
        shape: sizes of the axes; `size` is their product and neuron ids run in C order.
        parameters: by word, shape (1,) where all neurons share it, else (size,).
        initial: states at step 0 by name, likewise.
        spike_steps, spike_ids: a spike_generator's listed spikes, sorted by step, then id; `spike_payloads` are those
            of a graded one, else none.
        start, stop: a generator emits spikes in steps start < k <= stop, and a current in steps start <= k < stop.
        records: whether its spikes are kept for reading.
        stream: gives spikes to a listed population while it runs; None where none does.
        schedule: of a generator whose rate or amplitude is not a parameter but listed.
        declared: the name of the model that was described, where another stands for it; "" elsewhere.
    """

    name: str
    model: Model
    kind: str
    shape: tuple[int, ...]
    size: int
    parameters: dict[str, Floats]
    initial: dict[str, Floats]
    spike_steps: Ints
    spike_ids: Ints
    start: int
    stop: int
    records: bool
    origin: Where | None
    stream: Stream | None = None
    schedule: Schedule | None = None
    declared: str = ""
    spike_payloads: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def said(self) -> str:
        """The name of its model as its author knows it."""
        return self.declared or self.model.name

    def rate(self, step: int) -> Floats:
        """The rate in Hz that a generator of kind "poisson" begins with, or comes to in a step."""
        return self.parameters["rate"] if self.schedule is None else self.schedule.at(step)

    def largest(self, word: str) -> float:
        """The largest magnitude that its rate or amplitude has or comes to, as described."""
        values = self.parameters[word] if self.schedule is None else self.schedule.values
        return float(np.abs(values).max(initial=0.0))


def drawn_for(population: Population) -> str:
    """The purpose of a population's keyed draws, see `neuro.core.keyed_random.key`."""
    return {"generator": "generator", "neuron": "escape"}.get(population.kind, "poisson")


@dataclass(frozen=True, slots=True)
class Grid:
    """Sizes of a shared-kernel projection: source (channels, height, width), target (maps, rows, columns).

    Attributes:
        top, left: lines of the silent border above and left of the source; what it needs below and right follows.
        depthwise: whether map m is reached from channel m // (maps / channels) only.
        mean: whether a weight that learns takes the mean of the changes at its places, not their sum.
    """

    channels: int
    height: int
    width: int
    maps: int
    rows: int
    columns: int
    kernel_height: int
    kernel_width: int
    stride: int
    top: int
    left: int
    depthwise: bool
    mean: bool = False

    @property
    def kernels(self) -> tuple[int, int, int, int]:
        """Shape of the weights: maps, the channels that reach each, height and width."""
        return self.maps, 1 if self.depthwise else self.channels, self.kernel_height, self.kernel_width

    @property
    def reach(self) -> int:
        """Maps that a channel reaches."""
        return self.maps // self.channels if self.depthwise else self.maps


@dataclass(frozen=True, slots=True)
class Receptor:
    """The receptor of its target that a projection names.

    Attributes:
        index: which input of the neurons it is.
        conductance: whether it is a conductance, whose weights must be >= 0.
        negated: whether a weight is delivered with a minus sign, as models whose two conductances are chosen by sign
            expect it at the second.
    """

    name: str
    index: int
    conductance: bool
    negated: bool


@dataclass(frozen=True, slots=True, eq=False)
class Undrawn:
    """What a backend draws synapses by: the rule, and a number or a distribution for weights and for delays in ms."""

    rule: NamedRule
    weight: float | Distribution
    delay: float | Distribution


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Connections between two populations.

    Attributes:
        source, target: indices of the populations.
        carries: "spikes" or "current".
        layout: "one_to_one", "dense" (every pair, source-major), "csr", "grid" (a shared kernel), or "undrawn".
        row_ends: csr: synapses of source i are row_ends[i] : row_ends[i + 1], targets ascending; in a network
            of about a million synapses or more, of static ones with drawn delays: delays ascending, then targets.
        targets: csr: the target of each synapse, int32.
        weight: shape (1,) where shared, else one per synapse; grid: (maps, channels, height, width) flat.
        delay: in steps, shape (1,) or one per synapse, int32, >= 1; of so many static synapses uint8 where delays are
            drawn and none is longer than 255.
        size: number of synapses (of a grid: of its kernels' weights), of all shares together.
        grid: the sizes of a grid, else None.
        synapse: the model; a parameter is a number, or one for each synapse in the order of the weights.
        receptor: the one of its target that all spikes go to; None where each goes by the sign of its weight. That of a
            current filters it; without one it acts on V_m as it is.
        signal: index of the signal that sets n, or -1.
        dopamine: index of the population that releases dopamine, or -1; `dopamine_one_to_one` and
            `dopamine_delay` (steps) say how.
        gate: index of the signal that says how much a rule that learns by moves gathers, or -1.
        span: the fewest and the most steps in `delay`, see `delay_span`; None: not yet looked for.
        by_delay: csr: whether the synapses of a source are sorted by delay.
        share: which of the synapses these are: those onto the neurons of a share, in the layout csr.
        whole_layout: the layout of those of all shares together.
        undrawn: what the backend draws the synapses by; None where the program has them. If it has not, `weight` and
            `delay` are the least and the largest that may be drawn, and `size` is a mean where it is drawn, too.
    """

    name: str
    source: int
    target: int
    carries: str
    layout: str
    row_ends: Ints
    targets: NDArray[np.int32]
    weight: Floats
    delay: NDArray[np.integer[Any]]
    size: int
    grid: Grid | None
    synapse: Synapse
    receptor: Receptor | None
    signal: int
    dopamine: int
    dopamine_one_to_one: bool
    dopamine_delay: int
    origin: Where | None
    span: tuple[int, int] | None = None
    gate: int = -1
    by_delay: bool = False
    share: Share = WHOLE
    whole_layout: str = ""
    undrawn: Undrawn | None = None

    @property
    def delay_span(self) -> tuple[int, int]:
        """The fewest and the most steps in `delay`; of no synapses 1."""
        if self.span is not None:
            return self.span
        return (int(self.delay.min()), int(self.delay.max())) if self.delay.size else (1, 1)

    @property
    def rows(self) -> Rows:
        """The synapses of all shares, in layout csr."""
        sorted_by_delay = self.by_delay and self.share.number > 1  # those of the whole network lie in order
        return Rows(self.share, self.row_ends, self.delay if sorted_by_delay else None)

    def stored(self) -> StoredSynapses:
        """Targets, weights and delays in the types in which they are kept, see `neuro.program.compact`."""
        return self.targets, self.weight, self.delay

    def delay_range(self, resolution: float) -> tuple[int, int]:
        """The fewest and the most steps that a spike may take along it, now or when it has learnt."""
        if isinstance(self.synapse, DelayRule):
            return self.synapse.delay_range(resolution)
        return self.delay_span

    def arriving(self, weights: NDArray[W]) -> NDArray[W]:
        """Weights as delivered: negated if the receptor is `negated`. Applied twice it gives the weights back."""
        if self.receptor is None or not self.receptor.negated:
            return weights
        negated: NDArray[W] = np.subtract(0.0, weights, dtype=weights.dtype)
        return negated

    def as_by_sign(self, weights: Floats) -> bool:
        """Whether routing by sign would deliver every weight to the named receptor; true if none is named."""
        if self.receptor is None:
            return True
        if self.receptor.index > 1:
            return False
        arriving = self.arriving(weights)
        return bool(np.all(arriving <= 0.0 if self.receptor.index == 1 else arriving >= 0.0))


def synapse_states(part: Projection) -> list[str]:
    """What can be read of a projection's synapses."""
    names = ["weight", *(state.name for state in part.synapse.states if not state.hidden)]
    if part.grid is not None and part.synapse.learns == "pairs":  # a weight stands for many synapses
        return names[:1]
    if part.synapse.learns == "pairs" and part.synapse.pre[:1] == (K_PLUS,):
        names.append("K_plus")
    if part.synapse.modulated:
        names.append("n")
    return names


@dataclass(frozen=True, slots=True, eq=False)
class Operation:
    """An operation of an expression; the value is a number.

    Attributes:
        name: a sign or a function; "number", "count", "mean", "trace" and "after" have a number or a memory.
        of: the operations before it that it takes.
        number: itself; of a mean the share of a new value, 0 for that of all; the share of a trace that is left; the
            steps within which a spike comes after another.
        reads: whose spikes: a population and some of its neurons, None for all.
    """

    name: str
    of: tuple[int, ...] = ()
    number: float = 0.0
    reads: tuple[tuple[int, Ints | None], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Computed:
    """Values of an expression of spikes.

    Attributes:
        name: keys the draws of delays.
        operations: of which the last gives the value.
        every: steps between two values.
        delay: from a value to its effect: steps, or a distribution in ms.
        tau: with which the sum of doses decays in ms; 0: values are no doses.
        largest: bound of the absolute values; None where it is not known.
    """

    name: str
    operations: tuple[Operation, ...]
    every: int
    delay: int | Distribution
    tau: float
    largest: float | None = None


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal and the index of the population it goes to.

    Attributes:
        values: what sets it, the same for signals that are set together; None: what is outside.
        scale: the factor on these values, shape (1,) or (size,).
        in_world: the largest absolute value that the world of the network sets, None where it sets none.
    """

    name: str
    target: int
    origin: Where | None
    values: Schedule | Computed | None = None
    scale: Floats | None = None
    in_world: float | None = None

    @property
    def largest(self) -> float | None:
        """The largest absolute value that it will have; None if that is not known."""
        if self.scale is None or self.values is None:
            return self.in_world
        largest = self.values.values if isinstance(self.values, Schedule) else self.values.largest
        return None if largest is None else float(np.abs(largest * self.scale).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class Group:
    """Neurons of a population that compete, and how."""

    name: str
    population: int
    choice: Competition
    origin: Where | None


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """What to record of a population: "spikes", its "rate" or a state, every `every` steps; or the mean of a state.

    `ids` are the neurons, in this order (None: all).
    """

    name: str
    population: int
    record: str
    every: int
    origin: Where | None
    ids: Ints | None = None
    mean: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SynapseProbe:
    """A state of synapses to record.

    Attributes:
        every: steps between two records; 0: as each pre spike leaves them.
        synapses: which ones, in the order of the weights, ascending; None: all.
        mean: whether their mean is recorded instead of each.
    """

    name: str
    projection: int
    record: str
    every: int
    synapses: Ints | None
    mean: bool
    origin: Where | None


@dataclass(frozen=True, slots=True)
class Trials:
    """How trials go.

    Attributes:
        input, output: indices of the generator and of the population that decides.
        group: index of the winner-take-all group of the output.
        duration: ticks.
        stop_at_decision: whether the first spike ends a trial.
        spikes: which spikes of an input teach: "once" (a second is refused), "first" or "each".
        maps, maps_per_label: maps of the output and how many stand for one label (0: no labels).
        reward: by outcome (correct, wrong, silent).
        dropout: share of maps dropped in epoch 0; `dropout_decay` per epoch; `dropout_per_trial`.
        reset: states of the output that start anew.
        anew: whether all neurons and all that learns start anew, but the weights, as synapses learn by dopamine.
        after: ticks that follow a trial that teaches.
    """

    input: int
    output: int
    group: int
    duration: int
    stop_at_decision: bool
    spikes: str
    maps: int
    maps_per_label: int
    reward: tuple[float, float, float]
    dropout: float
    dropout_decay: float
    dropout_per_trial: bool
    reset: tuple[str, ...]
    anew: bool
    after: int
    origin: Where | None


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Program:
    """The whole network.

    Attributes:
        resolution: length of a step in ms, for the models' constants.
        min_delay: the smallest delay in steps.
        share: the synapses that this process has. What the methods give is of all of them: every process that has a
            share calls them.
    """

    name: str
    resolution: float
    seed: int
    min_delay: int
    populations: tuple[Population, ...]
    projections: tuple[Projection, ...]
    signals: tuple[Signal, ...]
    groups: tuple[Group, ...]
    probes: tuple[Probe, ...]
    trials: Trials | None
    synapse_probes: tuple[SynapseProbe, ...] = ()
    share: Share = WHOLE

    def refuse_share(self, what: str) -> None:
        """Refuse what needs all synapses in one process.

        Raises:
            ModelError: this process has a share of them, or the backend draws some.
        """
        for index in range(len(self.projections)):
            self.refuse_undrawn(index)
        if self.share.number > 1:
            message = f"{what}: found a network of which {self.share.number} processes have a share each"
            raise ModelError(f"{message}: expected one process", hint="without mpirun it has all synapses")

    def refuse_undrawn(self, index: int) -> None:
        """Refuse what needs the synapses of a projection.

        Raises:
            ModelError: the backend draws them.
        """
        part = self.projections[index]
        if part.undrawn is not None:
            message = f"projection '{part.name}': its synapses are drawn by the backend, which does not list them"
            hint = f"without 'draw: backend' in {part.undrawn.rule.name} they are drawn before, and can be read and set"
            raise ModelError(message, where=part.origin, hint=hint)

    def sends_at_once(self, part: Projection) -> bool:
        """Whether a spike takes the weights of the step of its emission along a projection, not those of the next step.

        NEST's generators are devices, which send while they update; neurons send when the next step begins, and so does
        whoever sends along synapses that learn by pairs or moves.
        """
        return self.populations[part.source].kind != "neuron" and part.synapse.learns not in ("pairs", "moves")

    def connections(self, index: int) -> tuple[Ints, Ints]:
        """Source and target of every synapse of a projection, in the order of its weights (not for a grid)."""
        self.refuse_undrawn(index)
        part = self.projections[index]
        own = connections_of(part, self.populations[part.source].size, self.populations[part.target].size)
        pre, post = (self.joined(index, ids) for ids in own)
        return pre, post

    def joined(self, index: int, values: NDArray[Any]) -> NDArray[Any]:
        """The values of all synapses of a projection, in the order of its weights, from those of the share."""
        part = self.projections[index]
        return values if part.share.number == 1 else part.rows.joined(values)

    def delays(self, index: int) -> NDArray[np.integer[Any]]:
        """The delays of all synapses of a projection in steps, shape (1,) where shared."""
        self.refuse_undrawn(index)
        part = self.projections[index]
        shortest, longest = part.delay_span
        if part.share.number == 1:
            return part.delay
        return np.array([longest]) if shortest == longest else self.joined(index, part.delay)

    def own(self, index: int, values: NDArray[Any]) -> NDArray[Any]:
        """Of the values of all synapses of a projection those of the share."""
        part = self.projections[index]
        return values if part.share.number == 1 or len(values) == 1 else values[part.rows.places()]

    def own_synapses(self, index: int) -> tuple[Ints, Ints, Ints]:
        """As `synapses`, of those of the share; the places are among these."""
        part = self.projections[index]
        if part.share.number == 1:
            return self.synapses(index)
        sizes = self.populations[part.source].size, self.populations[part.target].size
        return (*connections_of(part, *sizes), np.arange(part.targets.size))

    def synapses(self, index: int) -> tuple[Ints, Ints, Ints]:
        """Source, target and place of the weight of every synapse of a projection, in the order of its weights.

        Those of a grid are sorted by source, then target, and share weights; elsewhere each has its own.
        """
        part = self.projections[index]
        if part.grid is not None:
            return _spelt_out(part.grid)
        return (*self.connections(index), np.arange(part.size))


def connections_of(part: Projection, n_source: int, n_target: int) -> tuple[Ints, Ints]:
    """Source and target of every synapse of a projection between populations of these sizes (not of a grid)."""
    if part.layout == "one_to_one":
        ids = np.arange(n_source, dtype=np.int64)
        return ids, ids
    if part.layout == "dense":
        return (
            np.repeat(np.arange(n_source, dtype=np.int64), n_target),
            np.tile(np.arange(n_target, dtype=np.int64), n_source),
        )
    source = np.repeat(np.arange(n_source, dtype=np.int64), np.diff(part.row_ends))
    return source, part.targets.astype(np.int64)


def _spelt_out(g: Grid) -> tuple[Ints, Ints, Ints]:
    """Source, target and weight of every synapse of a grid, sorted by source, then target."""
    maps, depth, height, width = g.kernels
    m, r, c, k, i, j = np.indices((maps, g.rows, g.columns, depth, height, width))
    y, x = r * g.stride + i - g.top, c * g.stride + j - g.left
    inside = (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
    source = (((k + m // g.reach) * g.height + y) * g.width + x)[inside]
    target = ((m * g.rows + r) * g.columns + c)[inside]
    slot = (((m * depth + k) * height + i) * width + j)[inside]
    order = np.lexsort((target, source))
    return source[order], target[order], slot[order]


class Stretch(NamedTuple):
    """Some spikes by step; with those before, all up to step `until`."""

    until: int
    steps: Ints
    ids: Ints


class Stream(Protocol):
    """Where a population's spikes come from. The caller keeps how far they came, so that many may ask."""

    @property
    def again(self) -> bool:
        """Whether it can be begun several times."""

    @property
    def identity(self) -> str:
        """What distinguishes it from another when a saved state is restored."""

    def after(self, step: int) -> Iterator[Stretch]:
        """All spikes of later steps, in stretches; when they end no more come.

        Raises:
            ModelError: what they are made of is damaged; all spikes before have been given, and a caller that asks
                again for those after the last stretch gets the same error.
        """

    def given(self, events: Any) -> tuple[Ints, Ints]:
        """Steps and neurons of what a program gives while the network runs.

        Raises:
            ModelError: it is nothing that can be emitted.
        """
