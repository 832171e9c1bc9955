"""Training by gradients: networks as `torch` modules, whose spikes are those of every other backend.

torch is imported when a network is trained or run, not before: that takes seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily
from neuro_torch.backend import TorchBackend

if TYPE_CHECKING:
    from neuro_torch import losses, surrogates
    from neuro_torch.stepping import Stepper

backend = TorchBackend()

_HOMES: dict[str, tuple[str, ...]] = {
    "neuro_torch.losses": (),
    "neuro_torch.stepping": ("Stepper",),
    "neuro_torch.surrogates": (),
}

__all__ = ["Stepper", "backend", "losses", "surrogates"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES)
