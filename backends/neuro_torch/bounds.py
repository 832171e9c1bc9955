"""Where what learns may lie: delays and parameters of neurons within their bounds, and all of it numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from neuro.compiler.values import LONGEST_DELAY
from neuro.core import checks
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity
from neuro.program.program import Population, Program
from neuro_torch.problems import reset_of
from neuro_torch.trainable import Named

Tensors = Mapping[str, Tensor]

INSIDE = 1e-3
"""How far from a bound that it may not reach a value is put which has left it, in its unit."""

SLOWER = "a smaller learning rate"
HELD = "Module.hold() after each step of the optimiser keeps it in its bounds"


def in_steps(delay: Tensor, resolution: float, projection: str) -> Tensor:
    """Delays in steps; one that is below a step counts as one, and its gradient is that of one.

    Where descent would make it shorter still it has none, so that an optimiser takes it no further.

    Args:
        delay: in ms.
        resolution: length of a step in ms.
        projection: whose they are.

    Raises:
        ModelError: they are NaN, or longer than any may be.
    """
    check_delays(delay, resolution, projection)
    steps: Tensor = _AtLeast.apply(delay / resolution, 1.0)  # type: ignore[no-untyped-call]
    return steps


def check_delays(delay: Tensor, resolution: float, projection: str) -> None:
    """Refuse delays in ms that are NaN, or longer than any may be.

    Raises:
        ModelError: it names the projection.
    """
    if not delay.numel():
        return
    least, most = (float(each) for each in delay.detach().aminmax())
    if not (math.isfinite(least) and math.isfinite(most)):
        found = f"{most if math.isfinite(least) else least:g}: expected numbers of ms"
    elif most / resolution > LONGEST_DELAY + 0.5:  # half a step: a float may be a little more than the longest
        found = f"{most:g} ms: expected at most {LONGEST_DELAY * resolution:g} ms, 2^16 steps"
    else:
        return
    raise ModelError(f"delays of '{projection}': found {found}", hint=SLOWER)


def check_parameters(part: Population, learnt: Tensors) -> None:
    """Refuse parameters of neurons out of the bounds that their model has, and a threshold that is not above the reset.

    Raises:
        ModelError: it says which.
    """
    held = {word: values.detach().cpu().double().numpy() for word, values in learnt.items()}
    try:
        for word, values in held.items():
            value: Any = values.item() if values.size == 1 else values
            checks.check(part.model.quantities()[word], value, f"{word} of '{part.name}'")
        reset = reset_of(part)
        if {"V_th", reset} & held.keys() and {"V_th", reset} <= part.parameters.keys():
            both = (held.get(word, part.parameters[word]) for word in ("V_th", reset))
            top, bottom = np.broadcast_arrays(*both)
            for k in np.flatnonzero(~(top > bottom))[:1]:
                label = f"V_th of '{part.name}'{f'[{k}]' * (top.size > 1)} = {top[k]:g}"
                raise ModelError(f"{label}: expected more than {reset}, {bottom[k]:g} mV")
    except ModelError as error:
        raise error.but(hint=HELD) from None


def check(program: Program, weights: Named, delays: Named, neurons: Named) -> None:
    """Refuse what is NaN or out of its bounds, of all that learns.

    Raises:
        ModelError: it says what.
    """
    _check_numbers(program, weights, delays, neurons)
    for name, delay in delays.items():
        check_delays(delay, program.resolution, name)
    for part in program.populations:
        if part.name in neurons:
            check_parameters(part, dict(neurons[part.name].items()))


@torch.no_grad()
def hold(program: Program, weights: Named, delays: Named, neurons: Named) -> None:
    """Put what left its bounds back into them; what a user has parametrised is the user's to hold.

    Raises:
        ModelError: something is NaN, or a delay longer than any may be; it says what.
    """
    _check_numbers(program, weights, delays, neurons)
    for name, delay in delays.items():
        check_delays(delay, program.resolution, name)
        if isinstance(delay, torch.nn.Parameter):
            delay.clamp_(min=program.resolution)
    for part in program.populations:
        if part.name in neurons:
            own = {word: v for word, v in neurons[part.name].items() if isinstance(v, torch.nn.Parameter)}
            _hold_parameters(part, own)


def _check_numbers(program: Program, weights: Named, delays: Named, neurons: Named) -> None:
    for word, named in (("weights", weights), ("delays", delays)):
        for name, values in named.learnt().items():
            _check_finite(f"{word} of '{name}'", values)
    for part in program.populations:
        if part.name in neurons:
            quantities = part.model.quantities()
            for word, values in neurons[part.name].learnt().items():
                _check_finite(f"{word} of '{part.name}'", values, quantities[word].infinite)


def _check_finite(label: str, values: Tensor, infinite: bool = False) -> None:
    """Refuse what is NaN; the sum of many is looked at first, which costs little."""
    values = values.detach()
    if not math.isfinite(float(values.sum())):
        wrong = values.isnan() if infinite else ~values.isfinite()
        if bool(wrong.any()):
            raise ModelError(f"{label}: found {float(values[wrong][0]):g}: expected numbers", hint=SLOWER)


def _hold_parameters(part: Population, learnt: Tensors) -> None:
    """The threshold moves above its reset; where it does not learn, the reset moves below it."""
    for word, values in learnt.items():
        _hold(values, part.model.quantities()[word])
    reset = reset_of(part)
    if {"V_th", reset} <= part.parameters.keys():
        if "V_th" in learnt:
            bottom = _beside(learnt["V_th"], learnt, part, reset, torch.max)
            _put(learnt["V_th"], learnt["V_th"] <= bottom, bottom + INSIDE)
        elif reset in learnt:
            top = _beside(learnt[reset], learnt, part, "V_th", torch.min)
            _put(learnt[reset], learnt[reset] >= top, top - INSIDE)


def _hold(values: Tensor, q: Quantity) -> None:
    if q.above is not None:
        values.masked_fill_(values <= q.above, q.above + INSIDE)
    if q.below is not None:
        values.masked_fill_(values >= q.below, q.below - INSIDE)
    if q.at_least is not None or q.at_most is not None:
        values.clamp_(q.at_least, q.at_most)


def _beside(
    values: Tensor, learnt: Tensors, part: Population, word: str, strictest: Callable[[Tensor], Tensor]
) -> Tensor:
    """Another parameter as one value, or one value of each neuron, that `values` can be compared with."""
    other = learnt[word] if word in learnt else torch.as_tensor(part.parameters[word]).to(values)
    return strictest(other) if values.numel() == 1 else other


def _put(values: Tensor, where: Tensor, there: Tensor) -> None:
    values.copy_(torch.where(where, there, values))


class _AtLeast(torch.autograd.Function):
    """A lower bound whose gradient is that of none, but where descent would lead further below."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, least: float) -> Tensor:
        ctx.save_for_backward(values < least)
        return values.clamp(min=least)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        (below,) = ctx.saved_tensors
        return grads[0].masked_fill(below & (grads[0] > 0), 0.0), None
