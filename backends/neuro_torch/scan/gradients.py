"""Gradients for scans and steps: an error for second-order gradients, and gradients of 0 for silent networks.

`once` is for backward passes without a derivative of their own: asking for a second-order gradient raises an error,
where torch would return none. `joined` keeps tensors connected to the parameters where no spike has arrived, so that a
silent network has a gradient of 0.
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
    """Decorate a `backward` so that its gradients are constants; a gradient of a gradient is an error.

    torch's `once_differentiable` raises no error if the incoming gradient has no gradient, e.g. of a sum.
    """

    @wraps(backward)
    def numbers(ctx: Any, *grads: Any) -> Any:
        if not torch.is_grad_enabled():
            return backward(ctx, *grads)
        with torch.no_grad():
            gradients = backward(ctx, *grads)
        last: Any = _Last.apply
        as_tuple = gradients if isinstance(gradients, tuple) else (gradients,)
        return tuple(last(g.detach().requires_grad_()) if isinstance(g, Tensor) else g for g in as_tuple)

    return numbers


class _Last(torch.autograd.Function):
    """The identity; computing its gradient raises an error."""

    @staticmethod
    def forward(ctx: Any, gradient: Tensor) -> Tensor:
        return gradient.view_as(gradient)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        raise ModelError(
            "compiled kernels and steps have no second-order gradients",
            hint="use neuro_torch.Module(..., by='torch'), if scans support the network",
        )


def joined(tensor: Tensor, learns: Iterable[Tensor]) -> Tensor:
    """Return a tensor unchanged but connected in the graph to the parameters that learn."""
    apply: Any = _Joined.apply
    connected: Tensor = apply(tensor, *learns)
    return connected


class _Joined(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, tensor: Tensor, *learns: Tensor) -> Tensor:
        # Only shapes are saved, so an in-place change of the parameters is no error here.
        ctx.like = [(leaf.shape, leaf.dtype, leaf.device) for leaf in learns]
        return tensor.view_as(tensor)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        zeros = [
            torch.zeros(shape, dtype=kind, device=device) if is_needed else None
            for is_needed, (shape, kind, device) in zip(ctx.needs_input_grad[1:], ctx.like, strict=True)
        ]
        return (grads[0], *zeros)
