"""Parameters that learn: names as a user gives them, the tensors under these names, and their bounds."""

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
"""By projection or population what of it learns."""

FIXED = ("t_ref", "refractory_input", "reset_by_subtraction", "max_spikes", "threshold_rises", "tau_minus")
"""Parameters that count steps or choose, and so have no gradient, and one that only rules of pairs read."""


def trainable(program: Program, given: Iterable[str] | Mapping[str, Iterable[str] | str]) -> tuple[Words, Words]:
    """The words of projections, "weight" and "delay", and those of populations, their parameters.

    Args:
        program: the network.
        given: names of projections, whose weights learn; or by name of a projection or a population what of it learns.

    Raises:
        ModelError: nothing is named, or something that cannot learn.
    """
    asked = {given: "weight"} if isinstance(given, str) else given
    if not isinstance(asked, Iterable) or not all(isinstance(name, str) for name in asked):
        raise ModelError(f"trainable = {given!r}: expected names of projections")
    words = dict(asked) if isinstance(asked, Mapping) else dict.fromkeys(asked, "weight")
    projections = [part.name for part in program.projections if part.carries == "spikes"]
    neurons = {part.name: part for part in program.populations if isinstance(part.model, Neuron)}
    if not projections and not words:
        message = f"network '{program.name}': no projection carries spikes: expected one, whose weights learn"
        raise ModelError(message, hint="net.connect makes one")
    if not words:
        hint = f"known: {', '.join(projections)}"
        raise ModelError("trainable: found no projection: expected at least one", hint=hint)
    found: tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]] = ({}, {})
    for name, word in words.items():
        each = (word,) if isinstance(word, str) else tuple(word) if isinstance(word, Iterable) else ()
        if not each:
            raise ModelError(f"trainable: '{name}': found {word!r}: expected what of it learns, such as 'weight'")
        if name in projections:
            for one in each:
                if one not in ("weight", "delay"):
                    raise unknown(f"word of projection '{name}' that learns", one, ["weight", "delay"])
            _check_delay(program, name, each)
            found[0][name] = each
        elif name in neurons and isinstance(asked, Mapping):
            if "weight" in each:
                message = f"'{name}' is a population, whose neurons have no weight: expected the name of a projection"
                raise ModelError(f"trainable: {message}", hint=f"known: {', '.join(projections)}")
            _check_parameters(name, each, neurons[name].parameters)
            found[1][name] = each
        else:
            known = [*projections, *neurons] if isinstance(asked, Mapping) else projections
            raise unknown("projection", name, known)
    return found


def _check_delay(program: Program, name: str, words: tuple[str, ...]) -> None:
    part = next(part for part in program.projections if part.name == name)
    if "delay" in words and part.grid is not None:
        message = f"trainable: '{name}': synapses of a grid share their delay, which has no gradient"
        raise ModelError(f"{message}: expected its weight alone")


def _check_parameters(population: str, words: tuple[str, ...], known: Mapping[str, Any]) -> None:
    for word in words:
        if word in FIXED:
            raise ModelError(f"trainable: '{population}': {word} has no gradient: expected another parameter")
        if word not in known:
            raise unknown(f"parameter of '{population}'", word, [each for each in known if each not in FIXED])


__all__ = ["Named"]


class Named(torch.nn.Module):
    """Parameters, or modules of them, by name; in a state dict "a.b" is "a:b", and "keys", which torch has, "keys:".

    Args:
        kind: what they are of, for messages.
        parts: by name; they are kept in the order of their names, as torch does.
    """

    def __init__(self, kind: str, parts: Mapping[str, torch.nn.Parameter | torch.nn.Module]) -> None:
        super().__init__()
        self._kind = kind
        self._at: dict[str, str] = {}
        for name, part in sorted(parts.items()):
            plain = name.replace(".", ":")
            taken = hasattr(self, plain) or hasattr(torch.nn.ModuleDict, plain) or plain == "parametrizations"
            self._at[name] = f"{plain}:" if taken else plain
            setattr(self, self._at[name], part)

    def attribute(self, name: str) -> str:
        """Under which name torch holds it.

        Raises:
            ModelError: there is none of that name.
        """
        if name not in self._at:
            raise unknown(self._kind, name, self._at)
        return self._at[name]

    def __getitem__(self, name: str) -> Any:
        return getattr(self, self.attribute(name))

    def __setitem__(self, name: str, value: torch.Tensor) -> None:
        at = self.attribute(name)
        self._check(name, value)
        if parametrize.is_parametrized(self, at):
            setattr(self, at, value.detach())
        else:
            setattr(self, at, value if isinstance(value, torch.nn.Parameter) else torch.nn.Parameter(value.detach()))

    def _check(self, name: str, value: Any) -> None:
        """Refuse what cannot stand in the place of a tensor."""
        old = self[name]
        if not isinstance(old, torch.Tensor):
            raise ModelError(f"{self._kind} '{name}': expected a tensor for one of {', '.join(old)}, not for all")
        found = f"{tuple(value.shape)} of {value.dtype}" if isinstance(value, torch.Tensor) else type(value).__name__
        expected = f"{tuple(old.shape)} of {old.dtype}"
        if found != expected:
            raise ModelError(f"{self._kind} '{name}': found {found}: expected a tensor of the shape {expected}")

    def __contains__(self, name: object) -> bool:
        return name in self._at

    def __iter__(self) -> Iterator[str]:
        return iter(self._at)

    def __len__(self) -> int:
        return len(self._at)

    def keys(self) -> KeysView[str]:
        """Their names."""
        return self._at.keys()

    def values(self) -> ValuesView[Any]:
        """They themselves, as they are now."""
        return dict(self.items()).values()

    def items(self) -> ItemsView[str, Any]:
        """Names and they themselves."""
        return {name: self[name] for name in self._at}.items()

    def learnt(self) -> dict[str, Any]:
        """What optimisers change by name: beneath a parametrisation of one tensor, that."""
        held: Any = getattr(self, "parametrizations", {})
        return {
            name: getattr(held[at], "original", self[name]) if at in held else self[name]
            for name, at in self._at.items()
        }

    def extra_repr(self) -> str:
        """What torch shows of it."""
        tensors = ((name, part) for name, part in self.items() if isinstance(part, torch.Tensor))
        return "\n".join(f"{name}: {tuple(part.shape)} of {part.dtype}" for name, part in tensors)


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
