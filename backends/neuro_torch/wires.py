"""The synapses of one projection, and what arrives along them in a step from the spikes of the last ones.

Spikes are rows of synapses: what arrives is added event by event, the oldest spikes first, then by source, as the
reference adds it, so that sums are the same to the last bit, alone and in a batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from neuro.model.neurons import Neuron
from neuro.program.program import Program


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
"""What was emitted so many steps ago as a delay has, by the place of that delay in `Wires.delays`, the oldest first."""


class Wires:
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
    """

    def __init__(self, program: Program, index: int, device: torch.device) -> None:
        self.part, self.device = program.projections[index], device
        self.n_source = program.populations[self.part.source].size
        self.n_target = program.populations[self.part.target].size
        model = program.populations[self.part.target].model
        assert isinstance(model, Neuron)
        self.receptors, self.relay = model.receptors, model.relay
        source, target, slot = program.synapses(index)
        delay = np.broadcast_to(self.part.delay, len(source)).astype(np.int64)
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
        return 8 * (3 * self.target.numel() + 2 * self.count.numel())

    def _held(self, values: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.int64)).to(self.device)

    def each(self, weights: Tensor, synapses: Tensor | slice) -> Tensor:
        """What arrives along some synapses, of one weight for all or one each."""
        amounts = (
            weights.expand(self.part.size)[self.slot[synapses]]
            if weights.numel() == 1
            else weights[self.slot[synapses]]
        )
        return 0.0 - amounts if self.part.receptor is not None and self.part.receptor.negated else amounts

    def receptor(self, amounts: Tensor) -> Tensor | int:
        """To which of its target's receptors some amounts go."""
        if self.part.receptor is not None:
            return self.part.receptor.index
        return (amounts < 0.0).to(torch.int64) if self.receptors == 2 else 0

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

    def add(self, x: Tensor, heard: Tensor | None, weights: Tensor, sent: Sent) -> None:
        """Add what arrives to `x`, shape (receptors, batch, neurons); note in `heard` (batch, neurons) who hears."""
        synapses, b, m = self.followed(sent)
        if not len(synapses):
            return
        place = b * self.n_target + self.target[synapses]
        amounts = m if self.relay else self.each(weights, synapses) * m
        added(x.view(-1), self.receptor(amounts) * x[0].numel() + place, amounts)
        if heard is not None:
            heard.view(-1)[place] = True

    def hear(self, heard: Tensor, sent: Sent) -> None:
        """Note in `heard` (batch, neurons) who hears a spike."""
        synapses, b, _ = self.followed(sent)
        heard.view(-1)[b * self.n_target + self.target[synapses]] = True


def added(into: Tensor, places: Tensor, amounts: Tensor) -> None:
    """Add amounts at places, in their order."""
    if into.is_cuda:
        into.index_put_((places,), amounts, accumulate=True)  # sorted: the order does not depend on threads
    else:
        into.index_add_(0, places, amounts)


class Arrivals(torch.autograd.Function):
    """What arrives along a projection in a step, with its gradient to the weights and to spikes, also to those not sent.

    A source that stayed silent has a gradient, too: its surrogate says how near it was to a spike.
    """

    @staticmethod
    def forward(ctx, wires, weights, batch, sent, *spikes):  # type: ignore[no-untyped-def]
        """Shape (receptors, batch, neurons); `spikes` are those of `sent`, for their gradients."""
        x = torch.zeros(max(2, wires.receptors), batch, wires.n_target, dtype=torch.float64, device=wires.device)
        wires.add(x, None, weights, sent)
        ctx.wires, ctx.sent = wires, sent
        ctx.save_for_backward(weights)
        return x

    @staticmethod
    def backward(ctx, g):  # type: ignore[no-untyped-def]
        """Of the weights: what their synapses brought; of a spike: what all its synapses would have brought."""
        wires, (weights,), g = ctx.wires, ctx.saved_tensors, g.contiguous()
        of_weights = None
        if ctx.needs_input_grad[1] and not wires.relay:
            of_weights = _of_weights(wires, weights, g, ctx.sent)
        asked = zip(ctx.needs_input_grad[4:], ctx.sent, strict=True)
        of_spikes = [_of_spikes(wires, weights, g, d) if needed else None for needed, (d, _) in asked]
        return None, of_weights, None, None, *of_spikes


def _of_weights(wires: Wires, weights: Tensor, g: Tensor, sent: Sent) -> Tensor:
    synapses, b, m = wires.followed(sent)
    receptor = wires.receptor(wires.each(weights, synapses) * m)
    share = g.view(-1)[receptor * g[0].numel() + b * wires.n_target + wires.target[synapses]] * m
    if wires.part.receptor is not None and wires.part.receptor.negated:
        share = -share
    if weights.numel() == 1:
        return share.sum().reshape(weights.shape)
    found = torch.zeros_like(weights)
    added(found.view(-1), wires.slot[synapses], share)
    return found


def _of_spikes(wires: Wires, weights: Tensor, g: Tensor, d: int) -> Tensor:
    if wires.whole and not wires.relay and weights.numel() > 1 and wires.part.receptor is None:
        w = weights.view(wires.n_source, wires.n_target).T
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
