"""What a batch made of a network: spikes, potentials and counts, as tensors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from neuro.core.errors import unknown
from neuro_torch.scan.compiled import Packed
from neuro_torch.scan.layers import ScanTask, Synapses

if TYPE_CHECKING:
    from torch import Tensor

    from neuro.program.program import Program

__all__ = ["Outcome", "active_updates"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a batch made of a network.

    Index 0 of an axis of steps is the first step of the run.

    Attributes:
        spikes: by population of the outputs 0 or 1, of graded ones payloads, (batch, steps, neurons); gradients go
            through the surrogate.
        V_m: likewise the potential at the end of each step in mV, after a reset, as NEST records it.
        counts: by population, of all neurons and inputs, the spikes of each neuron, of graded ones its messages,
            (batch, neurons). Those of neurons have gradients.
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


def active_updates(
    population: int, emitted: Mapping[int, Any], incoming: Iterable[Synapses], task: ScanTask, scans: Any
) -> Tensor:
    """How many of a population in each recording, shape (batch,), as `neuro.Simulation.counts` has them.

    Args:
        population: the index.
        emitted: spikes of populations, dense or packed.
        incoming: the projections onto it.
        task: of the pass.
        scans: `neuro_torch.scan.compiled` or `neuro_torch.scan.operations`, which took the spikes.
    """
    with torch.no_grad():
        heard = emitted[population] > 0
        for part in incoming:
            heard = heard | _arrived(part, emitted[part.source], task, scans)
        updates: Tensor = heard.sum((1, 2))
        return updates


def _arrived(part: Synapses, spikes: Any, task: ScanTask, scans: Any) -> Tensor:
    """Where spikes arrive, (batch, steps, targets), or (batch, steps, 1) where every target hears every source."""
    if not part.dense or not isinstance(spikes, (Tensor, Packed)):
        ones = torch.ones(part.shape, dtype=task.dtype, device=task.device)
        arrived: Tensor = scans.drive(part, spikes, ones, task) > 0
        return arrived
    if isinstance(spikes, Tensor):
        some = (spikes > 0).any(2)
    else:
        some = torch.from_numpy(spikes.ends[1:] > spikes.ends[:-1]).reshape(task.batch, task.steps)
    heard = torch.zeros_like(some)
    heard[:, part.least :] = some[:, : task.steps - part.least]
    return heard[:, :, None]
