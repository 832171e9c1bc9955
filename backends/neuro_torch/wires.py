"""Synapses of one projection, and delivery of their input in a step.

Spikes select rows of synapses. Amounts are added event by event: the oldest spikes first, then by source. The
reference backend adds in the same order, so sums are bit-identical, for one recording and for a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neuro.model.neurons import Neuron
from neuro.program.program import Ints, Program
from neuro_torch.scan.gradients import once


class Emitted:
    """Spikes of a population in one step, as events.

    Attributes:
        recording, neuron, multiplicity: data of each event, sorted by recording and neuron. Multiplicities are doubles.
        spikes: the dense spikes, shape (batch, neurons), if they have a gradient, else None.

    Args:
        spikes: number of spikes of each neuron as doubles, shape (batch, neurons).
    """

    __slots__ = ("multiplicity", "neuron", "recording", "spikes")

    def __init__(self, spikes: Tensor) -> None:
        values = spikes.detach()
        self.recording, self.neuron = values.nonzero(as_tuple=True)
        self.multiplicity = values[self.recording, self.neuron]
        self.spikes = spikes if spikes.requires_grad else None


Sent = Sequence[tuple[int, Emitted]]
"""Pairs of an index of a delay in `TorchProjection.delays` and the spikes emitted this long ago, the oldest first."""


class TorchProjection:
    """A projection that carries spikes, with its synapses sorted by delay (the longest first), then source.

    Attributes:
        delays: the distinct delays in steps, descending.
        receptors: number of receptors of the target.
        target, slot: target neuron of every synapse, and the index of its weight.
        first, count: index of the first synapse and number of synapses of each delay and source.

    Args:
        program: the network.
        index: index of the projection.
        device: device of the arrays.
        delay: delay of every synapse in steps, in place of the program's.
    """

    def __init__(self, program: Program, index: int, device: torch.device, delay: Ints | None = None) -> None:
        self.part, self.device = program.projections[index], device
        self.n_source = program.populations[self.part.source].size
        self.n_target = program.populations[self.part.target].size
        model = program.populations[self.part.target].model
        assert isinstance(model, Neuron)
        self.receptors, self.relay = model.receptors, model.relay
        self.negated = self.part.receptor is not None and self.part.receptor.negated
        source, target, slot = program.synapses(index)
        delay = np.broadcast_to(self.part.delay if delay is None else delay, len(source)).astype(np.int64)
        order = np.lexsort((np.arange(len(source)), source, -delay))
        self.delays: list[int] = np.unique(delay)[::-1].tolist()
        delay_and_source = np.searchsorted(-np.array(self.delays), -delay[order]) * self.n_source + source[order]
        count = np.bincount(delay_and_source, minlength=len(self.delays) * self.n_source)
        self.bounds = [0, *np.cumsum(count)[self.n_source - 1 :: self.n_source].tolist()]
        self.source, self.target, self.slot = (self._tensor(values[order]) for values in (source, target, slot))
        self.count, self.first = self._tensor(count), self._tensor(np.cumsum(count) - count)
        self.is_single_block = self.part.layout == "dense" and len(self.delays) == 1

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays, without the weights."""
        size: int = 8 * (3 * self.target.numel() + 2 * self.count.numel())
        return size

    def _tensor(self, values: Ints) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.int64)).to(self.device)

    def amounts(self, weights: Tensor, synapses: Tensor | slice) -> Tensor:
        """Return the amounts that some synapses deliver; `weights` has one entry for all or one per synapse."""
        slots = self.slot[synapses]
        return self.arriving(weights.expand(len(slots)) if weights.numel() == 1 else weights[slots])

    def arriving(self, weights: Tensor) -> Tensor:
        """Return weights as delivered to the receptor, negated for a receptor that negates them."""
        return 0.0 - weights if self.negated else weights

    def receptor(self, amounts: Tensor) -> Tensor | int:
        """Return the receptor of each amount; -0.0, the amount of a negative weight, counts as negative."""
        if self.part.receptor is not None:
            return self.part.receptor.index
        return torch.signbit(amounts).to(torch.int64) if self.receptors == 2 else 0

    def reached_synapses(self, arriving: Sent) -> tuple[Tensor, Tensor, Tensor]:
        """Return the synapses that some spikes reach, in order, with their recordings and multiplicities."""
        events = [(d * self.n_source + e.neuron, e.recording, e.multiplicity) for d, e in arriving if len(e.neuron)]
        if not events:
            empty = torch.zeros(0, dtype=torch.int64, device=self.device)
            return empty, empty, empty.to(torch.float64)
        rows, b, m = (torch.cat(column) if len(events) > 1 else column[0] for column in zip(*events, strict=True))
        count = self.count[rows]
        end = torch.cumsum(count, 0)
        event_of_synapse = torch.repeat_interleave(count)
        shift = (self.first[rows] - end + count)[event_of_synapse]
        synapses = torch.arange(len(event_of_synapse), device=self.device) + shift
        return synapses, b[event_of_synapse], m[event_of_synapse]

    def by_rows(self, weights: Tensor) -> bool:
        """Return whether each source has one weight per target, so that whole rows of weights can be added."""
        return self.is_single_block and not self.relay and weights.numel() > 1 and weights.device.type == "cpu"

    def rows(self, values: Tensor, neurons: Tensor | slice = slice(None)) -> Tensor:
        """Return the rows of some sources from values in the order of the weights."""
        return values.reshape(self.n_source, self.n_target)[neurons]

    def add(self, x: Tensor, receives: Tensor | None, weights: Tensor, arriving: Sent) -> None:
        """Add the delivered amounts to `x` (receptors, batch, neurons); set a mask (batch, neurons) at arrivals."""
        if self.by_rows(weights):
            for _, emitted in arriving:
                self._add_rows(x, weights, emitted)
                if receives is not None:
                    receives[emitted.recording] = True
            return
        synapses, b, m = self.reached_synapses(arriving)
        if len(synapses):
            amounts = m if self.relay else self.amounts(weights, synapses) * m
            place = b * self.n_target + self.target[synapses]
            add_at(x.view(-1), self.receptor(amounts) * x[0].numel() + place, amounts)
            if receives is not None:
                receives.view(-1)[place] = True

    def _add_rows(self, x: Tensor, weights: Tensor, emitted: Emitted) -> None:
        amounts = self.arriving(self.rows(weights, emitted.neuron)) * emitted.multiplicity[:, None]
        if self.part.receptor is not None:
            x[self.part.receptor.index].index_add_(0, emitted.recording, amounts)
        elif self.receptors == 2:
            x[0].index_add_(0, emitted.recording, amounts.clamp(min=0.0))
            x[1].index_add_(0, emitted.recording, amounts.clamp(max=0.0))
        else:
            x[0].index_add_(0, emitted.recording, amounts)

    def mark_arrivals(self, receives: Tensor, arriving: Sent) -> None:
        """Set a mask (batch, neurons) where a spike arrives."""
        synapses, b, _ = self.reached_synapses(arriving)
        receives.view(-1)[b * self.n_target + self.target[synapses]] = True


def add_at(sums: Tensor, places: Tensor, amounts: Tensor) -> None:
    """Add amounts at indices, in their order."""
    if sums.is_cuda:
        # index_put_ sorts the indices, so the order does not depend on threads.
        sums.index_put_((places,), amounts, accumulate=True)
    else:
        sums.index_add_(0, places, amounts)


# mypy: disable-error-code="no-untyped-def,no-untyped-call"


class WeightAccumulator:
    """Weights with an array that accumulates their gradients over all steps.

    Attributes:
        weights: the weights, detached.
        token: a scalar that replaces the weights in the graph, so that the gradient of the weights is passed on once,
            after all steps have added to it.
    """

    def __init__(self, weights: Tensor) -> None:
        self.weights, self.gathered = weights.detach(), None  # type: Tensor, Tensor | None
        token_of: Any = _Token.apply
        self.token: Tensor = token_of(weights, self) if weights.requires_grad else torch.zeros(())

    def gather(self) -> Tensor:
        """Return the array to which gradients are added."""
        if self.gathered is None:
            self.gathered = torch.zeros_like(self.weights)
        return self.gathered


class _Token(torch.autograd.Function):
    """A scalar whose gradient is the accumulated gradient of the weights."""

    @staticmethod
    def forward(ctx, weights, accumulator):
        ctx.accumulator = accumulator
        return torch.zeros((), dtype=weights.dtype, device=weights.device)

    @staticmethod
    @once
    def backward(ctx, g):
        gradient, ctx.accumulator.gathered = ctx.accumulator.gathered, None
        return gradient, None


class Arrivals(torch.autograd.Function):
    """The input of a step, shape (receptors, batch, neurons).

    Arguments are the wires, the accumulator of their weights and its token, the number of recordings, the arriving
    spikes as events, and the dense tensor of each of these spikes that has a gradient, else None.
    """

    @staticmethod
    def forward(ctx, wires, accumulator, token, batch, arriving, *spikes):
        """Return the sum of the delivered amounts."""
        x = torch.zeros(max(2, wires.receptors), batch, wires.n_target, dtype=torch.float64, device=wires.device)
        wires.add(x, None, accumulator.weights, arriving)
        ctx.wires, ctx.accumulator, ctx.sent = wires, accumulator, arriving
        ctx.save_for_backward(accumulator.weights)  # torch then detects a change before the backward pass
        return x

    @staticmethod
    @once
    def backward(ctx, g):
        """Return the gradients: for a weight summed over its spikes, for a spike summed over its synapses."""
        (weights,) = ctx.saved_tensors
        wires, g = ctx.wires, g.contiguous()
        needs_gradient = zip(ctx.needs_input_grad[5:], ctx.sent, strict=True)
        spike_gradients = [_spike_gradient(wires, weights, g, d) if need else None for need, (d, _) in needs_gradient]
        if ctx.needs_input_grad[2] and not wires.relay:
            _add_weight_gradients(wires, weights, g, ctx.sent, ctx.accumulator.gather())
        token = torch.zeros_like(g[0, 0, 0]) if ctx.needs_input_grad[2] else None
        return None, None, token, None, None, *spike_gradients


def _add_weight_gradients(wires: TorchProjection, weights: Tensor, g: Tensor, arriving: Sent, out: Tensor) -> None:
    """Add the gradients of the weights along which spikes arrived."""
    if wires.by_rows(weights):
        for _, emitted in arriving:
            wires.rows(out).index_add_(0, emitted.neuron, _weight_gradient_rows(wires, weights, g, emitted))
        return
    synapses, b, m = wires.reached_synapses(arriving)
    receptor = wires.receptor(wires.amounts(weights, synapses) * m)
    shares = wires.arriving(g.view(-1)[receptor * g[0].numel() + b * wires.n_target + wires.target[synapses]] * m)
    if weights.numel() == 1:
        out += shares.sum()
    else:
        add_at(out.view(-1), wires.slot[synapses], shares)


def _weight_gradient_rows(wires: TorchProjection, weights: Tensor, g: Tensor, emitted: Emitted) -> Tensor:
    b, m = emitted.recording, emitted.multiplicity[:, None]
    if wires.part.receptor is not None:
        return wires.arriving(g[wires.part.receptor.index][b] * m)
    if wires.receptors == 2:
        return torch.where(torch.signbit(wires.rows(weights, emitted.neuron)), g[1][b], g[0][b]) * m
    return g[0][b] * m


def _spike_gradient(wires: TorchProjection, weights: Tensor, g: Tensor, d: int) -> Tensor:
    if wires.by_rows(weights):
        w = wires.arriving(wires.rows(weights)).T
        if wires.part.receptor is not None:
            return g[wires.part.receptor.index] @ w
        return g[0] @ w.clamp(min=0.0) + g[1] @ w.clamp(max=0.0) if wires.receptors == 2 else g[0] @ w
    synapses = slice(wires.bounds[d], wires.bounds[d + 1])
    target, source = wires.target[synapses], wires.source[synapses]
    if wires.relay:
        amounts_by_synapse = g[0][:, target]
    else:
        amounts = wires.amounts(weights, synapses)
        receptor = wires.receptor(amounts)
        received = g[receptor, :, target].T if isinstance(receptor, Tensor) else g[receptor][:, target]
        amounts_by_synapse = received * amounts
    gradient = torch.zeros(g.shape[1], wires.n_source, dtype=torch.float64, device=g.device)
    rows = torch.arange(g.shape[1], device=g.device)[:, None] * wires.n_source + source
    add_at(gradient.view(-1), rows.reshape(-1), amounts_by_synapse.reshape(-1))
    return gradient
