"""A network on backends and chips: what it decides on recordings, what one of them takes, registers that overflow."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch

import neuro
import neuro_torch
from neuro.apps import Evaluation, Overflows, Showing, evaluate
from neuro.chips import place, price
from neuro_train.data import BatchData
from neuro_train.plan import TrainingPlan
from neuro_train.room import AT_ONCE, MemoryRoom, chip_of, scales
from neuro_train.targets import probe, r_squared, r_squared_text

if TYPE_CHECKING:
    from neuro.chips import Energy


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
    bill = _bill(sim, showing.taken, backend, len(shown), plan.neurons_per_core)
    events_of = () if showing.taken is None else showing.taken.raw_counts.events
    counts = zip(sim.program.populations, events_of, strict=False)
    sent = {part.name: float(each.sum()) / len(shown) for part, each in counts}
    said = np.stack(potentials) if potentials else None
    return replace(_tried(backend, spikes, shown, h, bill, showing.overflows), sent=sent, V_m=said)


def _bill(
    sim: neuro.Simulation, taken: Any, target: str, recordings: int, neurons_per_core: int | None
) -> Energy | None:
    """What a recording takes on the chip that a backend emulates."""
    priced = chip_of(target)
    if priced is None or not priced.costs:
        return None
    placed = place(sim.program, priced, neurons_per_core=neurons_per_core) if priced.mesh is not None else None
    return price(sim.program, taken.raw_counts, placed, priced).per(recordings, "recording")


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
