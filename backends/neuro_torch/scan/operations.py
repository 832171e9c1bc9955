"""Scans by torch's own operations, for devices without compiled kernels; gradients are autograd's.

The interface is that of `neuro_torch.scan.compiled`. Synapses are matrices, one for each delay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from neuro_torch.events import Train
from neuro_torch.scan import kernels
from neuro_torch.scan.gradients import joined
from neuro_torch.scan.layers import Cells, Component, ScanTask, Synapses

Fire = Callable[[Tensor, ScanTask], Tensor]
"""Function that returns spikes from x = (V_m - V_th) / (V_th - V_reset)."""


class SpikeLists(NamedTuple):
    """Spikes of a batch: recording, step and neuron of each spike."""

    recording: Tensor
    step: Tensor
    neuron: Tensor


def pack_train(train: Train, task: ScanTask) -> SpikeLists:
    """Return the spikes of an input population as lists, on the device of the scan."""
    recording = torch.repeat_interleave(torch.arange(task.batch), torch.from_numpy(train.ends).diff())
    parts = (recording, torch.from_numpy(train.step).long(), torch.from_numpy(train.neuron).long())
    return SpikeLists(*(part.to(task.device) for part in parts))


def drive(part: Synapses, spikes: Tensor | SpikeLists, weight: Tensor, task: ScanTask) -> Tensor:
    """Return the input that spikes deliver through a projection, (batch, steps, targets)."""
    zeros = torch.zeros(task.batch, task.steps, part.sizes[1], dtype=task.dtype, device=task.device)
    out = joined(zeros, [weight])
    for delay, matrix in matrices(part, weight).items():
        if delay >= task.steps:
            continue
        if isinstance(spikes, SpikeLists):
            arrives = spikes.step + delay < task.steps
            place = (spikes.recording * task.steps + spikes.step + delay)[arrives]
            out = out.flatten(0, 1).index_add(0, place, matrix[spikes.neuron[arrives]]).view(out.shape)
        else:
            arriving = torch.matmul(spikes[:, : task.steps - delay], matrix)
            out = out + torch.nn.functional.pad(arriving, (0, 0, delay, 0))
    return out


def matrices(part: Synapses, weight: Tensor) -> dict[int, Tensor]:
    """Return the weights by delay in steps, as matrices (sources, targets)."""
    if part.dense:
        return {part.least: weight.expand(part.sizes)}
    target, slot, delay = (torch.from_numpy(x).long().to(weight.device) for x in (part.targets, part.slot, part.delay))
    ends = torch.from_numpy(part.row_ends).to(weight.device)
    source = torch.repeat_interleave(torch.arange(part.sizes[0], device=weight.device), ends.diff())
    flat, delay_groups = weight.reshape(-1)[slot], {}
    for steps in torch.unique(delay).tolist():
        has_delay = delay == steps
        empty = torch.zeros(part.sizes[0] * part.sizes[1], dtype=weight.dtype, device=weight.device)
        delay_groups[steps] = empty.index_add(0, (source * part.sizes[1] + target)[has_delay], flat[has_delay]).view(
            part.sizes
        )
    return delay_groups


class _Spike(torch.autograd.Function):
    """A threshold at 0 whose derivative is the surrogate's."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, task: ScanTask) -> Tensor:
        ctx.save_for_backward(x)
        ctx.surrogate = task.surrogate
        return (x >= 0).to(x.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        return grads[0] * ctx.surrogate.derivative(ctx.saved_tensors[0]), None


class _Damped(torch.autograd.Function):
    """The identity with its gradient multiplied by `damping`."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, damping: float) -> Tensor:
        ctx.damping = damping
        return x.view_as(x)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        return grads[0] * ctx.damping, None


def spike(x: Tensor, task: ScanTask) -> Tensor:
    """Return 1 at the threshold and above, else 0."""
    fired: Tensor = _Spike.apply(x, task)  # type: ignore[no-untyped-call]
    return fired


class _Population:
    """States and results of a population during the forward pass."""

    def __init__(self, part: Cells, drive: Tensor, task: ScanTask, fire: Fire) -> None:
        self.part, self.drive, self.task, self.fire = part, list(drive.unbind(1)), task, fire
        self.c, push, v, current = (
            torch.as_tensor(x).to(task.device, task.dtype)
            for x in (part.constants, task.push[part.population], part.v, part.current)
        )
        self.push = push.expand(task.steps, part.size)
        self.v, self.current = (x.expand(task.batch, part.size) for x in (v, current))
        self.refractory = torch.zeros_like(self.v)
        self.spikes: list[Tensor] = []
        self.potential: list[Tensor] = []

    def go(self, t: int) -> None:
        """Run one step."""
        c, is_refractory = self.c, self.refractory > 0
        new = c[kernels.E_L] + c[kernels.P33] * (self.v - c[kernels.E_L])
        if self.part.model == "iaf_psc_delta":
            new = new + self.push[t] + self.drive[t]
            new = torch.where(new < c[kernels.V_MIN], c[kernels.V_MIN], new)
        else:
            new = new + c[kernels.P32] * self.current + self.push[t]
            self.current = self.current * c[kernels.P11] + self.drive[t]
        new = torch.where(is_refractory, self.v, new)
        fired = new >= c[kernels.V_TH]
        # The sign of the difference of two numbers is exact, so x >= 0 where V >= V_th.
        self.spikes.append(self.fire((new - c[kernels.V_TH]) / (c[kernels.V_TH] - c[kernels.V_RESET]), self.task))
        self.potential.append(new)
        self.v = torch.where(fired, c[kernels.V_RESET], new)
        self.refractory = torch.where(fired, c[kernels.REFRACTORY], (self.refractory - 1).clamp(min=0))


def scan(
    part: Component, drives: Mapping[int, Tensor], weights: Sequence[Tensor], task: ScanTask, fire: Fire = spike
) -> tuple[dict[int, Tensor], dict[int, Tensor]]:
    """Return spikes and potentials before the reset of the populations of a component, from their input.

    Args:
        part: the component.
        drives: input from outside the component, by population.
        weights: weights of the synapses inside, in their order.
        task: sizes, dtype and surrogate of the pass.
        fire: function from the distance above threshold to spikes; tests use a smooth one.
    """
    populations = {k: _Population(cell, joined(drives[k], weights), task, fire) for k, cell in part.cells.items()}
    inside = [(s, matrices(s, w)) for s, w in zip(part.inside, weights, strict=True)]
    for t in range(task.steps):
        for pop in populations.values():
            pop.go(t)
        for synapses, delay_groups in inside:
            spikes_sent = _Damped.apply(populations[synapses.source].spikes[t], task.damping)  # type: ignore[no-untyped-call]
            target_drive = populations[synapses.target].drive
            for delay, matrix in delay_groups.items():
                if t + delay < task.steps:
                    target_drive[t + delay] = target_drive[t + delay] + spikes_sent @ matrix
    spikes, potentials = (
        {k: torch.stack(getattr(pop, word), 1) for k, pop in populations.items()} for word in ("spikes", "potential")
    )
    return spikes, potentials
