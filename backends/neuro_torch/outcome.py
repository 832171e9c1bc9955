"""What a batch made of a network: spikes, potentials and counts, as tensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from neuro.core.errors import unknown

if TYPE_CHECKING:
    from torch import Tensor

    from neuro.program.program import Program

__all__ = ["Outcome"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a batch made of a network.

    Index 0 of an axis of steps is the first step of the run.

    Attributes:
        spikes: by population of the outputs 0 or 1, (batch, steps, neurons); gradients go through the surrogate.
        V_m: likewise the potential at the end of each step in mV, after a reset, as NEST records it.
        counts: by population, of all neurons and inputs, the spikes of each neuron, (batch, neurons). Those of neurons
            have gradients.
        active: by population of neurons, how many updates had an arrival or a spike, (batch,).
        steps: of each recording.
        step: length of one in ms.
        program: the network that made it.
    """

    spikes: Mapping[str, Tensor]
    V_m: Mapping[str, Tensor]
    counts: Mapping[str, Tensor]
    active: Mapping[str, Tensor]
    steps: int
    step: float
    program: Program

    @cached_property
    def batch(self) -> int:
        """Recordings."""
        return len(next(iter(self.spikes.values())))


class Told(Mapping[str, Any]):
    """Values by population that are worked out when they are asked for.

    Args:
        kind: what they are of, for messages.
        makers: by name what makes each.
    """

    def __init__(self, kind: str, makers: Mapping[str, Any]) -> None:
        self._kind, self._makers, self._made = kind, makers, dict[str, Any]()

    def __getitem__(self, name: str) -> Any:
        if name not in self._makers:
            raise unknown(self._kind, name, self._makers)
        if name not in self._made:
            self._made[name] = self._makers[name]()
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        return name in self._makers

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)

    def __repr__(self) -> str:
        return f"{self._kind}: {', '.join(self._makers)}"
