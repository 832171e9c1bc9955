"""Tensors in the graph of what learns, also where nothing has arrived: silence has a gradient, 0."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor


def joined(tensor: Tensor, learns: Iterable[Tensor]) -> Tensor:
    """A tensor as it is, that depends on what learns."""
    apply: Any = _Joined.apply
    found: Tensor = apply(tensor, *learns)
    return found


class _Joined(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, tensor: Tensor, *learns: Tensor) -> Tensor:
        # Not their values are needed, so a change of them is no mistake here.
        ctx.like = [(each.shape, each.dtype, each.device) for each in learns]
        return tensor.view_as(tensor)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        zeros = [
            torch.zeros(shape, dtype=kind, device=device) if needed else None
            for needed, (shape, kind, device) in zip(ctx.needs_input_grad[1:], ctx.like, strict=True)
        ]
        return (grads[0], *zeros)
