"""Compiled network: flat arrays, times in steps, parts by index. Names and origins serve messages only.

A backend sees nothing else of a network. A process may have a share of it: the synapses onto some neurons of each
population.
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
    """A share of a network. `WHOLE` is the single share of an undivided network.

    All shares of a network must call the methods that exchange values in the same order.

    Attributes:
        index: the index of this share.
        number: the number of shares.
    """

    index: int = 0
    number: int = 1

    def of(self, neurons: int) -> tuple[int, int]:
        """Return the first neuron of a population in this share, and the end of the range.

        Example: 3 shares of 10 neurons have the ranges (0, 4), (4, 7) and (7, 10).
        """
        per_share, more = divmod(neurons, self.number)
        first = self.index * per_share + min(self.index, more)
        return first, first + per_share + (self.index < more)

    def gather(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of all shares, in the order of the shares."""
        return values

    def total(self, values: Ints) -> Ints:
        """Return the sum of the values over all shares."""
        sums: Ints = self.gather(values[None]).sum(axis=0)
        return sums

    def every(self, holds: bool) -> bool:
        """Return whether a condition holds in all shares."""
        return bool(self.gather(np.array([holds])).all())

    def agree(self, make: Callable[[], T]) -> T:
        """Return the result of a function, if the function succeeds in every share.

        Raises:
            ModelError: the error of the first share in which the function failed.
        """
        return make()


WHOLE = Share()

AT_ONCE = 1 << 20
"""Number of synapses that are gathered from all shares in one step."""


@dataclass(frozen=True, slots=True, eq=False)
class SynapseStretch:
    """Synapses of neighbouring sources, gathered from all shares.

    Attributes:
        sources: the first source, and the end.
        begin: index of the first of these synapses among all synapses of the projection.
        order: the permutation that sorts the gathered synapses.
        own: the synapses of this share, as a slice of the arrays of this share.
        at: index at which the synapses of this share begin among the gathered ones.
    """

    sources: tuple[int, int]
    begin: int
    order: Ints
    own: slice
    at: int


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Synapses of a projection in the order of their sources. Every share has some synapses of each source.

    All shares must call the methods together.

    Attributes:
        share: the share that these synapses belong to.
        row_ends: source i has the synapses row_ends[i] : row_ends[i + 1].
        delays: the delay of each synapse; None if the synapses of a source are not sorted by delay.
    """

    share: Share
    row_ends: Ints
    delays: NDArray[np.integer[Any]] | None

    def fan_out(self) -> Ints:
        """Return the number of synapses of each source, over all shares."""
        return self.share.total(np.diff(self.row_ends))

    def stretches(self) -> Iterator[SynapseStretch]:
        """Yield all synapses in order, in stretches of neighbouring sources."""
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
            # All targets of a share come before those of the next share, so equal keys are in order.
            yield SynapseStretch(
                (first, last), int(ends[first]), np.lexsort(keys), own, int(numbers[: self.share.index].sum())
            )
            first = last

    def joined(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of the synapses of all shares, in order, from the values of this share."""
        return np.concatenate([self.share.gather(values[stretch.own])[stretch.order] for stretch in self.stretches()])

    def places(self) -> Ints:
        """Return the index of each synapse of this share among the synapses of all shares."""
        places = np.empty(int(self.row_ends[-1]), dtype=np.int64)
        for part in self.stretches():
            sorted_at = np.empty(part.order.size, dtype=np.int64)
            sorted_at[part.order] = np.arange(part.order.size)
            places[part.own] = part.begin + sorted_at[part.at : part.at + part.own.stop - part.own.start]
        return places


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """A rate or an amplitude that changes at listed steps, and is 0 before the first.

    Example: steps [1, 11] with values [[5.0], [2.0]] hold 5.0 in steps 1 to 10, and 2.0 from step 11 on.

    Attributes:
        steps: steps of the changes, ascending, from 1.
        values: the value from each of the steps on, shape (steps, 1) or (steps, size).
    """

    steps: Ints
    values: Floats

    def at(self, step: int) -> Floats:
        """Return the value in a step, shape (1,) or (size,)."""
        k = int(np.searchsorted(self.steps, step, side="right"))
        return self.values[k - 1] if k else np.zeros(1)

    def next_change(self, step: int) -> int:
        """Return the last step before the next change after step + 1, or `NEVER`."""
        k = int(np.searchsorted(self.steps, step + 1, side="right"))
        return int(self.steps[k]) - 1 if k < self.steps.size else NEVER


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Neurons of one model.

    Attributes:
        model: the model; the parameter values are in `parameters`.
        kind: `model.role`: "neuron", "poisson", "listed", "current" or "generator" (third-party).
        shape: sizes of the axes; `size` is their product and neuron ids run in C order.
        parameters: values by parameter name, shape (1,) if all neurons share the value, else (size,).
        initial: states at step 0 by name, with the same shapes.
        spike_steps, spike_ids: a spike_generator's listed spikes, sorted by step, then id; `spike_payloads` are the
            payloads of a graded generator, else empty.
        start, stop: a generator emits spikes in steps start < k <= stop, and a current in steps start <= k < stop.
        records: whether the engine stores the spikes for reading.
        stream: source of spikes for a listed population during a run; None without one.
        schedule: the listed rates or amplitudes of a generator; None if the value is a parameter.
        declared: the name of the model in the description, if a substitute runs instead; else "".
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
    def model_name(self) -> str:
        """The name of the model in the description, for messages."""
        return self.declared or self.model.name

    def rate(self, step: int) -> Floats:
        """Return the rate in Hz of a generator of kind "poisson" in a step."""
        return self.parameters["rate"] if self.schedule is None else self.schedule.at(step)

    def largest(self, word: str) -> float:
        """Return the largest magnitude of the described rate or amplitude at any time."""
        values = self.parameters[word] if self.schedule is None else self.schedule.values
        return float(np.abs(values).max(initial=0.0))


def drawn_for(population: Population) -> str:
    """Return the purpose of a population's keyed draws, see `neuro.core.keyed_random.key`."""
    return {"generator": "generator", "neuron": "escape"}.get(population.kind, "poisson")


@dataclass(frozen=True, slots=True)
class Grid:
    """Sizes of a shared-kernel projection: source (channels, height, width), target (maps, rows, columns).

    Attributes:
        top, left: lines of silent padding above and left of the source. Padding below and right follows from the sizes.
        depthwise: whether map m receives from channel m // (maps / channels) only.
        mean: whether learning changes a shared weight by the mean, not the sum, of the changes at all its places.
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
        """Shape of the weights: maps, channels per map, kernel height, kernel width."""
        return self.maps, 1 if self.depthwise else self.channels, self.kernel_height, self.kernel_width

    @property
    def reach(self) -> int:
        """Number of maps that receive from a channel."""
        return self.maps // self.channels if self.depthwise else self.maps


@dataclass(frozen=True, slots=True)
class Receptor:
    """Receptor of the target neurons, named by a projection.

    Attributes:
        index: index of the input of the neurons.
        conductance: whether the input is a conductance, which needs weights >= 0.
        negated: whether weights are delivered with a minus sign. Models that choose between two conductances by sign
            expect negative values at the second conductance.
    """

    name: str
    index: int
    conductance: bool
    negated: bool


@dataclass(frozen=True, slots=True, eq=False)
class Undrawn:
    """Rules for the synapses that a backend draws. Weights and delays (ms) are numbers or distributions."""

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
        row_ends: csr: source i has the synapses row_ends[i] : row_ends[i + 1], with targets ascending. For example,
            row_ends [0, 2, 2, 3] and targets [1, 4, 0] connect 0 -> 1, 0 -> 4 and 2 -> 0. In a network of about a
            million synapses or more, static synapses with drawn delays are sorted by delay, then by target.
        targets: csr: the target of each synapse, int32.
        weight: weights, shape (1,) if shared, else one per synapse; grid: (maps, channels, height, width) flat.
        delay: delays in steps, shape (1,) or one per synapse, int32, >= 1; uint8 in such a large network, where drawn
            delays of static synapses are at most 255.
        size: number of synapses of all shares together; for a grid, number of weights in the kernels.
        grid: the sizes of a grid, else None.
        synapse: the model; a parameter is a number, or one for each synapse in the order of the weights.
        receptor: the receptor of all spikes; None if the sign of a weight chooses the receptor. A current
            is filtered by its receptor; without one the current acts on V_m directly.
        signal: index of the signal that sets n, or -1.
        dopamine: index of the population that releases dopamine, or -1; `dopamine_one_to_one` and
            `dopamine_delay` (steps) say how.
        gate: index of the signal that scales the eligibility of a rule that learns by moves, or -1.
        span: the smallest and the largest value in `delay`, see `delay_span`; None: not yet computed.
        by_delay: csr: whether the synapses of a source are sorted by delay.
        share: the share with the target neurons of these synapses. With several shares the layout is csr.
        whole_layout: the layout of the synapses of all shares together.
        undrawn: rules for synapses that the backend draws; None if the program has the synapses. With such
            rules, `weight` and `delay` hold the smallest and the largest possible draw, and `size` is a mean
            if the number of synapses is random.
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
        """The smallest and the largest delay in steps; (1, 1) without synapses."""
        if self.span is not None:
            return self.span
        return (int(self.delay.min()), int(self.delay.max())) if self.delay.size else (1, 1)

    @property
    def rows(self) -> Rows:
        """The synapses of all shares, in layout csr."""
        sorted_by_delay = self.by_delay and self.share.number > 1  # the synapses of a single share are in order already
        return Rows(self.share, self.row_ends, self.delay if sorted_by_delay else None)

    def stored(self) -> StoredSynapses:
        """Return targets, weights and delays in their stored types, see `neuro.program.compact`."""
        return self.targets, self.weight, self.delay

    def delay_range(self, resolution: float) -> tuple[int, int]:
        """Return the smallest and the largest delay in steps, including delays within reach of learning."""
        if isinstance(self.synapse, DelayRule):
            return self.synapse.delay_range(resolution)
        return self.delay_span

    def arriving(self, weights: NDArray[W]) -> NDArray[W]:
        """Return the weights as delivered: negated if the receptor is `negated`.

        Applying the method twice returns the original weights.
        """
        if self.receptor is None or not self.receptor.negated:
            return weights
        negated: NDArray[W] = np.subtract(0.0, weights, dtype=weights.dtype)
        return negated

    def as_by_sign(self, weights: Floats) -> bool:
        """Return whether routing by sign leads all weights to the named receptor; True without a named receptor."""
        if self.receptor is None:
            return True
        if self.receptor.index > 1:
            return False
        arriving = self.arriving(weights)
        return bool(np.all(arriving <= 0.0 if self.receptor.index == 1 else arriving >= 0.0))


def synapse_states(part: Projection) -> list[str]:
    """Return the names of the readable states of a projection's synapses."""
    names = ["weight", *(state.name for state in part.synapse.states if not state.hidden)]
    if part.grid is not None and part.synapse.learns == "pairs":  # many synapses share a weight
        return names[:1]
    if part.synapse.learns == "pairs" and part.synapse.pre[:1] == (K_PLUS,):
        names.append("K_plus")
    if part.synapse.modulated:
        names.append("n")
    return names


@dataclass(frozen=True, slots=True, eq=False)
class Operation:
    """Operation of an expression; the result is a number.

    Attributes:
        name: an operator or a function. "number", "count", "mean", "trace" and "after" have a constant or a memory.
        of: indices of the earlier operations whose results are the operands.
        number: for "number" the constant; for "mean" the share of a new value, 0 for the mean of all values; for
            "trace" the share that remains after a step; for "after" the number of steps within which one spike must
            follow another.
        reads: populations that provide spikes, each with ids of neurons or None for all.
    """

    name: str
    of: tuple[int, ...] = ()
    number: float = 0.0
    reads: tuple[tuple[int, Ints | None], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Computed:
    """Values of an expression of spikes.

    Attributes:
        name: key for the draws of delays.
        operations: operations of the expression. The last operation gives the value.
        every: number of steps between two values.
        delay: time from a value to its effect, in steps, or a distribution in ms.
        tau: time constant in ms with which the sum of doses decays; 0: the values are not doses.
        largest: bound of the absolute values; None if unknown.
    """

    name: str
    operations: tuple[Operation, ...]
    every: int
    delay: int | Distribution
    tau: float
    largest: float | None = None


@dataclass(frozen=True, slots=True)
class Signal:
    """Signal with the index of its target population.

    Attributes:
        values: source of the values, the same object for signals set together; None for values set from outside.
        scale: the factor on these values, shape (1,) or (size,).
        in_world: the largest absolute value that the world of the network sets; None without a world that sets the
            signal.
    """

    name: str
    target: int
    origin: Where | None
    values: Schedule | Computed | None = None
    scale: Floats | None = None
    in_world: float | None = None

    @property
    def largest(self) -> float | None:
        """The largest possible absolute value of the signal; None if unknown."""
        if self.scale is None or self.values is None:
            return self.in_world
        largest = self.values.values if isinstance(self.values, Schedule) else self.values.largest
        return None if largest is None else float(np.abs(largest * self.scale).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class Group:
    """Competing neurons of a population, and the rule of competition."""

    name: str
    population: int
    choice: Competition
    origin: Where | None


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """A recording of a population: "spikes", the "rate" or a state, every `every` steps, or the mean of a state.

    `ids` are the recorded neurons, in this order (None: all).
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
    """A recording of a state of synapses.

    Attributes:
        every: steps between two records; 0: the value after each presynaptic spike.
        synapses: indices of the recorded synapses in the order of the weights, ascending; None: all.
        mean: whether the mean over the synapses is recorded instead of each value.
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
    """The settings of trials.

    Attributes:
        input, output: indices of the generator and of the population that decides.
        group: index of the winner-take-all group of the output.
        duration: length of a trial in ticks.
        stop_at_decision: whether the first spike ends a trial.
        spikes: the spikes of an input that teach: "once" (a second spike is refused), "first" or "each".
        maps, maps_per_label: maps of the output, and maps for each label (0: no labels).
        reward: reward by outcome (correct, wrong, silent).
        dropout: share of maps dropped in epoch 0; `dropout_decay` per epoch; `dropout_per_trial`.
        reset: states of the output that are reset before each trial.
        anew: whether all neurons and all states that learn, except weights, are reset before each trial. Synapses that
            learn by dopamine need this.
        after: number of ticks that follow a trial that teaches.
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
    """A compiled network.

    Attributes:
        resolution: length of a step in ms, for the models' constants.
        min_delay: the smallest delay in steps.
        share: the share of the synapses that this process has. Methods return values over all shares, so every process
            with a share must call them.
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
        """Refuse an operation that needs all synapses in one process.

        Raises:
            ModelError: this process has only a share of the synapses, or the backend draws some.
        """
        for index in range(len(self.projections)):
            self.refuse_undrawn(index)
        if self.share.number > 1:
            message = f"{what}: found a network that is divided among {self.share.number} processes"
            raise ModelError(f"{message}: expected one process", hint="run it without mpirun")

    def refuse_undrawn(self, index: int) -> None:
        """Refuse an operation that needs the synapses of a projection.

        Raises:
            ModelError: the backend draws the synapses.
        """
        part = self.projections[index]
        if part.undrawn is not None:
            message = f"projection '{part.name}': its synapses are drawn by the backend, which does not list them"
            hint = f"without 'draw: backend' in {part.undrawn.rule.name} they are drawn before, and can be read and set"
            raise ModelError(message, where=part.origin, hint=hint)

    def sends_at_once(self, part: Projection) -> bool:
        """Return whether a spike is sent with the weights of the step of emission, not of the next step.

        NEST's generators are devices, which send while they update. Neurons send when the next step begins, and so does
        every source of synapses that learn by pairs or moves.
        """
        return self.populations[part.source].kind != "neuron" and part.synapse.learns not in ("pairs", "moves")

    def connections(self, index: int) -> tuple[Ints, Ints]:
        """Return source and target of every synapse of a projection, in weight order (not for a grid)."""
        self.refuse_undrawn(index)
        part = self.projections[index]
        ends = connections_of(part, self.populations[part.source].size, self.populations[part.target].size)
        pre, post = (self.joined(index, ids) for ids in ends)
        return pre, post

    def joined(self, index: int, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of all synapses of a projection, in weight order, from those of the share."""
        part = self.projections[index]
        return values if part.share.number == 1 else part.rows.joined(values)

    def delays(self, index: int) -> NDArray[np.integer[Any]]:
        """Return the delays of all synapses of a projection in steps, shape (1,) where shared."""
        self.refuse_undrawn(index)
        part = self.projections[index]
        shortest, longest = part.delay_span
        if part.share.number == 1:
            return part.delay
        return np.array([longest]) if shortest == longest else self.joined(index, part.delay)

    def own(self, index: int, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of the synapses of the share, from the values of all synapses of a projection."""
        part = self.projections[index]
        return values if part.share.number == 1 or len(values) == 1 else values[part.rows.places()]

    def own_synapses(self, index: int) -> tuple[Ints, Ints, Ints]:
        """Return `synapses` for the share only. The indices of the weights count within the share."""
        part = self.projections[index]
        if part.share.number == 1:
            return self.synapses(index)
        sizes = self.populations[part.source].size, self.populations[part.target].size
        return (*connections_of(part, *sizes), np.arange(part.targets.size))

    def synapses(self, index: int) -> tuple[Ints, Ints, Ints]:
        """Return source, target and weight index of every synapse of a projection, in weight order.

        The synapses of a grid are sorted by source, then target, and share weights. Elsewhere each synapse has its own
        weight.
        """
        part = self.projections[index]
        if part.grid is not None:
            return _grid_synapses(part.grid)
        return (*self.connections(index), np.arange(part.size))


def connections_of(part: Projection, n_source: int, n_target: int) -> tuple[Ints, Ints]:
    """Return source and target of every synapse between populations of these sizes (not of a grid)."""
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


def _grid_synapses(grid: Grid) -> tuple[Ints, Ints, Ints]:
    """Return source, target and index of the weight of every synapse of a grid, sorted by source, then target."""
    maps, depth, height, width = grid.kernels
    m, r, c, k, i, j = np.indices((maps, grid.rows, grid.columns, depth, height, width))
    y, x = r * grid.stride + i - grid.top, c * grid.stride + j - grid.left
    inside = (y >= 0) & (y < grid.height) & (x >= 0) & (x < grid.width)
    source = (((k + m // grid.reach) * grid.height + y) * grid.width + x)[inside]
    target = ((m * grid.rows + r) * grid.columns + c)[inside]
    slot = (((m * depth + k) * height + i) * width + j)[inside]
    order = np.lexsort((target, source))
    return source[order], target[order], slot[order]


class Stretch(NamedTuple):
    """A batch of spikes, sorted by step. With the batches before, all spikes up to step `until`."""

    until: int
    steps: Ints
    ids: Ints


class Stream(Protocol):
    """A source of spikes for a population. Several callers can read a stream, since each stores its own position."""

    @property
    def repeatable(self) -> bool:
        """True if the stream can be read from the beginning several times."""

    @property
    def identity(self) -> str:
        """Text that distinguishes this stream from others, to check a saved state against it."""

    def after(self, step: int) -> Iterator[Stretch]:
        """Return all spikes of later steps, in batches, up to the end of the stream.

        Raises:
            ModelError: the source is damaged. All spikes before the damage have been returned. A caller that asks again
                for the spikes after the last batch gets the same error.
        """

    def spikes_of(self, events: Any) -> tuple[Ints, Ints]:
        """Return steps and neurons of the spikes that a caller supplies while the network runs.

        Raises:
            ModelError: the values cannot be emitted as spikes.
        """
