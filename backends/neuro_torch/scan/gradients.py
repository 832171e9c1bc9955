"""Gradients as scans and steps need them: of what has none itself, and of silence.

`once` is for gradients that have none themselves: asked for one, they say so, where torch would be silent. `joined`
keeps tensors in the graph of what learns, also where nothing has arrived: silence has a gradient, 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

import torch
from torch import Tensor

from neuro.core.errors import ModelError

Backward = Callable[..., Any]


def once(backward: Backward) -> Backward:
    """A `backward` whose gradients are numbers; asking for a gradient of them is an error.

    torch's `once_differentiable` is silent where what comes in has no gradient, as that of a sum.
    """

    @wraps(backward)
    def numbers(ctx: Any, *grads: Any) -> Any:
        if not torch.is_grad_enabled():
            return backward(ctx, *grads)
        with torch.no_grad():
            found = backward(ctx, *grads)
        of: Any = _Last.apply
        each = found if isinstance(found, tuple) else (found,)
        return tuple(of(g.detach().requires_grad_()) if isinstance(g, Tensor) else g for g in each)

    return numbers


class _Last(torch.autograd.Function):
    """A gradient as it is, without one."""

    @staticmethod
    def forward(ctx: Any, gradient: Tensor) -> Tensor:
        return gradient.view_as(gradient)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        raise ModelError(
            "a gradient of a gradient: compiled kernels and steps have none",
            hint="neuro_torch.Module(..., by='torch') has, where the network is scanned",
        )


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
