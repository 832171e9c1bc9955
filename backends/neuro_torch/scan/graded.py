"""Graded neurons in a scan: their model's own arithmetic, step by step, on input that is complete before."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from neuro.program.program import Population
from neuro_torch.cells import TensorCells
from neuro_torch.scan.layers import ScanTask
from neuro_torch.surrogates import Surrogate


def scan(part: Population, drive: Tensor, task: ScanTask, resolution: float) -> Tensor:
    """The payloads that a population sends, (batch, steps, neurons).

    Args:
        part: the population, whose neurons draw nothing.
        drive: its input, of the same shape.
        task: what the pass is about.
        resolution: length of a step in ms.
    """
    cells = TensorCells(part, task.batch, resolution, 0, task.device)
    none = torch.zeros_like(drive[:, 0], dtype=torch.float64)
    sent = [cells.step([x.double(), none], 0.0, t, task.surrogate) for t, x in enumerate(drive.unbind(1), 1)]
    return torch.stack(sent, 1).to(task.dtype)


def messages(part: Population, sent: Tensor, surrogate: Surrogate) -> Tensor:
    """1 where a payload is sent, else 0; the gradient lowers a payload towards the threshold of sending.

    Args:
        part: the population.
        sent: payloads, (batch, steps, neurons).
        surrogate: stands in for the derivative at the threshold.
    """
    p: Any = part.parameters
    least = p.get("vth", 0.0) * 2.0 ** p.get("spike_exp", 0.0)
    threshold = torch.as_tensor(least, dtype=sent.dtype, device=sent.device)
    counted: Tensor = _Messages.apply(sent, threshold, surrogate)  # type: ignore[no-untyped-call]
    return counted


class _Messages(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sent: Tensor, threshold: Tensor, surrogate: Surrogate) -> Tensor:
        ctx.save_for_backward(sent, threshold)
        ctx.surrogate = surrogate
        return (sent != 0).to(sent.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        sent, threshold = ctx.saved_tensors
        x = (sent.abs() - threshold) / threshold
        lowered = grads[0] * sent.sign() * ctx.surrogate.derivative(x) / threshold
        return torch.where((sent != 0) & (threshold > 0), lowered, 0.0), None, None
