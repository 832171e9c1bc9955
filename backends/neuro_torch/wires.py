"""The synapses of one projection, and what arrives along them in a step from the spikes of the last ones.

Spikes are rows of synapses: what arrives is added event by event, the oldest spikes first, then by source, as the
reference adds it, so that sums are the same to the last bit, alone and in a batch.
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
    """What a population emitted in one step, as events.

    Attributes:
        recording, neuron, multiplicity: of all that sent, by recording, then neuron; multiplicities are doubles.
        spikes: shape (batch, neurons), where they have a gradient, else None.

    Args:
        spikes: how many spikes each neuron sent, as doubles, shape (batch, neurons).
    """

    __slots__ = ("multiplicity", "neuron", "recording", "spikes")

    def __init__(self, spikes: Tensor) -> None:
        values = spikes.detach()
        self.recording, self.neuron = values.nonzero(as_tuple=True)
        self.multiplicity = values[self.recording, self.neuron]
        self.spikes = spikes if spikes.requires_grad else None


Sent = Sequence[tuple[int, Emitted]]
"""Spikes emitted one delay ago, for each delay by its place in `TorchProjection.delays`, the oldest first."""


class TorchProjection:
    """A projection that carries spikes, with its synapses by delay (the longest first), then source.

    Attributes:
        delays: the distinct delays in steps, descending.
        receptors: of its target.
        target, slot: of every synapse: its neuron, and the place of its weight.
        first, count: where the synapses of each delay and source begin, and how many they are.

    Args:
        program: the network.
        index: which projection.
        device: where its arrays are.
        delay: of every synapse in steps, in place of the program's.
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
        place = np.searchsorted(-np.array(self.delays), -delay[order]) * self.n_source + source[order]
        count = np.bincount(place, minlength=len(self.delays) * self.n_source)
        self.bounds = [0, *np.cumsum(count)[self.n_source - 1 :: self.n_source].tolist()]
        self.source, self.target, self.slot = (self._held(each[order]) for each in (source, target, slot))
        self.count, self.first = self._held(count), self._held(np.cumsum(count) - count)
        self.whole = self.part.layout == "dense" and len(self.delays) == 1

    @property
    def nbytes(self) -> int:
        """Bytes that its arrays take, without the weights."""
        taken: int = 8 * (3 * self.target.numel() + 2 * self.count.numel())
        return taken

    def _held(self, values: Ints) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.int64)).to(self.device)

    def each(self, weights: Tensor, synapses: Tensor | slice) -> Tensor:
        """What arrives along some synapses, of one weight for all or one each."""
        places = self.slot[synapses]
        return self.arriving(weights.expand(len(places)) if weights.numel() == 1 else weights[places])

    def arriving(self, weights: Tensor) -> Tensor:
        """Weights as delivered to the receptor."""
        return 0.0 - weights if self.negated else weights

    def receptor(self, amounts: Tensor) -> Tensor | int:
        """The receptor of each amount. A -0.0, which comes from a negative weight, counts as negative."""
        if self.part.receptor is not None:
            return self.part.receptor.index
        return torch.signbit(amounts).to(torch.int64) if self.receptors == 2 else 0

    def followed(self, sent: Sent) -> tuple[Tensor, Tensor, Tensor]:
        """The synapses along which spikes arrive, one after the other, with their recordings and multiplicities."""
        found = [(d * self.n_source + e.neuron, e.recording, e.multiplicity) for d, e in sent if len(e.neuron)]
        if not found:
            nothing = torch.zeros(0, dtype=torch.int64, device=self.device)
            return nothing, nothing, nothing.to(torch.float64)
        rows, b, m = (torch.cat(column) if len(found) > 1 else column[0] for column in zip(*found, strict=True))
        count = self.count[rows]
        end = torch.cumsum(count, 0)
        which = torch.repeat_interleave(count)
        synapses = torch.arange(len(which), device=self.device) + (self.first[rows] - end + count)[which]
        return synapses, b[which], m[which]

    def by_rows(self, weights: Tensor) -> bool:
        """Whether each source reaches all targets by weights of its own, so that rows of them are added as they lie."""
        return self.whole and not self.relay and weights.numel() > 1 and weights.device.type == "cpu"

    def rows(self, values: Tensor, neurons: Tensor | slice = slice(None)) -> Tensor:
        """The row of each of some sources, of values in the order of the weights."""
        return values.reshape(self.n_source, self.n_target)[neurons]

    def add(self, x: Tensor, heard: Tensor | None, weights: Tensor, sent: Sent) -> None:
        """Add what arrives to `x`, shape (receptors, batch, neurons); note in `heard` (batch, neurons) which hear."""
        if self.by_rows(weights):
            for _, each in sent:
                self._add_rows(x, weights, each)
                if heard is not None:
                    heard[each.recording] = True
            return
        synapses, b, m = self.followed(sent)
        if len(synapses):
            amounts = m if self.relay else self.each(weights, synapses) * m
            place = b * self.n_target + self.target[synapses]
            added(x.view(-1), self.receptor(amounts) * x[0].numel() + place, amounts)
            if heard is not None:
                heard.view(-1)[place] = True

    def _add_rows(self, x: Tensor, weights: Tensor, emitted: Emitted) -> None:
        amounts = self.arriving(self.rows(weights, emitted.neuron)) * emitted.multiplicity[:, None]
        if self.part.receptor is not None:
            x[self.part.receptor.index].index_add_(0, emitted.recording, amounts)
        elif self.receptors == 2:
            x[0].index_add_(0, emitted.recording, amounts.clamp(min=0.0))
            x[1].index_add_(0, emitted.recording, amounts.clamp(max=0.0))
        else:
            x[0].index_add_(0, emitted.recording, amounts)

    def hear(self, heard: Tensor, sent: Sent) -> None:
        """Note in `heard` (batch, neurons) which hear a spike."""
        synapses, b, _ = self.followed(sent)
        heard.view(-1)[b * self.n_target + self.target[synapses]] = True


def added(into: Tensor, places: Tensor, amounts: Tensor) -> None:
    """Add amounts at places, in their order."""
    if into.is_cuda:
        into.index_put_((places,), amounts, accumulate=True)  # sorted: the order does not depend on threads
    else:
        into.index_add_(0, places, amounts)


# mypy: disable-error-code="no-untyped-def,no-untyped-call"


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
