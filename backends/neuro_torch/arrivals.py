"""What arrives along a projection in a step, with its gradient.

A source that stayed silent has a gradient, too: its surrogate says how near it was to a spike. Gradients of weights are
events, as spikes are: they are added in one array for all steps, which is handed on when the first step is done.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from neuro_torch.scan.gradients import once
from neuro_torch.wires import Emitted, Sent, TorchProjection, added


class Learnt:
    """Weights with the array in which their gradients of all steps are gathered.

    Attributes:
        weights: as they are, without a gradient.
        token: stands for the weights in the graph: what depends on it is done before it is.
    """

    def __init__(self, weights: Tensor) -> None:
        self.weights, self.gathered = weights.detach(), None  # type: Tensor, Tensor | None
        of: Any = _Token.apply
        self.token: Tensor = of(weights, self) if weights.requires_grad else torch.zeros(())

    def gather(self) -> Tensor:
        """Where gradients are added."""
        if self.gathered is None:
            self.gathered = torch.zeros_like(self.weights)
        return self.gathered


class _Token(torch.autograd.Function):
    """A number whose gradient is what was gathered of the weights."""

    @staticmethod
    def forward(ctx, weights, learnt):
        ctx.learnt = learnt
        return torch.zeros((), dtype=weights.dtype, device=weights.device)

    @staticmethod
    @once
    def backward(ctx, g):
        found, ctx.learnt.gathered = ctx.learnt.gathered, None
        return found, None


class Arrivals(torch.autograd.Function):
    """What arrives in a step, shape (receptors, batch, neurons).

    It takes wires, their `Learnt` weights and its token, the number of recordings, what was emitted, and the spikes of
    that which have a gradient, None for others.
    """

    @staticmethod
    def forward(ctx, wires, learnt, token, batch, sent, *spikes):
        """The sum of what arrives."""
        x = torch.zeros(max(2, wires.receptors), batch, wires.n_target, dtype=torch.float64, device=wires.device)
        wires.add(x, None, learnt.weights, sent)
        ctx.wires, ctx.learnt, ctx.sent = wires, learnt, sent
        ctx.save_for_backward(learnt.weights)  # so that torch sees a change of them before the gradients are asked for
        return x

    @staticmethod
    @once
    def backward(ctx, g):
        """Gradient of a weight: the sum over the spikes it delivered. Of a spike: the sum over all its synapses."""
        (weights,) = ctx.saved_tensors
        wires, g = ctx.wires, g.contiguous()
        asked = zip(ctx.needs_input_grad[5:], ctx.sent, strict=True)
        of_spikes = [_of_spikes(wires, weights, g, d) if needed else None for needed, (d, _) in asked]
        if ctx.needs_input_grad[2] and not wires.relay:
            _gather(wires, weights, g, ctx.sent, ctx.learnt.gather())
        token = torch.zeros_like(g[0, 0, 0]) if ctx.needs_input_grad[2] else None
        return None, None, token, None, None, *of_spikes


def _gather(wires: TorchProjection, weights: Tensor, g: Tensor, sent: Sent, into: Tensor) -> None:
    """Add the gradients of the weights along which spikes arrived."""
    if wires.by_rows(weights):
        for _, each in sent:
            wires.rows(into).index_add_(0, each.neuron, _shares(wires, weights, g, each))
        return
    synapses, b, m = wires.followed(sent)
    receptor = wires.receptor(wires.each(weights, synapses) * m)
    shares = wires.arriving(g.view(-1)[receptor * g[0].numel() + b * wires.n_target + wires.target[synapses]] * m)
    if weights.numel() == 1:
        into += shares.sum()
    else:
        added(into.view(-1), wires.slot[synapses], shares)


def _shares(wires: TorchProjection, weights: Tensor, g: Tensor, emitted: Emitted) -> Tensor:
    b, m = emitted.recording, emitted.multiplicity[:, None]
    if wires.part.receptor is not None:
        return wires.arriving(g[wires.part.receptor.index][b] * m)
    if wires.receptors == 2:
        return torch.where(torch.signbit(wires.rows(weights, emitted.neuron)), g[1][b], g[0][b]) * m
    return g[0][b] * m


def _of_spikes(wires: TorchProjection, weights: Tensor, g: Tensor, d: int) -> Tensor:
    if wires.by_rows(weights):
        w = wires.arriving(wires.rows(weights)).T
        if wires.part.receptor is not None:
            return g[wires.part.receptor.index] @ w
        return g[0] @ w.clamp(min=0.0) + g[1] @ w.clamp(max=0.0) if wires.receptors == 2 else g[0] @ w
    of = slice(wires.bounds[d], wires.bounds[d + 1])
    target, source = wires.target[of], wires.source[of]
    if wires.relay:
        brought = g[0][:, target]
    else:
        amounts = wires.each(weights, of)
        receptor = wires.receptor(amounts)
        brought = (g[receptor, :, target].T if isinstance(receptor, Tensor) else g[receptor][:, target]) * amounts
    found = torch.zeros(g.shape[1], wires.n_source, dtype=torch.float64, device=g.device)
    rows = torch.arange(g.shape[1], device=g.device)[:, None] * wires.n_source + source
    added(found.view(-1), rows.reshape(-1), brought.reshape(-1))
    return found
