"""Dense tensors that a batch gives to inputs: checked, and of the shape, type and place that a pass has."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from neuro.core.errors import ModelError
from neuro.program.program import Population
from neuro_torch.scan.task import ScanTask


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
        ModelError: it holds what are no numbers.
    """
    tensor = torch.as_tensor(given)
    if tensor.layout is not torch.strided:
        tensor = tensor.to_dense()
    tensor = tensor.reshape(*tensor.shape[:2], part.size)
    if tensor.is_floating_point() and not tensor.is_meta:
        _check_finite(part, tensor.detach())
    return tensor.to(task.device, task.dtype)


def _check_finite(part: Population, tensor: Tensor) -> None:
    # A sum is one pass without a copy; it may overflow where no number is at fault.
    if tensor.sum().isfinite() or tensor.isfinite().all():
        return
    b, t, i = (~tensor.isfinite()).nonzero()[0].tolist()
    message = f"found {float(tensor[b, t, i])} of recording {b}, step {t}, neuron {i}"
    raise ModelError(f"batch: '{part.name}': {message}: expected numbers")
