"""Tensors that learn, under any name that a network has: torch itself takes no '.', and none of its own methods."""

from __future__ import annotations

from collections.abc import ItemsView, Iterator, KeysView, Mapping, ValuesView
from typing import Any

import torch
from torch.nn.utils import parametrize

from neuro.core.errors import ModelError, unknown

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

    def extra_repr(self) -> str:
        """What torch shows of it."""
        tensors = ((name, part) for name, part in self.items() if isinstance(part, torch.Tensor))
        return "\n".join(f"{name}: {tuple(part.shape)} of {part.dtype}" for name, part in tensors)
