"""Training by gradients: networks as `torch` modules, whose spikes are those of every other backend.

torch is imported when a network is trained or run, not before: that takes seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.errors import ModelError
from neuro.core.extras import install
from neuro.core.lazy import lazily
from neuro_torch.backend import TorchBackend

if TYPE_CHECKING:
    from neuro_torch import losses, surrogates
    from neuro_torch.bill import Bill
    from neuro_torch.events import Events, collate
    from neuro_torch.module import Module
    from neuro_torch.outcome import Outcome
    from neuro_torch.pruning import largest, prune
    from neuro_torch.quantise import quantised
    from neuro_torch.stepping import Stepper

backend = TorchBackend()

_HOMES: dict[str, tuple[str, ...]] = {
    "neuro_torch.losses": (),
    "neuro_torch.surrogates": (),
    "neuro_torch.bill": ("Bill",),
    "neuro_torch.events": ("Events", "collate"),
    "neuro_torch.module": ("Module",),
    "neuro_torch.outcome": ("Outcome",),
    "neuro_torch.pruning": ("largest", "prune"),
    "neuro_torch.quantise": ("quantised",),
    "neuro_torch.stepping": ("Stepper",),
}

__all__ = [
    "Bill",
    "Events",
    "Module",
    "Outcome",
    "Stepper",
    "backend",
    "collate",
    "largest",
    "losses",
    "prune",
    "quantised",
    "surrogates",
]

if not TYPE_CHECKING:
    _found, __dir__ = lazily(__name__, _HOMES)

    def __getattr__(name: str) -> object:
        """A public name; one error where torch, which it needs, is missing."""
        try:
            return _found(name)
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            raise ModelError(f"neuro_torch.{name}: torch is not installed", hint=install("torch")) from None
