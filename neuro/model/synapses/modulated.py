"""Rules of three factors: what is common to those whose weights move under a modulator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.errors import ModelError
from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class Modulated(Synapse):
    """Base of rules of spike pairs that are modulated by n of their post neuron: dopamine, reward, an error.

    n is 0 until a signal sets it (`signal`), or the spikes of a population raise it (`dopamine`; each adds 1/tau_n to n
    of every post neuron, or of its own with `dopamine_rule` one_to_one). With a parameter `tau_n` n decays; without it
    n stays as it was set, so only a signal can say it.
    """

    learns: ClassVar[str] = "pairs"
    modulated: ClassVar[bool] = True

    signal: str | None = quantity(None, "", "the signal that sets n", kind="name")
    dopamine: str | None = quantity(None, "", "the population whose spikes release dopamine", kind="name")
    dopamine_rule: str = quantity(
        "all_to_all",
        "",
        "which post neurons a spike reaches",
        kind="word",
        words=("all_to_all", "one_to_one"),
    )
    dopamine_delay: float | None = quantity(None, "ms", "delay of dopamine; the resolution if not given", kind="delay")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.signal is not None and self.dopamine is not None:
            raise ModelError(
                f"{self.name} has both 'signal' and 'dopamine': expected one source of dopamine",
                path=("dopamine",),
            )
        if self.dopamine is not None and "tau_n" not in self.numbers():
            raise ModelError(
                f"{self.name}.dopamine = '{self.dopamine}': {self.name} has no tau_n, so n would never fall",
                hint="name a signal instead",
                path=("dopamine",),
            )
