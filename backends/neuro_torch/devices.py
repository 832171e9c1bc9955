"""Where tensors are: torch itself, and its devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from neuro.core.errors import ModelError
from neuro.core.extras import needed

if TYPE_CHECKING:
    import torch


def torch_module(told: str = "backend 'torch'") -> Any:
    """torch, or the one error that says how to get it."""
    return needed("torch", "torch", f"{told}: torch is not installed")


def device_of(told: str | torch.device) -> torch.device:
    """A device that is there and has doubles.

    Args:
        told: "cpu", "cuda" (the first GPU), "cuda:1", or a `torch.device`.

    Raises:
        ModelError: torch is not installed, or there is no such device.
    """
    own = torch_module()
    there = ["cpu", *(f"cuda:{number}" for number in range(own.cuda.device_count()))]
    try:
        device: torch.device | None = own.device(told)
    except (RuntimeError, TypeError):
        device = None
    if device is None or device.type not in ("cpu", "cuda"):
        raise ModelError(f"device = {told!r}: expected 'cpu' or 'cuda'", hint=f"here: {', '.join(there)}")
    if device.type == "cuda" and f"cuda:{device.index or 0}" not in there:
        raise ModelError(f"device = '{device}': torch sees no such GPU", hint=f"here: {', '.join(there)}")
    return device
