"""Estimate of the peak memory of a batch, forward and backward, before it runs.

For scans the saved tensors are known. For steps the saved tensors depend on the model and are counted in a few steps of
one recording. The estimate sums the tensors that exist when most memory is used. The memory of a process lies within a
factor of 2.5 of the estimate: the spikes of neurons are unknown before the run and are not counted, and allocators do
not return all freed memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from neuro.core.errors import ModelError
from neuro.core.memory import free_memory
from neuro.program.program import Population, Program
from neuro_torch.events import Train
from neuro_torch.scan.layers import CELLS, Component, Plan, ScanTask, Synapses

__all__ = ["Need", "free", "need", "refuse_large", "saved_per_step"]

DOUBLE = 8
INDEX = 8


@dataclass(frozen=True, slots=True)
class Need:
    """Bytes of a pass.

    Attributes:
        batch: number of recordings.
        per_recording: bytes per recording, the mean of the batch.
        fixed: bytes that do not depend on the batch.
    """

    batch: int
    per_recording: float
    fixed: int = 0

    @property
    def total(self) -> float:
        """Bytes of the whole batch."""
        return self.batch * self.per_recording + self.fixed


def refuse_large(need: Need, task: ScanTask) -> None:
    """Refuse a batch that needs more memory than is free.

    Raises:
        ModelError: the batch needs more than is free on the parameters' device.
    """
    available = free(task.device)
    if available is None or need.total <= available:
        return
    location = "" if task.device.type == "cpu" else f" on '{task.device}'"
    fits = int((available - need.fixed) // need.per_recording)
    raise ModelError(
        f"a batch of {task.batch} recordings of {task.steps} steps needs about {need.total / 1e9:.3g} GB: expected at "
        f"most what is free{location}, {available / 1e9:.3g} GB",
        hint=f"use a batch of {max(1, fits // 2)}, which needs half of that"
        if fits >= 1
        else "a shorter duration or longer steps need less",
    )


def free(device: torch.device) -> int | None:
    """Return the free bytes of a device, on a GPU with torch's cache; None if unknown."""
    if device.type != "cuda":
        return free_memory()
    cached = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return int(torch.cuda.mem_get_info(device)[0] + cached)


def need(program: Program, plan: Plan, batch: Mapping[int, Any], task: ScanTask, tape: Callable[[], float]) -> Need:
    """Return the memory of a pass, with its backward pass where gradients are on.

    Args:
        program: the network.
        plan: the scans or steps that run it.
        batch: checked input of each generator, None where the batch does not name it.
        task: sizes, dtype and device of the pass.
        tape: returns the bytes that one recording saves per step for the backward pass, when the network is stepped.
    """
    inputs = {k: _Input.of(program.populations[k], value, task) for k, value in batch.items()}
    learns = torch.is_grad_enabled()
    if not plan.parts:
        return _need_of_steps(program, inputs.values(), task, tape() if learns else 0.0)
    return (_need_of_kernels if plan.by == "kernels" else _need_of_torch)(plan.parts, inputs, task, learns)


@dataclass(frozen=True, slots=True)
class _Input:
    """Spikes of a generator in a recording.

    Attributes:
        spikes: mean number of spikes of a recording; for a dense input the number of the first recording.
        numbers: number of elements of a dense tensor, steps x neurons.
        sparse: whether the spikes stay sparse.
        copied: whether the input is copied to a dense tensor.
        learns: whether the input has a gradient.
    """

    spikes: float
    numbers: int
    sparse: bool
    copied: bool
    learns: bool

    @classmethod
    def of(cls, part: Population, value: Any, task: ScanTask) -> _Input:
        has_own_spikes = part.kind != "listed" or bool(np.any(part.spike_steps <= task.steps))
        numbers = task.steps * part.size
        if value is None or isinstance(value, Train):
            spikes = 0 if value is None else len(value.step)
            return cls(spikes / task.batch, numbers, not has_own_spikes, has_own_spikes, False)
        is_unchanged = getattr(value, "dtype", None) == task.dtype and value.device == task.device
        learns = isinstance(value, torch.Tensor) and value.requires_grad
        return cls(_count_spikes(value), numbers, False, has_own_spikes or not is_unchanged, learns)


def _count_spikes(value: Any) -> int:
    """Return the number of nonzero elements in the first recording of a tensor or an array."""
    first = torch.as_tensor(value[0])
    if first.is_meta:
        return 0
    return int(torch.count_nonzero(first if first.layout is torch.strided else first.to_dense()))


Inputs = Mapping[int, _Input]


def _input_bytes(inputs: Iterable[_Input], task: ScanTask) -> float:
    """Return bytes of the inputs of scans: spike lists, or a copy and twice its gradient."""
    size: int = task.dtype.itemsize
    spike_lists = sum(item.spikes * (3 * INDEX + size) for item in inputs)
    return spike_lists + sum(size * item.numbers * (item.copied + 2 * item.learns) for item in inputs)


def _largest(parts: Iterable[Component], need_of: Callable[[Component], float]) -> float:
    """Return the largest memory of components that run one after the other."""
    return max(map(need_of, parts))


def _n_neurons(part: Component) -> int:
    return sum(cell.size for cell in part.cells.values())


def _graded_bytes(parts: Iterable[Component], learns: bool) -> int:
    """Return bytes per step that the arithmetic of graded neurons saves, about four doubles per neuron."""
    sizes = (cell.size for part in parts for cell in part.cells.values() if cell.model not in CELLS)
    return 4 * DOUBLE * sum(sizes) if learns else 0


def _need_of_kernels(parts: tuple[Component, ...], inputs: Inputs, task: ScanTask, learns: bool) -> Need:
    """Return the memory of compiled scans.

    Spikes, potentials and flags are saved; input and gradients exist for one component at a time.
    """
    size = task.dtype.itemsize
    saved = (2 * size + 1 if learns else size) * sum(map(_n_neurons, parts)) + _graded_bytes(parts, learns)
    passing = _largest(parts, lambda part: (4 + bool(part.inside)) * size * _n_neurons(part))
    return Need(task.batch, task.steps * (saved + passing) + _input_bytes(inputs.values(), task))


def _need_of_torch(parts: tuple[Component, ...], inputs: Inputs, task: ScanTask, learns: bool) -> Need:
    """Return the memory of scans by torch: the memory of compiled scans, saved products and rows of weights."""
    size, neurons = task.dtype.itemsize, sum(map(_n_neurons, parts))
    driven = [wires for part in parts for wires in part.outside]
    products = sum(size * wires.sizes[0] * len(_delays(wires)) for wires in driven if not _is_sparse(wires, inputs))
    saved = (2 * size + 3) * neurons + products if learns else 2 * size * neurons
    transient = _largest(parts, lambda part: 6 * size * _n_neurons(part) * task.steps + _delivered(part, inputs, task))
    sparse_synapses = [wires for part in parts for wires in (*part.outside, *part.inside) if not wires.dense]
    tables = sum(3 * size * wires.sizes[0] * wires.sizes[1] * len(_delays(wires)) for wires in sparse_synapses)
    saved += _graded_bytes(parts, learns)
    return Need(task.batch, task.steps * saved + transient + _input_bytes(inputs.values(), task), tables)


def _delivered(part: Component, inputs: Inputs, task: ScanTask) -> float:
    """Return the memory of the largest projection from outside while it delivers spikes."""
    size = task.dtype.itemsize
    return max((size * wires.sizes[1] * _tensors_at_once(wires, inputs, task) for wires in part.outside), default=0.0)


def _tensors_at_once(wires: Synapses, inputs: Inputs, task: ScanTask) -> float:
    """Return the number of tensors that a delivery of spikes needs at once, each of one step of the targets."""
    if _is_sparse(wires, inputs):
        return 2 * task.steps + 2 * inputs[wires.source].spikes
    return 3 * task.steps


def _is_sparse(wires: Synapses, inputs: Inputs) -> bool:
    return wires.source in inputs and inputs[wires.source].sparse


def _delays(wires: Synapses) -> Any:
    return np.unique(wires.delay)


def _need_of_steps(program: Program, inputs: Iterable[_Input], task: ScanTask, tape: float) -> Need:
    """Return the memory of stepping: spikes by step and in total, their gradients; inputs are dense doubles.

    The result is doubled: allocators hold about twice as much, because small tensors in use lie between freed
    tensors.
    """
    neurons = sum(part.size for part in program.populations if part.kind == "neuron")
    size = task.dtype.itemsize
    saved = 2 * (tape + neurons * (4 * DOUBLE + size))
    dense = sum(generator.numbers for generator in inputs) * (2 * DOUBLE + size)
    return Need(task.batch, task.steps * saved + dense + 3 * INDEX * sum(generator.spikes for generator in inputs))


def saved_per_step(run: Callable[[int], object], steps: int) -> float:
    """Return the bytes that a step saves for the backward pass, measured on a few steps.

    Args:
        run: runs a number of steps.
        steps: largest number of steps to run.
    """
    probe_steps = min(6, steps)
    fewer = probe_steps // 2
    return (_saved_bytes(run, probe_steps) - (_saved_bytes(run, fewer) if fewer else 0)) / (probe_steps - fewer)


def _saved_bytes(run: Callable[[int], object], steps: int) -> int:
    """Return the bytes of all tensors saved for the backward pass; each storage counts once."""
    storages: dict[int, torch.UntypedStorage] = {}

    def pack(tensor: torch.Tensor) -> torch.Tensor:
        storage = tensor.untyped_storage()
        storages[storage.data_ptr()] = storage
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        run(steps)
    return sum(storage.nbytes() for storage in storages.values())
