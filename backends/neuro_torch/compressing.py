"""Smaller networks: weights rounded as on a chip while a module trains, and pruning of the smallest weights.

The gradient passes through the rounding unchanged (straight-through estimator), so training compensates for it.

On Loihi the chip represents every learnt weight exactly if all weights onto a population learn. Weights that do not
learn share the scale but are not rounded here, so they may change the scale, and learnt weights are rounded once more
(by 7e-4 of the largest weight at most in tests). On SpiNNaker the words are the same and represent the weights
within 2^-15 in single precision and 2^-43 in double precision.

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

BATCHES_PER_CHOICE = 50
"""Number of training batches between two choices of the chip's scales."""


def quantised(module: Module, bits: int = 8, chip: str | PathLike[str] = "loihi") -> Module:
    """Round the weights that learn as a chip does, in place; the parameters keep full precision.

    `neuro.chips.quantise` chooses the scales from the current weights: every 50 batches in training mode, before every
    batch in evaluation mode. If the module is quantised already, the new bits and chip replace the old ones, and the
    full-precision weights remain.

    Args:
        module: the network.
        bits: number of bits of a weight with its sign, 1 to the chip's number (8 on Loihi). With one bit every weight
            is plus or minus half of the largest. On a chip without negative weights the bit says whether there is a
            weight.
        chip: name or table file of a chip that has an arithmetic.

    Returns:
        the same module.

    Raises:
        ModelError: the chip is unknown, has no arithmetic, refuses the network, or has fewer bits; or no weights learn.
    """
    target = chip_of(chip)
    if isinstance(bits, bool) or not isinstance(bits, int) or bits < 1:
        raise ModelError(f"bits = {bits!r}: expected a whole number >= 1")
    if not len(module.weights):
        raise ModelError("quantised: no weights of the module learn: expected those of at least one projection")
    return _quantise_with(_Scales(module.program, target, bits), module)


def quantised_as(module: Module, other: Module) -> Module:
    """Quantise `other` with the bits and the chip of `module`, if `module` is quantised."""
    scales = _scales_hook(module)
    return other if scales is None else _quantise_with(_Scales(other.program, scales.chip, scales.bits), other)


def _quantise_with(scales: _Scales, module: Module) -> Module:
    """Quantise a module with these scales, in place of any others."""
    current = _scales_hook(module)
    if current is not None:
        current.chip, current.bits = scales.chip, scales.bits
        current.choose(module)
        return module
    for name, weight in list(module.weights.items()):
        attribute = module.weights.attribute(name)
        parametrize.register_parametrization(module.weights, attribute, _Rounded(weight, scales), unsafe=True)
    scales.choose(module)
    module.register_forward_pre_hook(scales)
    return module


class _Scales:
    """A forward hook that chooses the scales of all projections together, before a batch runs.

    The choice is joint because all weights onto a population share a scale, which may depend on more than the largest
    weight.
    """

    def __init__(self, program: Program, chip: Chip, bits: int) -> None:
        self.chip, self.bits = chip, bits
        self._index = {part.name: k for k, part in enumerate(program.projections)}
        self._check(program)

    def __call__(self, module: Any, inputs: Any) -> None:
        age = next(iter(_parametrisations(module).values()))[-1].age
        if not module.training or int(age) % BATCHES_PER_CHOICE == 0:
            self.choose(module)
        if module.training:
            age += 1

    def choose(self, module: Module) -> None:
        """Choose the scales for the current weights.

        Raises:
            ModelError: a weight is not finite.
        """
        rounded = _parametrisations(module)
        projections = list(module.program.projections)
        for name, weights in rounded.items():
            weight = weights.original.detach().double().cpu().numpy().ravel()
            if not np.isfinite(weight).all():
                raise ModelError(f"weights of '{name}' are not finite: expected finite numbers")
            projections[self._index[name]] = replace(projections[self._index[name]], weight=weight)
        network = quantise(replace(module.program, projections=tuple(projections)), self.chip)
        for name, weights in rounded.items():
            fixed, grid = network.projections[self._index[name]], weights[-1]
            assert fixed is not None, "the hook quantises every learnt projection"
            only_signs = self.bits == 1 and fixed.low < 0 < fixed.high
            size = fixed.grain * 2 ** (fixed.bits - (2 if only_signs else self.bits))
            grid.set_steps(fixed.step * size, fixed.step_below * size)
            grid.low.fill_(-1 if only_signs else -(-fixed.low // size))
            grid.high.fill_(1 if only_signs else fixed.high // size)

    def _check(self, program: Program) -> None:
        fixed = quantise(program, self.chip)
        for problem in fixed.problems:
            if problem.refused:
                message = f"{problem.what}: {problem.why}"
                raise ModelError(f"{self.chip.name} refuses the network: {message}", hint=problem.way_out)
        limit = min(wires.bits for wires in fixed.projections if wires is not None)
        if self.bits > limit:
            raise ModelError(f"bits = {self.bits}: weights of {self.chip.name} have {limit}: expected 1 to {limit}")


class _Rounded(torch.nn.Module):
    """The weights of one projection, rounded to the grid of a chip; `scales` chooses the grid."""

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

    def set_steps(self, step: Any, below: Any) -> None:
        """Set the grid's steps above and below 0.

        The mantissa of a step is shortened, 16 bits in single and 44 in double precision, so that every multiple of the
        step is exact in the dtype.
        """
        for buffer, values in ((self.step, step), (self.below, below)):
            fraction, exponent = np.frexp(np.broadcast_to(values, buffer.numel() if np.size(values) > 1 else 1))
            mantissa_bits = 16 if buffer.dtype == torch.float32 else 44
            shortened = np.ldexp(np.ceil(np.ldexp(fraction, mantissa_bits)), exponent - mantissa_bits)
            buffer.copy_(torch.as_tensor(shortened.reshape(buffer.shape if shortened.size > 1 else (1,))))
        self.even.fill_(torch.equal(self.step, self.below))

    def forward(self, weight: Tensor) -> Tensor:
        """Return the rounded weights."""
        below = self.step if self.even else self.below
        rounded: Tensor = _StraightThrough.apply(weight, self.step, below, self.low, self.high)  # type: ignore[no-untyped-call]
        return rounded

    def right_inverse(self, weight: Tensor) -> Tensor:
        """Return the full-precision weights that an assignment sets."""
        return weight


class _StraightThrough(torch.autograd.Function):
    """Rounding with the gradient of the identity."""

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


def _parametrisations(module: Any) -> dict[str, Any]:
    """Return the parametrisations of a module's quantised weights, by projection."""
    parametrizations = getattr(module.weights, "parametrizations", {})
    attributes = {name: module.weights.attribute(name) for name in module.weights}
    return {
        name: parametrizations[attribute] for name, attribute in attributes.items() if attribute in parametrizations
    }


def _scales_hook(module: Module) -> _Scales | None:
    """Return the hook that chooses the scales of a module, None if the module is not quantised."""
    scales: _Scales | None = next((steps[-1].scales for steps in _parametrisations(module).values()), None)
    return scales


Bools = NDArray[np.bool_]


def prune(
    module: Module, share: float | Mapping[str, float] | None = None, *, stay: Mapping[str, Bools] | None = None
) -> Module:
    """Return a module of the same network without its smallest weights by magnitude; the module can be trained further.

    Pruned synapses are removed, not set to 0: the network lists the remaining synapses, and chips and bills see only
    these. Make new optimisers and bills, since parameters and synapses are new. The result of a quantised module is
    quantised to the same bits of the same chip and begins with the rounded weights.

    Args:
        module: the network; it is not changed.
        share: share of the synapses to remove, from 0 to less than 1, for all projections that learn or by projection
            name.
        stay: instead of a share, masks of the synapses that stay, by projection name, in the order of the weights.

    Raises:
        ModelError: a name is unknown, a projection shares weights, or a share is out of range.
    """
    if (share is None) == (stay is None):
        raise ModelError("prune: expected either share or stay")
    if stay is None:
        shares = share if isinstance(share, Mapping) else dict.fromkeys(_with_separate_weights(module), share)
        for name, cut in shares.items():
            if isinstance(cut, bool) or not isinstance(cut, (int, float)) or not 0.0 <= cut < 1.0:
                raise ModelError(f"prune: projection '{name}': share = {cut!r}: expected 0 to 1, and less than 1")
        _check(module, shares)
        stay = {name: _largest(module, name, 1.0 - float(cut)) for name, cut in shares.items() if cut is not None}
    _check(module, stay)
    for name, mask in stay.items():
        if not np.any(mask):
            raise ModelError(f"prune: projection '{name}': none of its {len(mask)} synapses stays: expected some")
    return quantised_as(module, module.on(_keep_synapses(module, stay)))


def largest(module: Module, share: float) -> dict[str, Bools]:
    """Return masks of the synapses with the largest weights, by projection, in the order of the weights.

    Projections with shared weights are left out.

    Args:
        module: the network.
        share: share of the synapses of each projection, 0 to 1.
    """
    return {name: _largest(module, name, share) for name in _with_separate_weights(module)}


def _largest(module: Module, name: str, share: float) -> Bools:
    weight = module.weights[name].detach().abs().reshape(-1).cpu().numpy()
    chosen = np.zeros(weight.size, dtype=bool)
    chosen[np.argsort(weight, kind="stable")[weight.size - round(share * weight.size) :]] = True
    return chosen


def _check(module: Module, by_name: Mapping[str, object]) -> None:
    if not by_name:
        raise ModelError("prune: found no projection with a weight of its own for each synapse: expected at least one")
    for name in by_name:
        if name not in module.weights:
            raise unknown("projection that learns", name, list(module.weights))
        if name not in _with_separate_weights(module):
            raise ModelError(f"prune: projection '{name}': its synapses share weights", hint="leave it out")


def _with_separate_weights(module: Module) -> list[str]:
    """Return the projections that learn and have a separate weight for each synapse."""
    parts = {part.name: part for part in module.program.projections}
    return [name for name in module.weights if parts[name].grid is None and parts[name].weight.size == parts[name].size]


def _keep_synapses(module: Module, stay: Mapping[str, Bools]) -> neuro.Network:
    """Return the network with the learnt weights and, in some projections, only the synapses that stay."""
    net = module.network()
    program = module.program
    for index, part in enumerate(program.projections):
        if part.name not in stay:
            continue
        indices = np.flatnonzero(stay[part.name])
        pre, post = program.connections(index)
        weight = module.weights[part.name].detach().cpu().double().numpy().reshape(-1)
        delay = np.broadcast_to(part.delay, part.size)[indices] * program.resolution
        net.projections[part.name] = replace(
            net.projections[part.name],
            rule=neuro.pairs(pre=pre[indices], post=post[indices]),
            weight=weight[indices],
            delay=float(delay[0]) if np.all(delay == delay[:1]) else delay,
            source_view=None,
            target_view=None,
        )
    return net
