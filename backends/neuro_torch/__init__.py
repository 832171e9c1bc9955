"""Training by gradients: networks as `torch` modules, which emit the same spikes as every other backend.

torch is imported when a network is trained or run, because its import takes seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.errors import ModelError
from neuro.core.extras import install
from neuro.core.lazy import public_names
from neuro_torch.backend import TorchBackend

if TYPE_CHECKING:
    from neuro_torch import losses as losses, surrogates as surrogates
    from neuro_torch.bill import Bill as Bill
    from neuro_torch.compressing import largest as largest, prune as prune, quantised as quantised
    from neuro_torch.events import Events as Events, collate as collate
    from neuro_torch.module import Module as Module
    from neuro_torch.outcome import Outcome as Outcome
    from neuro_torch.stepping import Stepper as Stepper

backend = TorchBackend()


if not TYPE_CHECKING:
    _load, __dir__, __all__ = public_names(__name__, __file__)
    __all__ += ["backend"]

    def __getattr__(name: str) -> object:
        """Return a public name; raise one clear error if torch is not installed."""
        try:
            return _load(name)
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            raise ModelError(f"neuro_torch.{name}: torch is not installed", hint=install("torch")) from None
