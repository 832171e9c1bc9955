"""How much memory a batch takes at its peak, forward and backward, estimated before any is taken.

What scans keep is known from what they do; what steps keep depends on the model, so it is counted in some steps of one
recording. Sums are of what is held at once, where that is most. What a process takes lies within a factor of 2.5 of
that: spikes of neurons, unknown before, are left out, and allocators do not give back all that is freed.
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

__all__ = ["Need", "free", "kept_by_steps", "need", "refuse_large"]

DOUBLE = 8
INDEX = 8


@dataclass(frozen=True, slots=True)
class Need:
    """Bytes of a pass.

    Attributes:
        batch: recordings.
        each: of a recording, the mean of the batch.
        fixed: whatever the batch.
    """

    batch: int
    each: float
    fixed: int = 0

    @property
    def total(self) -> float:
        """Bytes of the batch."""
        return self.batch * self.each + self.fixed


def refuse_large(need: Need, task: ScanTask) -> None:
    """Refuse a batch for which memory does not suffice.

    Raises:
        ModelError: it needs more than is free where the parameters are.
    """
    left = free(task.device)
    if left is None or need.total <= left:
        return
    where = "" if task.device.type == "cpu" else f" on '{task.device}'"
    fits = int((left - need.fixed) // need.each)
    raise ModelError(
        f"a batch of {task.batch} recordings of {task.steps} steps needs about {need.total / 1e9:.3g} GB: expected at "
        f"most what is free{where}, {left / 1e9:.3g} GB",
        hint=f"a batch of {max(1, fits // 2)} takes half of that"
        if fits >= 1
        else "a shorter duration or longer steps need less",
    )


def free(device: torch.device) -> int | None:
    """Bytes that are free on a device: of a GPU with what torch has cached there; None if unknown."""
    if device.type != "cuda":
        return free_memory()
    cached = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return int(torch.cuda.mem_get_info(device)[0] + cached)


def need(program: Program, plan: Plan, asked: Mapping[int, Any], task: ScanTask, tape: Callable[[], float]) -> Need:
    """What a pass takes, with its way back where gradients are on.

    Args:
        program: the network.
        plan: what runs it.
        asked: what a batch gives to each generator, None where it does not name it.
        task: what the pass is about.
        tape: bytes that one recording keeps for the way back in a step, where it is stepped.
    """
    inputs = {k: _Input.of(program.populations[k], given, task) for k, given in asked.items()}
    learns = torch.is_grad_enabled()
    if not plan.parts:
        return _steps(program, inputs.values(), task, tape() if learns else 0.0)
    return (_kernels if plan.by == "kernels" else _torch)(plan.parts, inputs, task, learns)


@dataclass(frozen=True, slots=True)
class _Input:
    """What a generator emits in a recording.

    Attributes:
        spikes: that are given: the mean of all, or of a dense tensor those of the first recording.
        numbers: of a dense tensor of all steps and neurons.
        sparse: whether it stays sparse.
        copied: whether a dense tensor is made of what is given.
        learns: whether it has a gradient.
    """

    spikes: float
    numbers: int
    sparse: bool
    copied: bool
    learns: bool

    @classmethod
    def of(cls, part: Population, given: Any, task: ScanTask) -> _Input:
        own = part.kind != "listed" or bool(np.any(part.spike_steps <= task.steps))
        numbers = task.steps * part.size
        if given is None or isinstance(given, Train):
            spikes = 0 if given is None else len(given.step)
            return cls(spikes / task.batch, numbers, not own, own, False)
        same = getattr(given, "dtype", None) == task.dtype and given.device == task.device
        learns = isinstance(given, torch.Tensor) and given.requires_grad
        return cls(_spikes(given), numbers, False, own or not same, learns)


def _spikes(given: Any) -> int:
    """How many numbers of the first recording of a tensor or an array are not 0."""
    one = torch.as_tensor(given[0])
    if one.is_meta:
        return 0
    return int(torch.count_nonzero(one if one.layout is torch.strided else one.to_dense()))


Inputs = Mapping[int, _Input]


def _given(inputs: Iterable[_Input], task: ScanTask) -> float:
    """What inputs take that scans are given: lists of spikes with their places, or a copy, and its gradient twice."""
    size: int = task.dtype.itemsize
    listed = sum(each.spikes * (3 * INDEX + size) for each in inputs)
    return listed + sum(size * each.numbers * (each.copied + 2 * each.learns) for each in inputs)


def _largest(parts: Iterable[Component], of: Callable[[Component], float]) -> float:
    """Of parts that are done one after the other."""
    return max(map(of, parts))


def _neurons(part: Component) -> int:
    return sum(cell.size for cell in part.cells.values())


def _states(parts: Iterable[Component], learns: bool) -> int:
    """Bytes of a step that the arithmetic of graded neurons keeps for the way back: about four doubles of each."""
    sizes = (cell.size for part in parts for cell in part.cells.values() if cell.model not in CELLS)
    return 4 * DOUBLE * sum(sizes) if learns else 0


def _kernels(parts: tuple[Component, ...], inputs: Inputs, task: ScanTask, learns: bool) -> Need:
    """Spikes, potentials and what became of them stay; input and gradients come and go with a part."""
    size = task.dtype.itemsize
    kept = (2 * size + 1 if learns else size) * sum(map(_neurons, parts)) + _states(parts, learns)
    passing = _largest(parts, lambda part: (4 + bool(part.inside)) * size * _neurons(part))
    return Need(task.batch, task.steps * (kept + passing) + _given(inputs.values(), task))


def _torch(parts: tuple[Component, ...], inputs: Inputs, task: ScanTask, learns: bool) -> Need:
    """Besides, what products of tensors keep, and rows of weights of all given spikes at once."""
    size = task.dtype.itemsize
    driven = [each for part in parts for each in part.outside]
    products = sum(size * each.sizes[0] * len(_delays(each)) for each in driven if not _is_sparse(each, inputs))
    kept = (2 * size + 3) * sum(map(_neurons, parts)) + products if learns else 2 * size * sum(map(_neurons, parts))
    passing = _largest(parts, lambda part: 6 * size * _neurons(part) * task.steps + _drives(part, inputs, task))
    listed = [each for part in parts for each in (*part.outside, *part.inside) if not each.dense]
    tables = sum(3 * size * each.sizes[0] * each.sizes[1] * len(_delays(each)) for each in listed)
    kept += _states(parts, learns)
    return Need(task.batch, task.steps * kept + passing + _given(inputs.values(), task), tables)


def _drives(part: Component, inputs: Inputs, task: ScanTask) -> float:
    """What the largest of the projections from outside takes on its way."""
    size = task.dtype.itemsize
    return max((size * each.sizes[1] * _moved(each, inputs, task) for each in part.outside), default=0.0)


def _moved(each: Synapses, inputs: Inputs, task: ScanTask) -> float:
    """Tensors of one step of the targets that are held at once while spikes go along a projection."""
    if _is_sparse(each, inputs):
        return 2 * task.steps + 2 * inputs[each.source].spikes
    return 3 * task.steps


def _is_sparse(each: Synapses, inputs: Inputs) -> bool:
    return each.source in inputs and inputs[each.source].sparse


def _delays(each: Synapses) -> Any:
    return np.unique(each.delay)


def _steps(program: Program, inputs: Iterable[_Input], task: ScanTask, tape: float) -> Need:
    """Spikes of each step, then of all, and their gradients; inputs are dense, as doubles and stacked.

    Many small tensors that stay lie between many that go, so allocators hold about twice of what is left.
    """
    neurons = sum(part.size for part in program.populations if part.kind == "neuron")
    size = task.dtype.itemsize
    kept = 2 * (tape + neurons * (4 * DOUBLE + size))
    dense = sum(each.numbers for each in inputs) * (2 * DOUBLE + size)
    return Need(task.batch, task.steps * kept + dense + 3 * INDEX * sum(each.spikes for each in inputs))


def kept_by_steps(run: Callable[[int], object], steps: int) -> float:
    """Bytes that are kept in a step for the way back, counted.

    Args:
        run: runs so many steps.
        steps: as many as there are.
    """
    more = min(6, steps)
    less = more // 2
    return (_saved(run, more) - (_saved(run, less) if less else 0)) / (more - less)


def _saved(run: Callable[[int], object], steps: int) -> int:
    """Bytes of all tensors that are saved for the way back, each storage once."""
    held: dict[int, torch.UntypedStorage] = {}

    def pack(tensor: torch.Tensor) -> torch.Tensor:
        storage = tensor.untyped_storage()
        held[storage.data_ptr()] = storage
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        run(steps)
    return sum(storage.nbytes() for storage in held.values())
