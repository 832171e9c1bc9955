"""What of a network learns: names and words as a user gives them, and the tensors under these names."""

from __future__ import annotations

from collections.abc import ItemsView, Iterable, Iterator, KeysView, Mapping, ValuesView
from typing import Any

import torch
from torch.nn.utils import parametrize

from neuro.core.errors import ModelError, unknown
from neuro.model.neurons import Neuron
from neuro.program.program import Program

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
