"""Smaller networks: weights rounded as a chip rounds them while a module trains, and pruning of the smallest weights.

Rounded weights have the gradient straight through.

What rounding loses is thereby seen while a network learns. On Loihi the chip then finds every learnt weight on its
grid where all weights onto a population learn: others share the population's scale, are not rounded here, and may pull
it away, so that learnt weights round once more (7e-4 of the largest is the most that was seen). On SpiNNaker the words
are the same, and stand for the weights within 2^-15 in single precision, 2^-43 in double.

Source: Bengio, Leonard & Courville, arXiv:1308.3432, 2013 (the straight-through estimator).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils import parametrize

import neuro
from neuro.chips.description import Chip
from neuro.chips.known import chip as chip_of
from neuro.chips.quantising import quantise
from neuro.core.errors import ModelError, unknown
from neuro.program.program import Program
from neuro_torch.module import Module

__all__ = ["largest", "prune", "quantised"]

EVERY = 50
"""Batches of a training from one choice of the chip's scales to the next."""


def quantised(module: Module, bits: int = 8, chip: str | PathLike[str] = "loihi") -> Module:
    """Round the weights that learn as a chip does, in place; what is below the rounding stays in the parameters.

    Scales are those that `neuro.chips.quantise` chooses for the weights as they are; while the module trains they are
    chosen anew every 50 batches, and for each batch that it is only asked. Of a module that is quantised already the
    bits and the chip take the place of those that it had, and what is below the old rounding is not lost.

    Args:
        module: the network.
        bits: of a weight, from 1 to those of the chip: 8 of Loihi, its sign included. One bit is the sign, and all
            weights are half of the largest; where the chip lets none be below 0, it says whether there is a weight.
        chip: a name or a table file; it needs an arithmetic.

    Returns:
        the module.

    Raises:
        ModelError: there is no such chip, it has no arithmetic, it refuses the network, or has not so many bits; or no
            weights learn.
    """
    target = chip_of(chip)
    if isinstance(bits, bool) or not isinstance(bits, int) or bits < 1:
        raise ModelError(f"bits = {bits!r}: expected a whole number >= 1")
    if not len(module.weights):
        raise ModelError("quantised: no weights of the module learn: expected those of a projection at least")
    return _rounding_as(_Scales(module.program, target, bits), module)


def quantised_as(module: Module, other: Module) -> Module:
    """Round the weights of another module as those of the first are, if they are."""
    scales = _scales(module)
    return other if scales is None else _rounding_as(_Scales(other.program, scales.chip, scales.bits), other)


def _rounding_as(scales: _Scales, module: Module) -> Module:
    """Let a module round by these scales, and by no others."""
    known = _scales(module)
    if known is not None:
        known.chip, known.bits = scales.chip, scales.bits
        known.choose(module)
        return module
    for name, weight in list(module.weights.items()):
        at = module.weights.attribute(name)
        parametrize.register_parametrization(module.weights, at, _Rounded(weight, scales), unsafe=True)
    scales.choose(module)
    module.register_forward_pre_hook(scales)
    return module


class _Scales:
    """Chooses the scales of all projections together, before a batch runs.

    Since populations share one for all that arrives at them, and a chip's may depend on more than the largest weight.
    """

    def __init__(self, program: Program, chip: Chip, bits: int) -> None:
        self.chip, self.bits = chip, bits
        self._index = {part.name: k for k, part in enumerate(program.projections)}
        self._check(program)

    def __call__(self, module: Any, inputs: Any) -> None:
        age = next(iter(_rounded(module).values()))[-1].age
        if not module.training or int(age) % EVERY == 0:
            self.choose(module)
        if module.training:
            age += 1

    def choose(self, module: Module) -> None:
        """Choose them for the weights as they are.

        Raises:
            ModelError: a weight is NaN.
        """
        rounded = _rounded(module)
        projections = list(module.program.projections)
        for name, each in rounded.items():
            weight = each.original.detach().double().cpu().numpy().ravel()
            if not np.isfinite(weight).all():
                raise ModelError(f"weights of '{name}' are no numbers: expected numbers that can be rounded")
            projections[self._index[name]] = replace(projections[self._index[name]], weight=weight)
        fixed = quantise(replace(module.program, projections=tuple(projections)), self.chip)
        for name, each in rounded.items():
            wires, grid = fixed.projections[self._index[name]], each[-1]
            assert wires is not None, "it was looked at"
            signs = self.bits == 1 and wires.low < 0 < wires.high
            size = wires.grain * 2 ** (wires.bits - (2 if signs else self.bits))
            grid.lie(wires.step * size, wires.step_below * size)
            grid.low.fill_(-1 if signs else -(-wires.low // size))
            grid.high.fill_(1 if signs else wires.high // size)

    def _check(self, program: Program) -> None:
        fixed = quantise(program, self.chip)
        for problem in fixed.problems:
            if problem.refused:
                message = f"{problem.what}: {problem.why}"
                raise ModelError(f"{self.chip.name} refuses the network: {message}", hint=problem.way_out)
        most = min(wires.bits for wires in fixed.projections if wires is not None)
        if self.bits > most:
            raise ModelError(f"bits = {self.bits}: weights of {self.chip.name} have {most}: expected 1 to {most}")


class _Rounded(torch.nn.Module):
    """The weights of one projection on the grid of a chip; `scales` are those of all together."""

    step: Tensor
    below: Tensor
    low: Tensor
    high: Tensor
    age: Tensor
    even: Tensor

    def __init__(self, weight: Tensor, scales: _Scales) -> None:
        super().__init__()
        self.scales = scales
        for name in ("step", "below"):
            self.register_buffer(name, torch.ones_like(weight))
        for name in ("low", "high", "age"):
            self.register_buffer(name, torch.zeros((), dtype=torch.int64))
        self.register_buffer("even", torch.zeros((), dtype=torch.bool))

    def lie(self, step: Any, below: Any) -> None:
        """Take a grid; of each step so few bits are kept that every weight on it is one, in single precision, too."""
        for buffer, values in ((self.step, step), (self.below, below)):
            fraction, exponent = np.frexp(np.broadcast_to(values, buffer.numel() if np.size(values) > 1 else 1))
            kept = 16 if buffer.dtype == torch.float32 else 44
            short = np.ldexp(np.ceil(np.ldexp(fraction, kept)), exponent - kept)
            buffer.copy_(torch.as_tensor(short.reshape(buffer.shape if short.size > 1 else (1,))))
        self.even.fill_(torch.equal(self.step, self.below))

    def forward(self, weight: Tensor) -> Tensor:
        """What the chip has of them."""
        below = self.step if self.even else self.below
        rounded: Tensor = _Straight.apply(weight, self.step, below, self.low, self.high)  # type: ignore[no-untyped-call]
        return rounded

    def right_inverse(self, weight: Tensor) -> Tensor:
        """What is learnt, where weights are set."""
        return weight


class _Straight(torch.autograd.Function):
    """Rounding, whose gradient is that of doing nothing."""

    @staticmethod
    def forward(ctx: Any, weight: Tensor, step: Tensor, below: Tensor, low: Tensor, high: Tensor) -> Tensor:
        size = step if step is below else torch.where(weight < 0, below, step)
        level = (weight / size).round_().clamp_(low, high)
        one_bit = high - low == 2
        if one_bit.any():
            level = torch.where(one_bit, torch.where(weight < 0, -1.0, 1.0).to(weight.dtype), level)
        return level.mul_(size)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        return gradients[0], None, None, None, None


def _rounded(module: Any) -> dict[str, Any]:
    """The roundings of a module, and the weights that they round, by projection."""
    parametrizations = getattr(module.weights, "parametrizations", {})
    places = {name: module.weights.attribute(name) for name in module.weights}
    return {name: parametrizations[at] for name, at in places.items() if at in parametrizations}


def _scales(module: Module) -> _Scales | None:
    """What chooses the scales of a module that is quantised."""
    found: _Scales | None = next((each[-1].scales for each in _rounded(module).values()), None)
    return found


Bools = NDArray[np.bool_]


def prune(
    module: Module, share: float | Mapping[str, float] | None = None, *, stay: Mapping[str, Bools] | None = None
) -> Module:
    """A module of the same network without its smallest weights, by magnitude; it learns on.

    The synapses are gone, not 0: the network that it gives lists those that are left, which is what a chip stores and
    what a bill counts. Optimisers and bills are made anew, since parameters and synapses are. A module whose weights
    are quantised gives one that is, to the same bits of the same chip; it begins with the rounded weights.

    Args:
        module: the network; it is not changed.
        share: of the synapses of each projection that learns, 0 to 1 and less than all; or by name of the projection.
        stay: instead of a share the synapses that stay, by name, in the order of the weights.

    Raises:
        ModelError: a name is unknown or its weights are shared, or a share cannot be.
    """
    if (share is None) == (stay is None):
        raise ModelError("prune: expected a share, or which synapses stay")
    if stay is None:
        shares = share if isinstance(share, Mapping) else dict.fromkeys(_own(module), share)
        for name, part in shares.items():
            if isinstance(part, bool) or not isinstance(part, (int, float)) or not 0.0 <= part < 1.0:
                raise ModelError(f"prune: projection '{name}': share = {part!r}: expected 0 to 1, and less than 1")
        _check(module, shares)
        stay = {name: _largest(module, name, 1.0 - float(part)) for name, part in shares.items() if part is not None}
    _check(module, stay)
    for name, kept in stay.items():
        if not np.any(kept):
            raise ModelError(f"prune: projection '{name}': none of its {len(kept)} synapses stays: expected some")
    return quantised_as(module, module.on(_with(module, stay)))


def largest(module: Module, share: float) -> dict[str, Bools]:
    """Which synapses have the largest weights, by projection, in the order of the weights; shared ones are left out.

    Args:
        module: the network.
        share: of the synapses of each projection.
    """
    return {name: _largest(module, name, share) for name in _own(module)}


def _largest(module: Module, name: str, share: float) -> Bools:
    weight = module.weights[name].detach().abs().reshape(-1).cpu().numpy()
    chosen = np.zeros(weight.size, dtype=bool)
    chosen[np.argsort(weight, kind="stable")[weight.size - round(share * weight.size) :]] = True
    return chosen


def _check(module: Module, named: Mapping[str, object]) -> None:
    if not named:
        raise ModelError("prune: found no projection with a weight of its own for each synapse: expected at least one")
    for name in named:
        if name not in module.weights:
            raise unknown("projection that learns", name, list(module.weights))
        if name not in _own(module):
            raise ModelError(f"prune: projection '{name}': its synapses share weights", hint="leave it out")


def _own(module: Module) -> list[str]:
    """Projections that learn and have a weight of its own for each synapse."""
    parts = {part.name: part for part in module.program.projections}
    return [name for name in module.weights if parts[name].grid is None and parts[name].weight.size == parts[name].size]


def _with(module: Module, stay: Mapping[str, Bools]) -> neuro.Network:
    """The network with what was learnt, and of some projections only some synapses."""
    net = module.network()
    program = module.program
    for index, part in enumerate(program.projections):
        if part.name not in stay:
            continue
        kept = np.flatnonzero(stay[part.name])
        pre, post = program.connections(index)
        weight = module.weights[part.name].detach().cpu().double().numpy().reshape(-1)
        delay = np.broadcast_to(part.delay, part.size)[kept] * program.resolution
        net.projections[part.name] = replace(
            net.projections[part.name],
            rule=neuro.pairs(pre=pre[kept], post=post[kept]),
            weight=weight[kept],
            delay=float(delay[0]) if np.all(delay == delay[:1]) else delay,
            source_view=None,
            target_view=None,
        )
    return net
