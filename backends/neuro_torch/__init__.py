"""Training by gradients: networks as `torch` modules, whose spikes are those of every other backend.

torch is imported when a network is trained or run, not before: that takes seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily

if TYPE_CHECKING:
    from neuro_torch import losses, surrogates

_HOMES: dict[str, tuple[str, ...]] = {
    "neuro_torch.losses": (),
    "neuro_torch.surrogates": (),
}

__all__ = ["losses", "surrogates"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES)
