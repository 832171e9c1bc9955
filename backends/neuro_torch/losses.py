"""Losses: distance of the output neurons' spikes or potentials from a target, averaged over the batch.

Spikes have the shape (batch, steps, neurons). Labels have the shape (batch,) and name the neuron that should respond
most.

| loss | is small where | source |
| --- | --- | --- |
| `count_cross_entropy` | the labelled neuron fires most often | Eshraghian et al., Proc. IEEE 111(9):1016, 2023 |
| `potential_cross_entropy` | the labelled neuron's potential is highest | Cramer et al., IEEE TNNLS 33(7):2744, 2022 |
| `first_spike` | the labelled neuron fires first | Mostafa, IEEE TNNLS 29(7):3227, 2018; the gradient is our own |
| `potential_mse` | potentials follow target values | leaky readout: Bellec et al., NeurIPS 2018 |
| `van_rossum` | spike trains are near the targets | van Rossum, Neural Comput. 13(4):751, 2001 |

**The time of a first spike** is a polynomial of the spikes: the sum over steps t of the product of 1 - s(u) for all
u <= t. The derivative is the exact effect of adding or removing one spike. A spike added at a step u before the first
spike at t moves the time by u - t steps. If the first spike is removed, the second one counts. The time of a
neuron that never fired is the end of the recording, and all steps contribute to the gradient.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Literal

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from neuro.core.errors import ModelError, unknown

__all__ = [
    "LOSSES",
    "count_cross_entropy",
    "decisions",
    "first_spike",
    "first_spike_steps",
    "potential_cross_entropy",
    "potential_mse",
    "van_rossum",
]

Over = Literal["mean", "max", "last"]


def count_cross_entropy(spikes: Tensor, labels: Tensor, *, scale: float = 1.0) -> Tensor:
    """Return the cross-entropy of softmax(scale x spike counts).

    Args:
        spikes: (batch, steps, neurons).
        labels: (batch,), the neuron that should fire most.
        scale: logit per spike.

    Raises:
        ModelError: shapes or labels are wrong.
    """
    _check(spikes, labels)
    return cross_entropy(scale * spikes.sum(dim=1), labels)


def potential_cross_entropy(V_m: Tensor, labels: Tensor, *, over: Over = "mean", scale: float = 1.0) -> Tensor:
    """Return the cross-entropy of softmax(scale x potentials).

    Args:
        V_m: (batch, steps, neurons), mV.
        labels: (batch,), the neuron whose potential should be highest.
        over: reduction over the steps: "mean", "max" or "last".
        scale: logit per mV.

    Raises:
        ModelError: shapes or labels are wrong, or `over` is unknown.
    """
    _check(V_m, labels)
    potential: dict[str, Callable[[], Tensor]] = {
        "mean": lambda: V_m.mean(dim=1),
        "max": lambda: V_m.amax(dim=1),
        "last": lambda: V_m[:, -1],
    }
    if over not in potential:
        raise unknown("way to read potentials", over, potential)
    return cross_entropy(scale * potential[over](), labels)


def potential_mse(V_m: Tensor, wanted: Tensor) -> Tensor:
    """Return the mean squared difference between potentials and targets, mV^2.

    Args:
        V_m: (batch, steps, neurons), mV.
        wanted: targets of the same shape; NaN entries are ignored.

    Raises:
        ModelError: shapes differ, or all targets are NaN.
    """
    _check_shapes(V_m, wanted, "potentials")
    is_target = ~wanted.isnan()
    if not is_target.any():
        raise ModelError("wanted: all values are NaN: expected some numbers")
    return (V_m - wanted)[is_target].square().mean()


def first_spike(spikes: Tensor, labels: Tensor, *, tau: float = 10.0, resolution: float = 1.0) -> Tensor:
    """Return the cross-entropy of softmax(-time of the first spike / tau).

    Args:
        spikes: (batch, steps, neurons).
        labels: (batch,), the neuron that should fire first.
        tau: time by which the other neurons should fire later, ms.
        resolution: length of a step, ms.

    Raises:
        ModelError: shapes, labels or times are wrong.
    """
    _check(spikes, labels)
    _check_times(tau=tau, resolution=resolution)
    return cross_entropy(first_spike_steps(spikes) * (-resolution / tau), labels)


def first_spike_steps(spikes: Tensor) -> Tensor:
    """Return the number of steps before the first spike of each neuron, (batch, neurons), differentiable.

    The value of a neuron without a spike is the number of steps of the recording.

    Args:
        spikes: (batch, steps, neurons); several spikes in one step count as one.
    """
    steps: Tensor = _FirstSpike.apply(spikes)  # type: ignore[no-untyped-call]
    return steps


class _FirstSpike(torch.autograd.Function):
    """The time of the first spike, with the derivative that the module's docstring defines."""

    @staticmethod
    def forward(ctx: Any, spikes: Tensor) -> Tensor:
        first = _first(spikes != 0)
        ctx.save_for_backward(spikes, first)
        return first.to(spikes.dtype)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        spikes, first = ctx.saved_tensors
        step = torch.arange(spikes.shape[1], device=spikes.device)[None, :, None]
        is_later = (spikes != 0) & (step > first[:, None, :])
        second = _first(is_later)
        steps_earlier = (first[:, None, :] - step).clamp(min=0)
        delay_to_second = torch.where(step == first[:, None, :], (second - first)[:, None, :], 0)
        change: Tensor = -(steps_earlier + delay_to_second).to(gradient.dtype) * gradient[:, None, :]
        return change


def _first(fired: Tensor) -> Tensor:
    """Return the first true step, or the number of steps; (batch, neurons)."""
    steps = fired.shape[1]
    step = torch.arange(steps, device=fired.device)[None, :, None]
    return torch.where(fired, step, steps).amin(dim=1)


def van_rossum(spikes: Tensor, wanted: Tensor, *, tau: float = 10.0, resolution: float = 1.0) -> Tensor:
    """Return the squared van Rossum distance of spike trains, summed over neurons; one extra spike adds 1/2.

    Args:
        spikes: (batch, steps, neurons).
        wanted: target trains of the same shape.
        tau: time constant of the kernel exp(-t / tau), ms; spikes much nearer than tau count as coincident.
        resolution: length of a step, ms.

    Raises:
        ModelError: shapes or times are wrong.
    """
    _check_shapes(spikes, wanted, "spikes")
    _check_times(tau=tau, resolution=resolution)
    decay = math.exp(-resolution / tau)
    distance, trace = torch.zeros_like(spikes[:, 0]), torch.zeros_like(spikes[:, 0])
    for difference in (spikes - wanted.to(spikes.dtype)).unbind(dim=1):
        distance = distance + 0.5 * (1.0 - decay * decay) * trace.square()  # integral over the step that ends here
        trace = decay * trace + difference
    return (distance + 0.5 * trace.square()).sum(dim=1).mean()  # integral from the last step to infinity


LOSSES: Mapping[str, Callable[..., Tensor]] = {
    "count": count_cross_entropy,
    "potential": potential_cross_entropy,
    "first_spike": first_spike,
}
"""Losses that compare spikes or potentials with labels, by their name in `neuro train`."""


def decisions(spikes: Tensor) -> Tensor:
    """Return the output neuron that fired most, -1 if none fired; for graded neurons the largest sum of payloads.

    Ties go to the neuron that fired first, then to the lower index.

    Args:
        spikes: (batch, steps, neurons).

    Returns:
        (batch,), int64.
    """
    count, steps = spikes.double().sum(dim=1), spikes.shape[1]
    winners = (count * (steps + 1) + (steps - _first(spikes != 0))).argmax(dim=1)
    return torch.where((spikes != 0).any(dim=2).any(dim=1), winners, -1)


def _check(values: Tensor, labels: Tensor) -> None:
    """Refuse values that are not a batch, and labels that do not fit."""
    if values.dim() != 3:
        raise ModelError(f"a tensor of shape {tuple(values.shape)}: expected (batch, steps, neurons)")
    batch, _, neurons = values.shape
    if tuple(labels.shape) != (batch,):
        raise ModelError(f"labels of shape {tuple(labels.shape)}: expected ({batch},), one for each recording")
    invalid = labels[(labels < 0) | (labels >= neurons)]
    if invalid.numel():
        raise ModelError(f"label {int(invalid[0])}: expected a neuron from 0 to {neurons - 1}")


def _check_shapes(values: Tensor, targets: Tensor, name: str) -> None:
    """Refuse targets of another shape."""
    if values.shape != targets.shape or values.dim() != 3:
        message = f"{name} of shape {tuple(values.shape)} and wanted ones of shape {tuple(targets.shape)}"
        raise ModelError(f"{message}: expected the same shape, (batch, steps, neurons)")


def _check_times(**times: float) -> None:
    """Refuse times that are not above 0."""
    for name, value in times.items():
        if not 0.0 < value < math.inf:
            raise ModelError(f"{name} = {value!r}: expected a time > 0 in ms")
