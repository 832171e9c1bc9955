"""Scans as torch functions, on kernels compiled for the CPU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neuro_torch.events import Train
from neuro_torch.scan import kernels
from neuro_torch.scan.gradients import once
from neuro_torch.scan.layers import Cells, Component, ScanTask, Synapses
from neuro_torch.surrogates import Surrogate

Array = NDArray[Any]


class Packed(NamedTuple):
    """Spikes of all steps or of a stretch, in the format of `neuro_torch.scan.kernels`."""

    ends: NDArray[np.int64]
    ids: NDArray[np.int32]
    values: Array


def pack_train(train: Train, task: ScanTask) -> Packed:
    """Return the spikes of a population of inputs in packed form."""
    ones = np.ones(len(train.neuron), dtype=np.float32 if task.dtype == torch.float32 else np.float64)
    return Packed(train.rows(task.steps), train.neuron, ones)


def packed(spikes: Tensor) -> Packed:
    """Return the spikes of a dense tensor, (batch, steps, neurons), in packed form."""
    array = spikes.detach().contiguous().numpy()
    return _pack(array, 0, array.shape[1], kernels.number(array))


def _pack(array: Array, first: int, width: int, capacity: int) -> Packed:
    ends = np.empty(array.shape[0] * width + 1, dtype=np.int64)
    spikes = Packed(ends, np.empty(capacity, dtype=np.int32), np.empty(capacity, dtype=array.dtype))
    kernels.pack(array, first, width, *spikes)
    return spikes


def drive(part: Synapses, spikes: Tensor | Packed, weight: Tensor, task: ScanTask) -> Tensor:
    """Return the input that spikes deliver through a projection, (batch, steps, targets)."""
    dense = spikes if isinstance(spikes, Tensor) else None
    packed_spikes = packed(spikes) if isinstance(spikes, Tensor) else spikes
    driven: Tensor = _Drive.apply(dense, weight, part, packed_spikes, task)  # type: ignore[no-untyped-call]
    return driven


class _Drive(torch.autograd.Function):
    """The input through one projection, over all steps."""

    @staticmethod
    def forward(
        ctx: Any, dense: Tensor | None, weight: Tensor, part: Synapses, spikes: Packed, task: ScanTask
    ) -> Tensor:
        ctx.part, ctx.spikes, ctx.task = part, spikes, task
        ctx.save_for_backward(weight)
        out = torch.zeros(task.batch, task.steps, part.sizes[1], dtype=task.dtype)
        _push(part, spikes, 0, task.steps, rows_of(part, weight), out.numpy())
        return out

    @staticmethod
    @once
    def backward(ctx: Any, *grads: Tensor) -> Any:
        part, task, (weight,), grad = ctx.part, ctx.task, ctx.saved_tensors, grads[0].contiguous()
        weight_gradient = spike_gradient = None
        if ctx.needs_input_grad[1]:
            weight_gradient = weight_gradient_of(part, ctx.spikes, weight, grad)
        if ctx.needs_input_grad[0]:
            spike_gradient = torch.zeros(task.batch, task.steps, part.sizes[0], dtype=task.dtype)
            _pull(part, 0, task.steps, weight, grad, 1.0, spike_gradient)
        return spike_gradient, weight_gradient, None, None, None


def rows_of(part: Synapses, weight: Tensor) -> Array:
    """Return the weights in the layout of the kernels: rows by source if dense, else a flat array."""
    weight = weight.detach()
    rows: Array = (weight.expand(part.sizes) if part.dense else weight.reshape(-1)).contiguous().numpy()
    return rows


def _push(part: Synapses, spikes: Packed, first: int, width: int, weight: Array, out: Array) -> None:
    if part.dense:
        kernels.push_dense(*spikes, first, width, weight, part.least, out)
    else:
        kernels.push_listed(*spikes, first, width, part.row_ends, part.targets, part.slot, part.delay, weight, out)


def _pull(
    part: Synapses, first: int, width: int, weight: Tensor, grad: Tensor, damping: float, to_spikes: Tensor
) -> None:
    """Add to the gradient of the spikes of a stretch (see `stretches`) the part that their delivered input gives."""
    longest = part.least if part.dense else int(part.delay.max(initial=0))
    begin, end = first + part.least, min(first + width + longest, grad.shape[1])
    if end <= begin:
        return
    if part.dense:
        back = torch.matmul(grad[:, begin:end], weight.detach().expand(part.sizes).T)
    else:
        back = _pull_listed(part, width, weight, grad[:, begin:end])
    to_spikes[:, first : first + back.shape[1]] += back if damping == 1.0 else damping * back


def _pull_listed(part: Synapses, width: int, weight: Tensor, grad: Tensor) -> Tensor:
    batch = len(grad)
    rows = grad.permute(2, 1, 0).reshape(part.sizes[1], -1).contiguous()
    back = torch.zeros(part.sizes[0], width * batch, dtype=grad.dtype)
    lists = (part.row_ends, part.targets, part.slot, part.delay)
    kernels.pull_listed(batch, part.least, *lists, rows_of(part, weight), rows.numpy(), back.numpy())
    return back.view(-1, width, batch).permute(2, 1, 0)


def weight_gradient_of(part: Synapses, spikes: Packed, weight: Tensor, grad: Tensor) -> Tensor:
    """Return the gradient of the weights from the gradient of the input in all steps."""
    steps, array = grad.shape[1], grad.numpy()
    if not part.dense:
        out = torch.zeros(weight.numel(), dtype=weight.dtype)
        lists = (part.row_ends, part.targets, part.slot, part.delay)
        kernels.teach_listed(*spikes, 0, steps, *lists, array, out.numpy())
        return out.reshape(weight.shape)
    out = torch.zeros(part.sizes, dtype=weight.dtype)
    kernels.teach_dense(*spikes, 0, steps, array, part.least, out.numpy())
    return out if weight.numel() > 1 or weight.shape == part.sizes else out.sum().reshape(weight.shape)


def scan(
    part: Component, drives: Mapping[int, Tensor], weights: Sequence[Tensor], task: ScanTask
) -> tuple[dict[int, Tensor], dict[int, Tensor]]:
    """Run the populations of a component. Return the spikes, and the potentials before a spike resets V_m.

    Args:
        part: the component.
        drives: input from outside the component, by population.
        weights: weights of the synapses inside, in their order.
        task: sizes, dtype and surrogate of the pass. Other populations than `potentials_of` may lack steps.
    """
    learns = torch.is_grad_enabled() and any(t.requires_grad for t in (*drives.values(), *weights))
    ins = [drives[k] for k in part.cells]
    results: tuple[Tensor, ...] = _Scan.apply(part, task, learns, *ins, *weights)  # type: ignore[no-untyped-call]
    n = len(part.cells)
    return dict(zip(part.cells, results[:n], strict=True)), dict(zip(part.cells, results[n:], strict=True))


class _Population:
    """States and results of a population during the forward pass."""

    def __init__(self, part: Cells, drive: Array, task: ScanTask, keeps_states: bool) -> None:
        dtype, batch = drive.dtype, task.batch
        self.part, self.drive = part, drive
        self.c, self.push = part.constants.astype(dtype), task.push[part.population].astype(dtype)
        self.v, self.current = (np.repeat(x[None].astype(dtype), batch, axis=0) for x in (part.v, part.current))
        self.refractory = np.zeros_like(self.v)
        self.keep = int(keeps_states or part.population in task.potentials_of)
        n_saved = task.steps if self.keep else 1
        self.potential = torch.empty(batch, n_saved, part.size, dtype=task.dtype)
        self.fate = np.empty((batch, n_saved, part.size), dtype=np.uint8)
        self.spikes = torch.empty(batch, task.steps, part.size, dtype=task.dtype)

    def go(self, first: int, last: int) -> None:
        """Run steps first <= t < last."""
        out = (self.potential.numpy(), self.spikes.numpy(), self.fate)
        if self.part.model == "iaf_psc_delta":
            kernels.delta(self.drive, self.push, first, last, self.c, self.v, self.refractory, self.keep, *out)
        else:
            states = (self.v, self.current, self.refractory)
            kernels.exp(self.drive, self.push, first, last, self.c, *states, self.keep, *out)


class _Adjoint:
    """Gradients of a population during the backward pass."""

    def __init__(self, part: Cells, spikes: Tensor, potential: Tensor, fate: Array, grads: tuple[Any, Any]) -> None:
        dtype = spikes.numpy().dtype
        self.part, self.c = part, part.constants.astype(dtype)
        self.saved = potential.numpy(), spikes.numpy(), fate
        self.to_spikes = torch.zeros_like(spikes) if grads[0] is None else grads[0].contiguous().clone()
        shape = (spikes.shape[0], 1, part.size)
        self.to_potential = np.zeros(shape, dtype) if grads[1] is None else grads[1].contiguous().numpy()
        self.carry, self.carry_current = (np.zeros(self.saved[1].shape[::2], dtype) for _ in range(2))
        self.grad = torch.empty_like(spikes)

    def go(self, first: int, last: int, surrogate: Surrogate) -> None:
        """Run a stretch backward, from its last step to its first."""
        potential, spikes, fate = self.saved
        grad, slope = self.grad.numpy(), self.c.dtype.type(surrogate.slope)
        kernels.through_spikes(surrogate.at)(first, last, self.c, potential, slope, self.to_spikes.numpy(), grad)
        arguments = (first, last, self.c, spikes, fate, self.to_potential, self.carry)
        if self.part.model == "iaf_psc_delta":
            kernels.delta_adjoint(*arguments, grad)
        else:
            kernels.exp_adjoint(*arguments, self.carry_current, grad)


class _Scan(torch.autograd.Function):
    """The populations of a component, scanned stretch by stretch."""

    @staticmethod
    def forward(ctx: Any, part: Component, task: ScanTask, learns: bool, *tensors: Tensor) -> tuple[Tensor, ...]:
        n = len(part.cells)
        ctx.set_materialize_grads(False)
        ctx.part, ctx.task = part, task
        # Synapses inside the component add to the input in place, so the input is copied first.
        drives = [drive.detach().clone() if part.inside else drive.detach().contiguous() for drive in tensors[:n]]
        populations = {
            k: _Population(cell, drive.numpy(), task, learns)
            for (k, cell), drive in zip(part.cells.items(), drives, strict=True)
        }
        weights = [rows_of(s, w) for s, w in zip(part.inside, tensors[n:], strict=True)]
        for first, last in stretches(part.stretch, task.steps):
            for population in populations.values():
                population.go(first, last)
            packed_by_source = {}
            for source in {synapses.source for synapses in part.inside}:
                spikes_of, width = populations[source].spikes.numpy(), last - first
                packed_by_source[source] = _pack(
                    spikes_of, first, width, spikes_of.shape[0] * width * spikes_of.shape[2]
                )
            for synapses, weight in zip(part.inside, weights, strict=True):
                target_drive = populations[synapses.target].drive
                _push(synapses, packed_by_source[synapses.source], first, last - first, weight, target_drive)
        spikes, potentials = [p.spikes for p in populations.values()], [p.potential for p in populations.values()]
        ctx.fates = [p.fate for p in populations.values()]
        ctx.save_for_backward(*spikes, *potentials, *tensors[n:])
        return (*spikes, *potentials)

    @staticmethod
    @once
    def backward(ctx: Any, *grads: Any) -> Any:
        part, task, n = ctx.part, ctx.task, len(ctx.part.cells)
        saved = ctx.saved_tensors
        spikes, potentials, weights = saved[:n], saved[n : 2 * n], saved[2 * n :]
        adjoints = {
            k: _Adjoint(cell, spikes[i], potentials[i], ctx.fates[i], (grads[i], grads[n + i]))
            for i, (k, cell) in enumerate(part.cells.items())
        }
        for first, last in reversed(list(stretches(part.stretch, task.steps))):
            for synapses, weight in zip(part.inside, weights, strict=True):
                spike_gradient = adjoints[synapses.source].to_spikes
                _pull(
                    synapses, first, last - first, weight, adjoints[synapses.target].grad, task.damping, spike_gradient
                )
            for adjoint in adjoints.values():
                adjoint.go(first, last, task.surrogate)
        places = {k: i for i, k in enumerate(part.cells)}
        weight_gradients = [
            weight_gradient_of(s, packed(spikes[places[s.source]]), w, adjoints[s.target].grad)
            if ctx.needs_input_grad[3 + n + i]
            else None
            for i, (s, w) in enumerate(zip(part.inside, weights, strict=True))
        ]
        return (None, None, None, *(adjoint.grad for adjoint in adjoints.values()), *weight_gradients)


def stretches(length: int, steps: int) -> list[tuple[int, int]]:
    """Divide the steps into stretches of `length` (0: one stretch). Return first step and last step + 1 of each."""
    length = length or steps
    return [(first, min(first + length, steps)) for first in range(0, steps, length)]
