"""Parameters that learn: names from the user, tensors by name, and bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, ItemsView, Iterable, Iterator, KeysView, Mapping, ValuesView
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils import parametrize

from neuro.compiler.values import LONGEST_DELAY
from neuro.core import checks
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import Quantity
from neuro.model.neurons import Neuron
from neuro.program.program import Population, Program
from neuro_torch.problems import reset_of

Words = Mapping[str, tuple[str, ...]]
"""Names of the quantities that learn, by projection or population, e.g. {"in_hidden": ("weight", "delay")}."""

FIXED = ("t_ref", "refractory_input", "reset_by_subtraction", "max_spikes", "threshold_rises", "tau_minus")
"""Parameters without a gradient: counts of steps, switches, and `tau_minus`, which only rules of pairs read."""


def trainable(program: Program, user_choice: Iterable[str] | Mapping[str, Iterable[str] | str]) -> tuple[Words, Words]:
    """Return the names of the quantities that learn, of projections ("weight", "delay") and populations (parameters).

    Args:
        program: the network.
        user_choice: names of projections whose weights learn; or names of quantities, by projection or population.

    Raises:
        ModelError: nothing is named, or a named quantity cannot learn.
    """
    choices = {user_choice: "weight"} if isinstance(user_choice, str) else user_choice
    if not isinstance(choices, Iterable) or not all(isinstance(name, str) for name in choices):
        raise ModelError(f"trainable = {user_choice!r}: expected names of projections")
    parameters_of = dict(choices) if isinstance(choices, Mapping) else dict.fromkeys(choices, "weight")
    projections = [part.name for part in program.projections if part.carries == "spikes"]
    neurons = {part.name: part for part in program.populations if isinstance(part.model, Neuron)}
    if not projections and not parameters_of:
        message = f"network '{program.name}': no projection carries spikes: expected one, whose weights learn"
        raise ModelError(message, hint="net.connect makes one")
    if not parameters_of:
        hint = f"known: {', '.join(projections)}"
        raise ModelError("trainable: found no projection: expected at least one", hint=hint)
    selection: tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]] = ({}, {})
    for name, word in parameters_of.items():
        quantities = (word,) if isinstance(word, str) else tuple(word) if isinstance(word, Iterable) else ()
        if not quantities:
            raise ModelError(
                f"trainable: '{name}': found {word!r}: expected names of quantities that learn, such as 'weight'"
            )
        if name in projections:
            for quantity in quantities:
                if quantity not in ("weight", "delay"):
                    raise unknown(f"word of projection '{name}' that learns", quantity, ["weight", "delay"])
            _check_delay(program, name, quantities)
            selection[0][name] = quantities
        elif name in neurons and isinstance(choices, Mapping):
            if "weight" in quantities:
                message = f"'{name}' is a population, whose neurons have no weight: expected the name of a projection"
                raise ModelError(f"trainable: {message}", hint=f"known: {', '.join(projections)}")
            _check_parameters(name, quantities, neurons[name].parameters)
            selection[1][name] = quantities
        else:
            names = [*projections, *neurons] if isinstance(choices, Mapping) else projections
            raise unknown("projection", name, names)
    return selection


def _check_delay(program: Program, name: str, parameters: tuple[str, ...]) -> None:
    part = next(part for part in program.projections if part.name == name)
    if "delay" in parameters and part.grid is not None:
        message = f"trainable: '{name}': synapses of a grid share their delay, which has no gradient"
        raise ModelError(f"{message}: expected its weight alone")


def _check_parameters(population: str, names: tuple[str, ...], parameters: Mapping[str, Any]) -> None:
    for word in names:
        if word in FIXED:
            raise ModelError(f"trainable: '{population}': {word} has no gradient: expected another parameter")
        if word not in parameters:
            raise unknown(f"parameter of '{population}'", word, [name for name in parameters if name not in FIXED])


__all__ = ["Named"]


class Named(torch.nn.Module):
    """Parameters, or modules of parameters, by name.

    In a state dict the name "a.b" is "a:b"; a name that torch uses, such as "keys", ends in ":".

    Args:
        kind: kind of the entries, for messages.
        parts: entries by name; they are sorted by name, as torch does.
    """

    def __init__(self, kind: str, parts: Mapping[str, torch.nn.Parameter | torch.nn.Module]) -> None:
        super().__init__()
        self._kind = kind
        self._at: dict[str, str] = {}
        for name, part in sorted(parts.items()):
            plain = name.replace(".", ":")
            is_reserved = hasattr(self, plain) or hasattr(torch.nn.ModuleDict, plain) or plain == "parametrizations"
            self._at[name] = f"{plain}:" if is_reserved else plain
            setattr(self, self._at[name], part)

    def attribute(self, name: str) -> str:
        """Return the attribute in which torch holds an entry.

        Raises:
            ModelError: the name is unknown.
        """
        if name not in self._at:
            raise unknown(self._kind, name, self._at)
        return self._at[name]

    def __getitem__(self, name: str) -> Any:
        return getattr(self, self.attribute(name))

    def __setitem__(self, name: str, value: torch.Tensor) -> None:
        key = self.attribute(name)
        self._check(name, value)
        if parametrize.is_parametrized(self, key):
            setattr(self, key, value.detach())
        else:
            setattr(self, key, value if isinstance(value, torch.nn.Parameter) else torch.nn.Parameter(value.detach()))

    def _check(self, name: str, value: Any) -> None:
        """Refuse a value that cannot replace a tensor."""
        old = self[name]
        if not isinstance(old, torch.Tensor):
            raise ModelError(f"{self._kind} '{name}': expected a tensor for one of {', '.join(old)}, not for all")
        actual = f"{tuple(value.shape)} of {value.dtype}" if isinstance(value, torch.Tensor) else type(value).__name__
        expected = f"{tuple(old.shape)} of {old.dtype}"
        if actual != expected:
            raise ModelError(f"{self._kind} '{name}': found {actual}: expected a tensor of the shape {expected}")

    def __contains__(self, name: object) -> bool:
        return name in self._at

    def __iter__(self) -> Iterator[str]:
        return iter(self._at)

    def __len__(self) -> int:
        return len(self._at)

    def keys(self) -> KeysView[str]:
        """Return the names."""
        return self._at.keys()

    def values(self) -> ValuesView[Any]:
        """Return the current entries."""
        return dict(self.items()).values()

    def items(self) -> ItemsView[str, Any]:
        """Return names and current entries."""
        return {name: self[name] for name in self._at}.items()

    def tensors(self) -> dict[str, Any]:
        """Return the tensors that an optimiser changes by name, e.g. the original of a parametrised tensor."""
        parametrised: Any = getattr(self, "parametrizations", {})
        return {
            name: getattr(parametrised[attribute], "original", self[name]) if attribute in parametrised else self[name]
            for name, attribute in self._at.items()
        }

    def extra_repr(self) -> str:
        """Return the lines that `repr` shows."""
        tensors = ((name, part) for name, part in self.items() if isinstance(part, torch.Tensor))
        return "\n".join(f"{name}: {tuple(part.shape)} of {part.dtype}" for name, part in tensors)


Tensors = Mapping[str, Tensor]

BOUND_DISTANCE = 1e-3
"""Distance from an excluded bound at which `hold` puts a value that left the bounds, in the value's unit."""

LOWER_RATE = "use a smaller learning rate"
CALL_HOLD = "call Module.hold() after each step of the optimiser, to keep it in its bounds"


def in_steps(delay: Tensor, resolution: float, projection: str) -> Tensor:
    """Return delays in steps, at least 1.

    A delay below one step has the gradient of a delay of one step, except where descent would shorten it further: there
    the gradient is 0, so that an optimiser stops.

    Args:
        delay: delays in ms.
        resolution: length of a step in ms.
        projection: name of the projection, for messages.

    Raises:
        ModelError: a delay is NaN or too long.
    """
    check_delays(delay, resolution, projection)
    steps: Tensor = _AtLeast.apply(delay / resolution, 1.0)  # type: ignore[no-untyped-call]
    return steps


def check_delays(delay: Tensor, resolution: float, projection: str) -> None:
    """Refuse delays in ms that are NaN or too long.

    Raises:
        ModelError: a delay is NaN or too long. The message names the projection.
    """
    if not delay.numel():
        return
    shortest, longest = (float(bound) for bound in delay.detach().aminmax())
    if not (math.isfinite(shortest) and math.isfinite(longest)):
        problem = f"{longest if math.isfinite(shortest) else shortest:g}: expected numbers of ms"
    elif longest / resolution > LONGEST_DELAY + 0.5:  # half a step of tolerance for rounding
        problem = f"{longest:g} ms: expected at most {LONGEST_DELAY * resolution:g} ms, 2^16 steps"
    else:
        return
    raise ModelError(f"delays of '{projection}': found {problem}", hint=LOWER_RATE)


def check_parameters(part: Population, tensors: Tensors) -> None:
    """Refuse parameters of neurons out of the bounds of their model, and a threshold that is not above the reset.

    Raises:
        ModelError: a parameter is out of its bounds. The message names the parameter.
    """
    arrays = {word: values.detach().cpu().double().numpy() for word, values in tensors.items()}
    try:
        for word, values in arrays.items():
            value: Any = values.item() if values.size == 1 else values
            checks.check(part.model.quantities()[word], value, f"{word} of '{part.name}'")
        reset = reset_of(part)
        if {"V_th", reset} & arrays.keys() and {"V_th", reset} <= part.parameters.keys():
            pair = (arrays.get(word, part.parameters[word]) for word in ("V_th", reset))
            top, bottom = np.broadcast_arrays(*pair)
            for k in np.flatnonzero(~(top > bottom))[:1]:
                label = f"V_th of '{part.name}'{f'[{k}]' * (top.size > 1)} = {top[k]:g}"
                raise ModelError(f"{label}: expected more than {reset}, {bottom[k]:g} mV")
    except ModelError as error:
        raise error.but(hint=CALL_HOLD) from None


def check(program: Program, weights: Named, delays: Named, neurons: Named) -> None:
    """Refuse learnt values that are NaN or out of their bounds.

    Raises:
        ModelError: a value is NaN or out of its bounds. The message names the value.
    """
    _check_numbers(program, weights, delays, neurons)
    for name, delay in delays.items():
        check_delays(delay, program.resolution, name)
    for part in program.populations:
        if part.name in neurons:
            check_parameters(part, dict(neurons[part.name].items()))


@torch.no_grad()
def hold(program: Program, weights: Named, delays: Named, neurons: Named) -> None:
    """Clip learnt values to their bounds; parametrised tensors are left to the user.

    Raises:
        ModelError: a value is NaN, or a delay is too long; the message names it.
    """
    _check_numbers(program, weights, delays, neurons)
    for name, delay in delays.items():
        check_delays(delay, program.resolution, name)
        if isinstance(delay, torch.nn.Parameter):
            delay.clamp_(min=program.resolution)
    for part in program.populations:
        if part.name in neurons:
            unparametrised = {word: v for word, v in neurons[part.name].items() if isinstance(v, torch.nn.Parameter)}
            _hold_parameters(part, unparametrised)


def _check_numbers(program: Program, weights: Named, delays: Named, neurons: Named) -> None:
    for word, entries in (("weights", weights), ("delays", delays)):
        for name, values in entries.tensors().items():
            _check_finite(f"{word} of '{name}'", values)
    for part in program.populations:
        if part.name in neurons:
            quantities = part.model.quantities()
            for word, values in neurons[part.name].tensors().items():
                _check_finite(f"{word} of '{part.name}'", values, quantities[word].infinite)


def _check_finite(label: str, values: Tensor, infinite: bool = False) -> None:
    """Refuse NaN; the sum is checked first because it is cheap."""
    values = values.detach()
    if not math.isfinite(float(values.sum())):
        is_invalid = values.isnan() if infinite else ~values.isfinite()
        if bool(is_invalid.any()):
            raise ModelError(f"{label}: found {float(values[is_invalid][0]):g}: expected numbers", hint=LOWER_RATE)


def _hold_parameters(part: Population, tensors: Tensors) -> None:
    """Hold parameters in their bounds, V_th above the reset; the reset moves only if V_th does not learn."""
    for word, values in tensors.items():
        _hold(values, part.model.quantities()[word])
    reset = reset_of(part)
    if {"V_th", reset} <= part.parameters.keys():
        if "V_th" in tensors:
            bottom = _comparable(tensors["V_th"], tensors, part, reset, torch.max)
            _put(tensors["V_th"], tensors["V_th"] <= bottom, bottom + BOUND_DISTANCE)
        elif reset in tensors:
            top = _comparable(tensors[reset], tensors, part, "V_th", torch.min)
            _put(tensors[reset], tensors[reset] >= top, top - BOUND_DISTANCE)


def _hold(values: Tensor, q: Quantity) -> None:
    if q.above is not None:
        values.masked_fill_(values <= q.above, q.above + BOUND_DISTANCE)
    if q.below is not None:
        values.masked_fill_(values >= q.below, q.below - BOUND_DISTANCE)
    if q.at_least is not None or q.at_most is not None:
        values.clamp_(q.at_least, q.at_most)


def _comparable(
    values: Tensor, tensors: Tensors, part: Population, word: str, strictest: Callable[[Tensor], Tensor]
) -> Tensor:
    """Return another parameter in a shape comparable with `values`: its strictest value, or one value per neuron."""
    bound = tensors[word] if word in tensors else torch.as_tensor(part.parameters[word]).to(values)
    return strictest(bound) if values.numel() == 1 else bound


def _put(values: Tensor, mask: Tensor, replacement: Tensor) -> None:
    values.copy_(torch.where(mask, replacement, values))


class _AtLeast(torch.autograd.Function):
    """A lower bound with the gradient of the identity, or 0 where descent would move a value further below it."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, least: float) -> Tensor:
        ctx.save_for_backward(values < least)
        return values.clamp(min=least)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Any:
        (below,) = ctx.saved_tensors
        return grads[0].masked_fill(below & (grads[0] > 0), 0.0), None
