"""Training by gradients: networks as `torch` modules, whose spikes are those of every other backend.

torch is imported when a network is trained or run, not before: that takes seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily

if TYPE_CHECKING:
    from neuro_torch import surrogates
    from neuro_torch.events import Events, collate
    from neuro_torch.module import Module
    from neuro_torch.outcome import Outcome

_HOMES: dict[str, tuple[str, ...]] = {
    "neuro_torch.surrogates": (),
    "neuro_torch.events": ("Events", "collate"),
    "neuro_torch.module": ("Module",),
    "neuro_torch.outcome": ("Outcome",),
}

__all__ = ["Events", "Module", "Outcome", "collate", "surrogates"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES)
