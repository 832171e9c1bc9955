"""A network on backends and chips: what it decides on recordings, what one of them takes, and room in registers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch

import neuro
import neuro_torch
from neuro.apps import Checkpoint, Evaluation, Overflows, Showing, evaluate
from neuro.chips import chip, chips, filled, place, price, quantise
from neuro_train.data import BatchData, probe, r_squared, r_squared_text
from neuro_train.plan import TrainingPlan
from neuro_train.trainer import Trained, learn, module_of

if TYPE_CHECKING:
    from neuro.chips import Chip, Energy


MARGIN = 2.0
"""The largest input of the recordings that were learnt from, times this, shall fit into its register."""
AT_ONCE = 50
"""Recordings that a module is shown at once."""


@dataclass(frozen=True, slots=True)
class MemoryRoom:
    """How much of its registers the input of a population takes on a chip.

    Attributes:
        chip: its name.
        population: whose.
        share: the largest of any neuron and step of the recordings that were learnt from, at `scale`; 1 wraps.
        scale: units of the voltage register per mV.
        chosen: whether the scale was made smaller than the chip's own, to leave room.
    """

    chip: str
    population: str
    share: float
    scale: float
    chosen: bool


def chip_of(target: str) -> Chip | None:
    """The chip that a backend emulates, if it does."""
    return chip(target) if target in chips() or target.endswith((".yaml", ".yml")) else None


def rooms(net: neuro.Network, target: str, shown: BatchData, plan: TrainingPlan) -> list[MemoryRoom]:
    """How much room a chip's registers have, at scales that leave some.

    A chip chooses a scale as fine as its threshold allows, so that only a sum of all synapses is sure to fit. Here it
    is halved until the largest sum of some recordings fits `MARGIN` times, or a weight would lose a bit.

    Args:
        net: what was learnt.
        target: the chip; another backend has no registers.
        shown: the recordings that were learnt from.
        plan: how they are seen.

    Returns:
        Of each population that spikes reach; none where the chip's arithmetic does not say (`neuro.chips.filled`).
    """
    on = chip_of(target)
    if on is None or not on.arithmetic:
        return []
    every = [name for name, part in net.populations.items() if part.model.role == "neuron"]
    if all(net.populations[name].model.graded for name in every):
        return []  # their sums have 32 bits, and no current
    module = module_of(net, replace(plan, bits=None), every).eval()
    fixed = quantise(module.program, on)
    shares: dict[str, float] = {}
    for first in range(0, len(shown), AT_ONCE):
        events = shown.events[list(range(first, min(first + AT_ONCE, len(shown))))]
        with torch.no_grad():
            spikes = {name: each.cpu().numpy() for name, each in module(events).spikes.items()}
        for name, train in events.trains.items():
            size = math.prod(int(side) for side in net.populations[name].shape)
            spikes[name] = np.zeros((events.batch, events.steps, size), np.float32)
            spikes[name][np.repeat(np.arange(events.batch), np.diff(train.ends)), train.step, train.neuron] = 1.0
        for name, share in filled(fixed, spikes).items():
            shares[name] = max(share, shares.get(name, 0.0))
    found = []
    for k, cells in enumerate(fixed.populations):
        if cells.name in shares:
            parts = zip(module.program.projections, fixed.projections, strict=True)
            spare = min(wires.exponent for part, wires in parts if part.target == k and wires is not None)
            wanted = math.ceil(math.log2(max(MARGIN * shares[cells.name], 1.0)))
            less = 2.0 ** max(0, min(wanted, spare))
            found.append(MemoryRoom(target, cells.name, shares[cells.name] / less, cells.volt / less, less > 1.0))
    return found


def scales(found: Sequence[MemoryRoom], target: str) -> dict[str, float]:
    """The option `scales` of `neuro.compile` on a chip: of the populations whose scale is not the chip's own."""
    return {room.population: room.scale for room in found if room.chip == target and room.chosen}


def told(found: Sequence[MemoryRoom]) -> list[str]:
    """A line for each chip."""
    lines = []
    for target in dict.fromkeys(room.chip for room in found):
        shares = ", ".join(f"{room.share:.0%} of that of '{room.population}'" for room in found if room.chip == target)
        own = ", ".join(f"'{name}': {scale:.6g}" for name, scale in scales(found, target).items())
        way = f"; scales={{{own}}} leaves this room" if own else ""
        lines.append(f"{target}: input registers on the recordings learnt from: at most {shares}{way}")
    return lines


def summed(each: Iterator[Mapping[str, Any]]) -> dict[str, tuple[int, str]]:
    """Those of several sets of recordings."""
    found: dict[str, tuple[int, str]] = {}
    for one in each:
        for what, (recordings, hint) in one.items():
            found[what] = found.get(what, (0, ""))[0] + recordings, hint
    return found


Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class TestedNetwork:
    """What came of some recordings.

    Attributes:
        backend: that ran them; "torch" is the module that learnt.
        spikes: of the output, of a graded one its payloads, (recordings, steps, neurons).
        decided: the class of each, -1 for silence.
        labels: the right ones, or targets.
        classes: names.
        first_ms: the first spike of the output, the mean of the recordings that have one.
        bill: of a recording, where the backend is a chip that has costs.
        overflows: of the registers of a chip, in how many recordings.
        sent: spikes or messages of a recording, the mean, by population; none of "torch".
        V_m: of the output where there are targets, mV, (recordings, steps, neurons).
    """

    backend: str
    spikes: npt.NDArray[np.floating]
    decided: Ints
    labels: Ints
    classes: tuple[str, ...]
    first_ms: float
    bill: Energy | None = None
    overflows: Overflows = field(default_factory=dict)
    sent: Mapping[str, float] = field(default_factory=dict)
    V_m: npt.NDArray[np.floating] | None = None

    @property
    def own(self) -> Evaluation:
        """How good the decisions are."""
        return evaluate(self.decided, self.labels, self.classes)

    @property
    def r_squared(self) -> float:
        """The explained share of the targets' variance; NaN where the targets are constant."""
        return r_squared(np.asarray(self.V_m), self.labels)

    @property
    def grade(self) -> str:
        """How good it is, in words."""
        return f"{self.own.accuracy:.1%} right" if self.V_m is None else r_squared_text(self.r_squared)

    def agrees(self, other: TestedNetwork) -> float:
        """The share of decisions that are equal."""
        return float(np.mean(self.decided == other.decided))

    def same_spikes(self, other: TestedNetwork) -> int:
        """Recordings whose spikes are all equal."""
        return int((self.spikes == other.spikes).all(axis=(1, 2)).sum())


def by_module(module: neuro_torch.Module, shown: BatchData, plan: TrainingPlan) -> TestedNetwork:
    """By what learnt, on its device."""
    parts, potentials = [], []
    with torch.no_grad():
        for first in range(0, len(shown), AT_ONCE):
            chosen = list(range(first, min(first + AT_ONCE, len(shown))))
            found = module.eval()(shown.events[chosen])
            parts.append(found.spikes[plan.output].cpu())
            if plan.loss == "mse":
                potentials.append(found.V_m[plan.output].cpu())
    tried = _tried("torch", torch.cat(parts), shown, module.program.resolution)
    return replace(tried, V_m=torch.cat(potentials).numpy()) if potentials else tried


def on_backend(
    net: neuro.Network,
    backend: str,
    shown: BatchData,
    plan: TrainingPlan,
    report: Callable[[str, int, int], None] = lambda what, done, total: None,
    room: Sequence[MemoryRoom] = (),
) -> TestedNetwork:
    """By a backend, one recording after the other, each from the beginning.

    Args:
        net: what was learnt.
        backend: its name; one of a chip gives a bill.
        shown: the recordings.
        plan: how they are seen.
        report: called with how many are done.
        room: in its registers, whose scales it takes.

    Raises:
        ModelError: the backend refuses the network.
    """
    options: dict[str, Any] = {"scales": own} if (own := scales(room, backend)) else {}
    sim = neuro.compile(net, backend=backend, seed=plan.seed, **options)
    events, h = shown.events, net.resolution
    neurons = math.prod(int(side) for side in net.populations[plan.output].shape)
    spikes = torch.zeros(len(shown), events.steps, neurons, dtype=torch.float64)  # they hold payloads of 32 bits
    showing, potentials = Showing(sim, plan.input, plan.output), []
    for k in range(len(shown)):
        train = events.trains[plan.input].of([k])
        times, ids, payloads = showing.show(train.step, train.neuron, events.steps)
        at = np.rint(times / h).astype(np.int64) - 1, ids
        np.add.at(spikes[k].numpy(), at, 1.0 if payloads is None else payloads)
        if plan.loss == "mse":
            potentials.append(sim.trace(probe(plan.output))[1])
        report(f"{backend}: testing", k + 1, len(shown))
    priced, bill, fewer = chip_of(backend), None, plan.neurons_per_core
    if priced is not None and priced.costs:
        placed = place(sim.program, priced, neurons_per_core=fewer) if priced.mesh is not None else None
        taken: Any = showing.taken
        bill = price(sim.program, taken.raw_counts, placed, priced).per(len(shown), "recording")
    events_of = () if showing.taken is None else showing.taken.raw_counts.events
    counts = zip(sim.program.populations, events_of, strict=False)
    sent = {part.name: float(each.sum()) / len(shown) for part, each in counts}
    said = np.stack(potentials) if potentials else None
    return replace(_tried(backend, spikes, shown, h, bill, showing.overflows), sent=sent, V_m=said)


def _tried(
    backend: str,
    spikes: torch.Tensor,
    shown: BatchData,
    step: float,
    bill: Energy | None = None,
    overflows: Overflows | None = None,
) -> TestedNetwork:
    decided = neuro_torch.losses.decisions(spikes).numpy()
    first = neuro_torch.losses.first_spike_steps(spikes).amin(dim=1)
    some = first < spikes.shape[1]
    mean = float((first[some] + 1.0).mean()) * step if bool(some.any()) else float("nan")
    return TestedNetwork(backend, spikes.numpy(), decided, shown.labels, shown.classes, mean, bill, overflows or {})


def train_and_test(
    net: neuro.Network,
    out: Path,
    shown: BatchData,
    unseen: BatchData | None,
    plan: TrainingPlan,
    backends: Sequence[str],
    chips: Sequence[str],
    checkpoint: Checkpoint,
    tell: Callable[[int, Mapping[str, float]], None],
    report: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> tuple[Trained, list[MemoryRoom], list[TestedNetwork]]:
    """Train a network, write it, and test it by the module that learnt and on backends.

    Args:
        net: the network; it is not changed.
        out: file of what was learnt.
        shown: recordings to learn from.
        unseen: recordings to test on; None: no test.
        plan: settings of the training.
        backends: to test on.
        chips: whose room in registers is measured; other backends have none.
        checkpoint: where the training is kept; the caller removes it when all that follows is written.
        tell: called with the epochs that are done, and what was noted of the last.
        report: called with how many recordings are tested.
    """
    trained = learn(net, shown, plan, checkpoint, tell)
    trained.net.save(out)
    room = [one for name in dict.fromkeys(chips) for one in rooms(trained.net, name, shown, plan)]
    if unseen is None:
        return trained, room, []
    tried = [by_module(trained.module, unseen, plan)]
    tried += [on_backend(trained.net, backend, unseen, plan, report, room) for backend in backends]
    return trained, room, tried
