"""What a batch gives to the inputs of a network: checked, and as scans take it."""

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
    """Refuse spikes before the first neuron and outside of the steps: `Events.of_trains` takes any."""
    for name, train in batch.trains.items():
        least, first, last = train.neuron.min(initial=0), train.step.min(initial=0), train.step.max(initial=0)
        if least < 0:
            raise ModelError(f"batch: '{name}': found neuron {least}: expected at least 0")
        if first < 0 or last >= batch.steps:
            found = first if first < 0 else last
            raise ModelError(f"batch: '{name}': found step {found}: expected 0 to {batch.steps - 1}")


def sizes(program: Program, batch: Any, steps: int | None) -> tuple[int, int]:
    """Recordings and steps of a batch.

    Args:
        program: the network.
        batch: as given to `neuro_torch.Module`.
        steps: those that it has to have, None for any.

    Raises:
        ModelError: it names no inputs, or its parts or steps do not agree.
    """
    known = [part.name for part in program.populations if part.kind == "listed"]
    if not isinstance(batch, (Events, Mapping)):
        message = f"batch: found {type(batch).__name__}: expected neuro_torch.Events, or tensors by population"
        raise ModelError(message, hint=f"{{'{known[0]}': tensor}}" if known else "")
    named = batch.trains if isinstance(batch, Events) else batch
    for name in named:
        if name not in known:
            raise unknown("population of inputs", name, known)
    if isinstance(batch, Events):
        found = {(batch.batch, batch.steps)}
        _check_trains(batch)
    else:
        for name, each in batch.items():
            if not isinstance(each, (torch.Tensor, np.ndarray)):
                raise ModelError(f"batch: '{name}': found {type(each).__name__}: expected a tensor")
            if each.ndim < 3:
                message = f"batch: '{name}': found the shape {tuple(each.shape)}"
                raise ModelError(f"{message}: expected (batch, steps, neurons)")
        found = {tuple(each.shape[:2]) for each in batch.values()}
    if len(found) != 1:
        raise ModelError(f"batch: found (batch, steps) of {sorted(found)}: expected one of all inputs")
    size, given = found.pop()
    if size < 1 or given < 1:
        raise ModelError(f"batch: found {size} recordings of {given} steps: expected at least one of each")
    if steps is not None and given != steps:
        raise ModelError(f"batch: found {given} steps: expected {steps}, the module's duration")
    return size, given


def checked(part: Population, given: Any) -> Any:
    """What a batch gives to a generator: sparse spikes, a dense tensor or array, None where it does not name it.

    Raises:
        ModelError: a shape or a neuron is wrong, or what has no spikes of its own is not named.
    """
    if given is None:
        if part.stream is not None:
            hint = "neuro_torch.Events.of_recordings makes spikes of recordings"
            raise ModelError(
                f"batch: '{part.name}' is not named: expected the spikes of this {part.model_name}", hint=hint
            )
        return None
    if isinstance(given, Train):
        if given.neuron.size and int(given.neuron.max()) >= part.size:
            message = f"batch: '{part.name}': found neuron {given.neuron.max()}"
            raise ModelError(f"{message}: expected 0 to {part.size - 1}")
        return given
    check(part, given)
    return given


def given_to(part: Population, given: Any, task: ScanTask) -> Train | torch.Tensor | None:
    """What was checked, as a pass has it.

    Raises:
        ModelError: something is NaN.
    """
    return given if given is None or isinstance(given, Train) else fitted(part, given, task)


def emitted(program: Program, part: Population, given: Train | torch.Tensor | None, task: ScanTask, scans: Any) -> Any:
    """All that a generator emits: a dense tensor, or listed as the scans take it.

    Args:
        program: the network.
        part: the generator.
        given: what `given_to` has found.
        task: what the pass is about.
        scans: `neuro_torch.scan.compiled` or `neuro_torch.scan.operations`.
    """
    silent = part.kind == "listed" and not np.any(part.spike_steps <= task.steps)
    if isinstance(given, Train) and silent:
        return scans.listed(given, task)
    if silent and given is not None:
        return given
    source = TensorSource(part, program.resolution, program.seed)
    own = np.array([source.emit(step) for step in range(1, task.steps + 1)])
    every = torch.as_tensor(own).to(task.device, task.dtype).expand(task.batch, -1, -1)
    return every if given is None else every + dense(given, part, task)


def dense(given: Train | torch.Tensor, part: Population, task: ScanTask) -> torch.Tensor:
    """Spikes that are given, (batch, steps, neurons)."""
    if isinstance(given, Train):
        events = Events.of_trains(task.steps, {part.name: given})
        return torch.from_numpy(events.dense(part.name, part.size)).to(task.device, task.dtype)
    return given


def beginning(given: Any, steps: int) -> Any:
    """The first steps of the first recording of what was checked."""
    if isinstance(given, Train):
        one = given.of([0])
        some = one.step < steps
        return Train(np.array([0, some.sum()]), one.step[some], one.neuron[some])
    if isinstance(given, torch.Tensor) and given.layout is not torch.strided:
        return given[0].to_dense()[None, :steps]
    return None if given is None else given[:1, :steps]


def check(part: Population, given: Any) -> None:
    """Refuse a tensor or an array that does not fit a population, whatever its numbers are.

    Args:
        part: the population.
        given: a tensor or an array, (batch, steps, neurons) or (batch, steps, *shape of the population); it may be
            sparse.

    Raises:
        ModelError: it has another shape, or another kind of numbers.
    """
    try:
        tensor = torch.as_tensor(given)
    except TypeError:
        raise ModelError(f"batch: '{part.name}': found an array of {given.dtype}: expected numbers") from None
    shape = tuple(tensor.shape)
    if shape[2:] not in ((part.size,), part.shape):
        known = dict.fromkeys([(part.size,), part.shape])
        expected = " or ".join(f"(batch, steps, {', '.join(map(str, each))})" for each in known)
        raise ModelError(f"batch: '{part.name}': found the shape {shape}: expected {expected}")
    if tensor.is_complex():
        raise ModelError(f"batch: '{part.name}': found {tensor.dtype}: expected real numbers")


def fitted(part: Population, given: Any, task: ScanTask) -> Tensor:
    """What fits a population, (batch, steps, neurons).

    Args:
        part: the population.
        given: what `check` lets pass.
        task: what the pass is about.

    Raises:
        ModelError: it holds NaN.
    """
    tensor = torch.as_tensor(given)
    if tensor.layout is not torch.strided:
        tensor = tensor.to_dense()
    tensor = tensor.reshape(*tensor.shape[:2], part.size)
    if tensor.is_floating_point() and not tensor.is_meta:
        _check_finite(part, tensor.detach())
    return tensor.to(task.device, task.dtype)


def _check_finite(part: Population, tensor: Tensor) -> None:
    # A sum is one pass without a copy; it may overflow where every number is finite.
    if tensor.sum().isfinite() or tensor.isfinite().all():
        return
    b, t, i = (~tensor.isfinite()).nonzero()[0].tolist()
    message = f"found {float(tensor[b, t, i])} of recording {b}, step {t}, neuron {i}"
    raise ModelError(f"batch: '{part.name}': {message}: expected numbers")
