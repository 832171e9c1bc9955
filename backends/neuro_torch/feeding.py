"""Inputs of a batch: checks, and conversion to the form that scans and steps read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neuro.core.errors import ModelError, unknown
from neuro.program.program import Population, Program
from neuro_torch.events import Events, Train
from neuro_torch.scan.layers import ScanTask
from neuro_torch.sources import TensorSource


def _check_trains(batch: Events) -> None:
    """Refuse negative neurons and steps outside the recording, which `Events.of_trains` does not check."""
    for name, train in batch.trains.items():
        lowest, first, last = train.neuron.min(initial=0), train.step.min(initial=0), train.step.max(initial=0)
        if lowest < 0:
            raise ModelError(f"batch: '{name}': found neuron {lowest}: expected at least 0")
        if first < 0 or last >= batch.steps:
            step = first if first < 0 else last
            raise ModelError(f"batch: '{name}': found step {step}: expected 0 to {batch.steps - 1}")


def sizes(program: Program, batch: Any, steps: int | None) -> tuple[int, int]:
    """Return the number of recordings and of steps of a batch.

    Args:
        program: the network.
        batch: the argument of `neuro_torch.Module`.
        steps: the required number of steps, None for any.

    Raises:
        ModelError: the batch names no inputs, or its parts or steps do not agree.
    """
    input_names = [part.name for part in program.populations if part.kind == "listed"]
    if not isinstance(batch, (Events, Mapping)):
        message = f"batch: found {type(batch).__name__}: expected neuro_torch.Events, or tensors by population"
        raise ModelError(message, hint=f"{{'{input_names[0]}': tensor}}" if input_names else "")
    inputs = batch.trains if isinstance(batch, Events) else batch
    for name in inputs:
        if name not in input_names:
            raise unknown("population of inputs", name, input_names)
    if isinstance(batch, Events):
        distinct_sizes = {(batch.batch, batch.steps)}
        _check_trains(batch)
    else:
        for name, tensor in batch.items():
            if not isinstance(tensor, (torch.Tensor, np.ndarray)):
                raise ModelError(f"batch: '{name}': found {type(tensor).__name__}: expected a tensor")
            if tensor.ndim < 3:
                message = f"batch: '{name}': found the shape {tuple(tensor.shape)}"
                raise ModelError(f"{message}: expected (batch, steps, neurons)")
        distinct_sizes = {tuple(tensor.shape[:2]) for tensor in batch.values()}
    if len(distinct_sizes) != 1:
        raise ModelError(f"batch: found (batch, steps) of {sorted(distinct_sizes)}: expected the same of all inputs")
    size, n_steps = distinct_sizes.pop()
    if size < 1 or n_steps < 1:
        raise ModelError(f"batch: found {size} recordings of {n_steps} steps: expected at least one of each")
    if steps is not None and n_steps != steps:
        raise ModelError(f"batch: found {n_steps} steps: expected {steps}, the module's duration")
    return size, n_steps


def checked(part: Population, value: Any) -> Any:
    """Check the input of a generator and return it: sparse spikes, a dense tensor or array, or None.

    Raises:
        ModelError: a shape or a neuron is wrong, or the batch names no input for a generator without spikes of its own.
    """
    if value is None:
        if part.stream is not None:
            hint = "neuro_torch.Events.of_recordings makes spikes of recordings"
            raise ModelError(
                f"batch: '{part.name}' is not named: expected the spikes of this {part.model_name}", hint=hint
            )
        return None
    if isinstance(value, Train):
        if value.neuron.size and int(value.neuron.max()) >= part.size:
            message = f"batch: '{part.name}': found neuron {value.neuron.max()}"
            raise ModelError(f"{message}: expected 0 to {part.size - 1}")
        return value
    check(part, value)
    return value


def convert(part: Population, value: Any, task: ScanTask) -> Train | torch.Tensor | None:
    """Convert a checked input to a tensor of the pass; return sparse spikes and None unchanged.

    Raises:
        ModelError: the input holds NaN.
    """
    return value if value is None or isinstance(value, Train) else to_dense(part, value, task)


def emitted(program: Program, part: Population, value: Train | torch.Tensor | None, task: ScanTask, scans: Any) -> Any:
    """Return everything that a generator emits, as a dense tensor or as the spike lists of the scans.

    Args:
        program: the network.
        part: the generator.
        value: the result of `convert`.
        task: sizes, dtype and device of the pass.
        scans: `neuro_torch.scan.compiled` or `neuro_torch.scan.operations`.
    """
    silent = part.kind == "listed" and not np.any(part.spike_steps <= task.steps)
    if isinstance(value, Train) and silent:
        return scans.pack_train(value, task)
    if silent and value is not None:
        return value
    source = TensorSource(part, program.resolution, program.seed)
    numbers = np.array([source.emit(step) for step in range(1, task.steps + 1)])
    all_spikes = torch.as_tensor(numbers).to(task.device, task.dtype).expand(task.batch, -1, -1)
    return all_spikes if value is None else all_spikes + dense(value, part, task)


def dense(value: Train | torch.Tensor, part: Population, task: ScanTask) -> torch.Tensor:
    """Return an input as a dense tensor, (batch, steps, neurons)."""
    if isinstance(value, Train):
        events = Events.of_trains(task.steps, {part.name: value})
        return torch.from_numpy(events.dense(part.name, part.size)).to(task.device, task.dtype)
    return value


def beginning(value: Any, steps: int) -> Any:
    """Return the first steps of the first recording of a checked input."""
    if isinstance(value, Train):
        first = value.of([0])
        is_early = first.step < steps
        return Train(np.array([0, is_early.sum()]), first.step[is_early], first.neuron[is_early])
    if isinstance(value, torch.Tensor) and value.layout is not torch.strided:
        return value[0].to_dense()[None, :steps]
    return None if value is None else value[:1, :steps]


def check(part: Population, value: Any) -> None:
    """Refuse a tensor or an array whose shape or dtype does not fit a population.

    Args:
        part: the population.
        value: a tensor or an array, dense or sparse, (batch, steps, neurons) or (batch, steps, *shape of the
            population).

    Raises:
        ModelError: the shape or the dtype is wrong.
    """
    try:
        tensor = torch.as_tensor(value)
    except TypeError:
        raise ModelError(f"batch: '{part.name}': found an array of {value.dtype}: expected numbers") from None
    shape = tuple(tensor.shape)
    if shape[2:] not in ((part.size,), part.shape):
        shapes = dict.fromkeys([(part.size,), part.shape])
        expected = " or ".join(f"(batch, steps, {', '.join(map(str, axes))})" for axes in shapes)
        raise ModelError(f"batch: '{part.name}': found the shape {shape}: expected {expected}")
    if tensor.is_complex():
        raise ModelError(f"batch: '{part.name}': found {tensor.dtype}: expected real numbers")


def to_dense(part: Population, value: Any, task: ScanTask) -> Tensor:
    """Return an input as a dense tensor of the pass, (batch, steps, neurons).

    Args:
        part: the population.
        value: a tensor or an array that `check` accepts.
        task: sizes, dtype and device of the pass.

    Raises:
        ModelError: the input holds NaN or infinity.
    """
    tensor = torch.as_tensor(value)
    if tensor.layout is not torch.strided:
        tensor = tensor.to_dense()
    tensor = tensor.reshape(*tensor.shape[:2], part.size)
    if tensor.is_floating_point() and not tensor.is_meta:
        _check_finite(part, tensor.detach())
    return tensor.to(task.device, task.dtype)


def _check_finite(part: Population, tensor: Tensor) -> None:
    # A sum needs one pass and no copy. If the sum is not finite, each number is checked: finite numbers can overflow.
    if tensor.sum().isfinite() or tensor.isfinite().all():
        return
    b, t, i = (~tensor.isfinite()).nonzero()[0].tolist()
    message = f"found {float(tensor[b, t, i])} of recording {b}, step {t}, neuron {i}"
    raise ModelError(f"batch: '{part.name}': {message}: expected numbers")
