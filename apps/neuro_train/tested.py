"""Tests of a network on backends and chips: decisions, energy of a recording, and room in registers."""

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
"""A register must hold this many times the largest input of the learnt recordings."""
AT_ONCE = 50
"""Number of recordings in a batch of a module."""


@dataclass(frozen=True, slots=True)
class MemoryRoom:
    """Share of a chip's input registers that a population uses.

    Attributes:
        chip: name of the chip.
        population: name of the population.
        share: largest share over neurons and steps of the learnt recordings, at `scale`; above 1 a register wraps.
        scale: units of the voltage register per mV.
        chosen: True if the scale is smaller than the chip's own, to leave room.
    """

    chip: str
    population: str
    share: float
    scale: float
    chosen: bool


def chip_of(target: str) -> Chip | None:
    """Return the chip that a backend emulates, or None."""
    return chip(target) if target in chips() or target.endswith((".yaml", ".yml")) else None


def rooms(net: neuro.Network, target: str, samples: BatchData, plan: TrainingPlan) -> list[MemoryRoom]:
    """Return the room in a chip's registers, at scales that leave some room.

    By default the scale is the finest that the threshold allows, but then the sum of all synapses may overflow. Here
    the scale is halved until the largest sum of the learnt recordings fits `MARGIN` times, or a weight would lose a
    bit.

    Args:
        net: the trained network.
        target: name or table file of a chip; other backends have no registers.
        samples: the learnt recordings.
        plan: settings of the training.

    Returns:
        An entry for each population that spikes reach; empty if the chip's arithmetic is unknown
        (`neuro.chips.filled`).
    """
    device = chip_of(target)
    if device is None or not device.arithmetic:
        return []
    cell_names = [name for name, part in net.populations.items() if part.model.role == "neuron"]
    if all(net.populations[name].model.graded for name in cell_names):
        return []  # graded neurons sum in 32 bits and have no current
    module = module_of(net, replace(plan, bits=None), cell_names).eval()
    fixed = quantise(module.program, device)
    shares: dict[str, float] = {}
    for first in range(0, len(samples), AT_ONCE):
        events = samples.events[list(range(first, min(first + AT_ONCE, len(samples))))]
        with torch.no_grad():
            spikes = {name: trains.cpu().numpy() for name, trains in module(events).spikes.items()}
        for name, train in events.trains.items():
            size = math.prod(int(side) for side in net.populations[name].shape)
            spikes[name] = np.zeros((events.batch, events.steps, size), np.float32)
            spikes[name][np.repeat(np.arange(events.batch), np.diff(train.ends)), train.step, train.neuron] = 1.0
        for name, share in filled(fixed, spikes).items():
            shares[name] = max(share, shares.get(name, 0.0))
    table = []
    for k, cells in enumerate(fixed.populations):
        if cells.name in shares:
            parts = zip(module.program.projections, fixed.projections, strict=True)
            spare_bits = min(wires.exponent for part, wires in parts if part.target == k and wires is not None)
            halvings = math.ceil(math.log2(max(MARGIN * shares[cells.name], 1.0)))
            ratio = 2.0 ** max(0, min(halvings, spare_bits))
            table.append(MemoryRoom(target, cells.name, shares[cells.name] / ratio, cells.volt / ratio, ratio > 1.0))
    return table


def scales(table: Sequence[MemoryRoom], target: str) -> dict[str, float]:
    """Return the option `scales` of `neuro.compile` for the populations with a scale other than the chip's own."""
    return {room.population: room.scale for room in table if room.chip == target and room.chosen}


def memory_lines(table: Sequence[MemoryRoom]) -> list[str]:
    """Return a line for each chip: the used share of its input registers, and the scales that leave this share."""
    lines = []
    for target in dict.fromkeys(room.chip for room in table):
        shares = ", ".join(f"{room.share:.0%} of that of '{room.population}'" for room in table if room.chip == target)
        options = ", ".join(f"'{name}': {scale:.6g}" for name, scale in scales(table, target).items())
        hint = f"; scales={{{options}}} leaves this room" if options else ""
        lines.append(f"{target}: input registers on the recordings learnt from: at most {shares}{hint}")
    return lines


def summed(parts: Iterator[Mapping[str, Any]]) -> dict[str, tuple[int, str]]:
    """Return the overflows of several sets of recordings together."""
    overflows: dict[str, tuple[int, str]] = {}
    for part in parts:
        for register, (recordings, hint) in part.items():
            overflows[register] = overflows.get(register, (0, ""))[0] + recordings, hint
    return overflows


Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class TestedNetwork:
    """Results of a network on some recordings.

    Attributes:
        backend: backend of the test; "torch" is the trained module.
        spikes: (recordings, steps, neurons) output spikes, or payloads of a graded output.
        decided: class of each recording, -1 for silence.
        labels: true classes, or targets.
        classes: names of the classes.
        first_ms: mean time of the output's first spike in ms, over the recordings with output spikes.
        bill: bill of a recording, for a chip with costs.
        overflows: number of recordings with overflows, by register.
        mean_spikes: mean spikes or messages of a recording, by population; empty for "torch".
        V_m: (recordings, steps, neurons) potentials of the output, mV; None without targets.
    """

    backend: str
    spikes: npt.NDArray[np.floating]
    decided: Ints
    labels: Ints
    classes: tuple[str, ...]
    first_ms: float
    bill: Energy | None = None
    overflows: Overflows = field(default_factory=dict)
    mean_spikes: Mapping[str, float] = field(default_factory=dict)
    V_m: npt.NDArray[np.floating] | None = None

    @property
    def own(self) -> Evaluation:
        """Evaluation of the decisions."""
        return evaluate(self.decided, self.labels, self.classes)

    @property
    def r_squared(self) -> float:
        """Explained share of the targets' variance; NaN if the targets are constant."""
        return r_squared(np.asarray(self.V_m), self.labels)

    @property
    def grade(self) -> str:
        """Accuracy or R2 as text."""
        return f"{self.own.accuracy:.1%} right" if self.V_m is None else r_squared_text(self.r_squared)

    def agrees(self, other: TestedNetwork) -> float:
        """Return the share of recordings for which both tests decide alike."""
        return float(np.mean(self.decided == other.decided))

    def same_spikes(self, other: TestedNetwork) -> int:
        """Return the number of recordings whose output spikes are all equal in both tests."""
        return int((self.spikes == other.spikes).all(axis=(1, 2)).sum())


def by_module(module: neuro_torch.Module, samples: BatchData, plan: TrainingPlan) -> TestedNetwork:
    """Test the trained module on its device."""
    parts, potentials = [], []
    with torch.no_grad():
        for first in range(0, len(samples), AT_ONCE):
            indices = list(range(first, min(first + AT_ONCE, len(samples))))
            activity = module.eval()(samples.events[indices])
            parts.append(activity.spikes[plan.output].cpu())
            if plan.loss == "mse":
                potentials.append(activity.V_m[plan.output].cpu())
    result = _test_results("torch", torch.cat(parts), samples, module.program.resolution)
    return replace(result, V_m=torch.cat(potentials).numpy()) if potentials else result


def on_backend(
    net: neuro.Network,
    backend: str,
    samples: BatchData,
    plan: TrainingPlan,
    report: Callable[[str, int, int], None] = lambda what, count, total: None,
    room: Sequence[MemoryRoom] = (),
) -> TestedNetwork:
    """Test a network on a backend, one recording after the other, each from the initial state.

    Args:
        net: the trained network.
        backend: name of the backend; a chip also gives a bill.
        samples: the recordings.
        plan: settings of the training.
        report: called with the activity, the number of tested recordings, and the number of all.
        room: room in the chip's registers, whose scales are used.

    Raises:
        ModelError: the backend refuses the network.
    """
    options: dict[str, Any] = {"scales": table} if (table := scales(room, backend)) else {}
    sim = neuro.compile(net, backend=backend, seed=plan.seed, **options)
    events, h = samples.events, net.resolution
    neurons = math.prod(int(side) for side in net.populations[plan.output].shape)
    spikes = torch.zeros(len(samples), events.steps, neurons, dtype=torch.float64)  # doubles hold payloads of 32 bits
    showing, potentials = Showing(sim, plan.input, plan.output), []
    for k in range(len(samples)):
        train = events.trains[plan.input].of([k])
        n_events = 0 if samples.n_events is None else int(samples.n_events[k])
        times, ids, payloads = showing.show(train.step, train.neuron, events.steps, n_events)
        indices = np.rint(times / h).astype(np.int64) - 1, ids
        np.add.at(spikes[k].numpy(), indices, 1.0 if payloads is None else payloads)
        if plan.loss == "mse":
            potentials.append(sim.trace(probe(plan.output))[1])
        report(f"{backend}: testing", k + 1, len(samples))
    device, bill, core_limit = chip_of(backend), None, plan.neurons_per_core
    if device is not None and device.costs:
        placement = place(sim.program, device, neurons_per_core=core_limit) if device.mesh is not None else None
        run_counts: Any = showing.taken
        host = showing.host("" if plan.loss == "mse" else "counts")
        bill = price(sim.program, run_counts.raw_counts, placement, device, host=host).per(len(samples), "recording")
    events_of = () if showing.taken is None else showing.taken.raw_counts.events
    counts = zip(sim.program.populations, events_of, strict=False)
    mean_spikes = {part.name: float(events.sum()) / len(samples) for part, events in counts}
    V_m = np.stack(potentials) if potentials else None
    results = _test_results(backend, spikes, samples, h, bill, showing.overflows)
    return replace(results, mean_spikes=mean_spikes, V_m=V_m)


def _test_results(
    backend: str,
    spikes: torch.Tensor,
    samples: BatchData,
    step: float,
    bill: Energy | None = None,
    overflows: Overflows | None = None,
) -> TestedNetwork:
    decided = neuro_torch.losses.decisions(spikes).numpy()
    first_steps = neuro_torch.losses.first_spike_steps(spikes).amin(dim=1)
    has_spikes = first_steps < spikes.shape[1]
    mean = float((first_steps[has_spikes] + 1.0).mean()) * step if bool(has_spikes.any()) else float("nan")
    return TestedNetwork(backend, spikes.numpy(), decided, samples.labels, samples.classes, mean, bill, overflows or {})


def train_and_test(
    net: neuro.Network,
    out: Path,
    samples: BatchData,
    unseen: BatchData | None,
    plan: TrainingPlan,
    backends: Sequence[str],
    chips: Sequence[str],
    checkpoint: Checkpoint,
    tell: Callable[[int, Mapping[str, float]], None],
    report: Callable[[str, int, int], None] = lambda what, count, total: None,
) -> tuple[Trained, list[MemoryRoom], list[TestedNetwork]]:
    """Train a network, write it, and test the module and the network on backends.

    Args:
        net: the network, which is not changed.
        out: file of the trained network.
        samples: recordings to learn from.
        unseen: recordings to test on; None for no test.
        plan: settings of the training.
        backends: backends to test on.
        chips: chips whose room in registers is measured; other backends have no registers.
        checkpoint: checkpoint of the training; the caller removes it after writing all results.
        tell: called with the number of finished epochs, and the figures of the last epoch.
        report: called with the number of tested recordings.
    """
    trained = learn(net, samples, plan, checkpoint, tell)
    trained.net.save(out)
    room = [memory_room for name in dict.fromkeys(chips) for memory_room in rooms(trained.net, name, samples, plan)]
    if unseen is None:
        return trained, room, []
    tests = [by_module(trained.module, unseen, plan)]
    tests += [on_backend(trained.net, backend, unseen, plan, report, room) for backend in backends]
    return trained, room, tests
